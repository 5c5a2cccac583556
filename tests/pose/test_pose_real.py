"""Real networks on real videos: several people, somebody six metres away, somebody cut at the hips."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from gesture_core.plugin import registry
from gesture_core.pose.extract import extract_poses
from gesture_core.pose.models import find_model
from gesture_core.skeletons import COCO18
from gesture_core.video import open_video

UPPER = [i for i, joint in enumerate(COCO18.joints) if joint.endswith(("neck", "shoulder", "elbow", "wrist"))]


def backend(path: Path, **options: object):
    return registry().make("pose", "onnx", options, model=find_model(path))


def frames_of(path: Path, count: int, step: int = 1) -> list[tuple[float, np.ndarray]]:
    with open_video(path) as video:
        return list(islice(video, 0, count * step, step))


def test_people_in_a_street_are_told_apart(shared: Path, shared_models: Path) -> None:
    network = backend(shared_models / "hpe0001_f32_dynamic.onnx", height=256)
    ((_, street),) = frames_of(shared / "people" / "openpose_example.avi", 1)
    ((_, alone),) = frames_of(shared / "utd_openpose" / "videos" / "a7_s5_t2_color.avi", 1)
    crowd, (person,) = (network.estimate([frame], "multi")[0] for frame in (street, alone))
    assert 4 <= len(crowd) <= 12
    necks = np.stack([one.keypoints[1] for one in crowd])
    apart = np.linalg.norm(necks[:, None] - necks, axis=2)[np.triu_indices(len(crowd), 1)]
    assert np.nanmin(apart) > 10
    # With one person in the picture both ways of decoding say the same.
    np.testing.assert_allclose(person.keypoints, network.estimate([alone])[0][0].keypoints, atol=1e-3)


@pytest.mark.parametrize("clip", ["greeting_1_1m_upper", "greeting_2_4m_full", "greeting_3_6m_full"])
def test_a_person_is_found_near_and_far(clip: str, shared: Path, shared_models: Path) -> None:
    video = shared / "body_gesture" / "S1" / f"{clip}.avi"
    frames = frames_of(video, 25)
    (pose,) = extract_poses(frames, backend(shared_models / "openpose_mv2s_256x256.onnx"))
    assert pose.provenance["follow"] == "True"
    (teacher,) = extract_poses(frames[::8], backend(shared_models / "hpe0001_f32_dynamic.onnx"), follow=False)
    seen = teacher.seen[:, UPPER] & (teacher.scores[:, UPPER] >= 0.3)
    width = np.nanmedian(np.linalg.norm(teacher.keypoints[:, 2] - teacher.keypoints[:, 5], axis=1))
    apart = np.linalg.norm(pose.keypoints[::8] - teacher.keypoints, axis=2)[:, UPPER] / width
    assert (apart[seen] < 0.5).mean() > 0.9
    assert seen.mean() > 0.9
