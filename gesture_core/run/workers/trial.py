"""A pose network is tried on a known picture before it meets an archive."""

from __future__ import annotations

import numpy as np

from gesture_core.errors import PoseError
from gesture_core.plugin.interfaces import PoseBackend
from gesture_core.skeletons import skeleton


def try_backend(backend: PoseBackend) -> None:
    """Run ``backend`` twice on a picture of a figure; a PoseError says what is wrong with its answer.

    Whether it finds anybody does not count: that both answers are equal, and of the right form, does.
    """
    picture = np.full((240, 320, 3), 90, np.uint8)
    picture[:, 110:210] += np.arange(240, dtype=np.uint8)[:, None, None] // 4
    picture[30:70, 145:175] = (140, 170, 210)  # a head above a trunk, arms and legs
    picture[75:150, 135:185] = (60, 60, 180)
    picture[80:95, 80:240] = (140, 170, 210)
    picture[150:230, 137:157] = picture[150:230, 163:183] = (120, 80, 50)
    answers = [backend.estimate([picture]) for _ in range(2)]
    width = len(skeleton(backend.skeleton).joints)
    for answer in answers:
        if len(answer) != 1:
            raise PoseError(f"answered with {len(answer)} pictures for one", code="E_MODEL_PROBE")
        for person in answer[0]:
            if np.shape(person.keypoints) != (width, 2) or np.shape(person.scores) != (width,):
                raise PoseError(
                    f"keypoints {np.shape(person.keypoints)} and scores {np.shape(person.scores)} "
                    f"for {width} joints",
                    code="E_MODEL_PROBE",
                )
            if np.isinf(person.keypoints).any() or not np.isfinite(person.scores).all():
                raise PoseError("infinite keypoints or scores", code="E_MODEL_PROBE")
    first, second = (np.array([p.keypoints for p in answer[0]]) for answer in answers)
    if first.shape != second.shape or not np.allclose(first, second, atol=0.01, equal_nan=True):
        raise PoseError("two answers to one picture differ", code="E_MODEL_PROBE")
