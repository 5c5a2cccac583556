"""The settings of [pose] and [limits] mean the same for every kind of keypoint file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gesture_core.records import encoded
from gesture_core.run.fingerprint import pose_identity, pose_keys
from gesture_core.run.inputs import discover
from gesture_core.run.store import Extracted, read_keypoints, write_keypoints
from gesture_core.run.workers.keypoints import KeypointExtractor
from gesture_core.run.workers.worker import Worker
from gesture_core.settings import load_settings
from gesture_core.skeletons import COCO18
from gesture_core.testing import draw_pose
from gesture_core.types import Job, PoseSequence

FRAMES = 12


def somebody(person: int, sure: float) -> PoseSequence:
    rng = np.random.default_rng(person)
    points = rng.normal(300 + 400 * person, 60, (FRAMES, 18, 2)).round(2)
    scores = np.full((FRAMES, 18), sure)
    scores[:, 13] = 0.002  # an ankle that nobody sees
    return PoseSequence(points, scores, np.arange(FRAMES) / 20, person=person)


def write(folder: Path, kind: str, people: list[PoseSequence]) -> Path:
    path = folder / f"k.{kind}"
    if kind == "parquet":
        facts = {"frames_declared": 90, "frames_read": FRAMES, "complete": False, "seconds": 0.55}
        write_keypoints(path, people, facts | {"notes": ["78 frames lost"], "people": len(people)})
        return path
    names = [f"{joint}_{part}" for joint in COCO18.joints for part in ("x", "y", "score")]
    lines = [",".join(["time", "person", *names])]
    for pose in people:
        table = np.concatenate([pose.keypoints, pose.scores[..., None]], axis=2).reshape(FRAMES, -1)
        lines += [
            ",".join(map(str, [time, pose.person, *row])) for time, row in zip(pose.times, table, strict=True)
        ]
    path.write_text("\n".join(lines))
    return path


def extract(path: Path, **changes: Any) -> tuple[Extracted, list[PoseSequence]]:
    settings = load_settings("paper", environment={}, **changes)
    (item,) = discover([path])
    store = path.parent / "store"
    job = Job(settings.as_dict(), str(store), pose_keys(pose_identity(settings, [item])))
    extractor = KeypointExtractor(Worker(job, lambda _: None))
    outcome = Extracted.from_tree(extractor.extract(encoded(path), item.member, item.reader))
    return outcome, read_keypoints(store / outcome.stored).sequences if outcome.stored else []


@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_one_person_is_the_default_and_all_are_there_for_multi(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, [somebody(0, 0.4), somebody(1, 0.9)])
    outcome, (found,) = extract(path)
    assert len(outcome.people) == 1 and found.person == 0
    np.testing.assert_allclose(found.keypoints, somebody(1, 0.9).keypoints)
    assert outcome.complete == (kind == "csv"), "what the file knows of its video stays known"
    outcome, found_all = extract(path, pose__people="multi")
    assert len(outcome.people) == 2 and [pose.person for pose in found_all] == [0, 1]


@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_the_limit_of_frames_holds(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, [somebody(0, 0.9)])
    assert extract(path, limits__frames=FRAMES)[0].code == ""
    assert extract(path, pose__people="multi", limits__frames=FRAMES - 1)[0].code == "E_KEYPOINTS_LIMIT"


@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_joints_below_the_score_are_missing(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, [somebody(0, 0.9), somebody(1, 0.4)])
    (every,) = extract(path)[1]
    assert every.seen.all()
    (sure,) = extract(path, pose__score=0.3)[1]
    assert sure.seen[:, :13].all() and not sure.seen[:, 13].any() and sure.seen[:, 14:].all()
    assert len(extract(path, pose__score=0.5, pose__people="multi")[1]) == 1
    assert extract(path, pose__score=0.95)[0].people == ()


def test_joints_below_the_score_are_not_asked_whether_they_are_plausible(tmp_path: Path) -> None:
    pose = draw_pose(frames=FRAMES)
    points, scores = pose.keypoints[..., :2].copy(), np.full(pose.scores.shape, 0.9)
    for side in ("left", "right"):  # guesses far outside the picture
        wrist = COCO18.index(f"{side}_wrist")
        points[:, wrist], scores[:, wrist] = 5000, 0.05
    path = write(tmp_path, "csv", [replace(pose, keypoints=points, scores=scores)])
    assert extract(path)[0].code == "E_KEYPOINTS_IMPLAUSIBLE"
    outcome, _ = extract(path, pose__score=0.3)
    assert outcome.code == "" and outcome.people
