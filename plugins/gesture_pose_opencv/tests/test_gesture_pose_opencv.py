"""The packaged network on OpenCV."""

from __future__ import annotations

import numpy as np
import pytest
from gesture_pose_opencv.backend import OpenCvBackend

from gesture_core.errors import ModelError
from gesture_core.pose import find_model


def test_it_answers_for_every_picture_and_keeps_its_threshold() -> None:
    try:
        model = find_model("compact")
    except ModelError as error:
        pytest.skip(error.cause)
    backend = OpenCvBackend(model, score=0.5, batch_size=2, presence=0.0)
    pictures = list(np.random.default_rng(0).integers(0, 256, (3, 120, 90, 3), np.uint8))
    for (person,) in backend.estimate(pictures):
        missing = np.isnan(person.keypoints).any(axis=1)
        assert (person.scores[missing] == 0).all() and (person.scores[~missing] >= 0.5).all()
    assert backend.provenance["backend"] == "opencv-dnn" and "opencv" in backend.provenance["runtime"]
