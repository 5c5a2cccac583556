"""What a keypoint reader understood is doubted: axes, unit, order of joints, rows of several people."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gesture_pose_files.arrays import ArrayReader
from gesture_pose_files.csv_table import CsvReader
from gesture_pose_files.layout import sequence
from gesture_pose_files.openpose_json import OpenPoseJsonReader

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.pose.plausible import check_plausible
from gesture_core.skeletons import COCO17, COCO18
from gesture_core.testing import draw_pose
from gesture_core.types import PoseSequence

FRAMES = 24


def person() -> np.ndarray:
    """(T, 17, 2) pixels of somebody who stands and waves, in COCO's order."""
    pose = draw_pose(frames=FRAMES)
    return pose.keypoints[:, [COCO18.index(joint) for joint in COCO17.joints]].astype(np.float64)


def read(points: np.ndarray, **said: object) -> PoseSequence:
    return sequence(points, ReadOptions(**said), source="k.npy", reader="arrays")  # type: ignore[arg-type]


def in_turn(points: np.ndarray) -> np.ndarray:
    """Two people, row by row."""
    rows = np.repeat(points, 2, axis=0)
    rows[1::2] += [150, 20]
    return rows


REFUSED: dict[str, tuple[Callable[[np.ndarray], np.ndarray], dict[str, object], str, dict[str, object]]] = {
    "y first": (lambda p: p[..., ::-1], {}, "keypoints.axes=yx", {"axes": "yx"}),
    "y first, shares": (lambda p: (p / [640, 480])[..., ::-1], {}, "keypoints.axes=yx", {"axes": "yx"}),
    "y up": (lambda p: p * [1, -1] + [0, 480], {}, "keypoints.axes=x-y", {"axes": "x-y"}),
    "shares as pixels": (
        lambda p: p / [640, 480], {"unit": "pixels"}, "keypoints.unit=shares", {"unit": "shares"},
    ),
    "pixels as shares": (lambda p: p, {"unit": "shares"}, "keypoints.unit=pixels", {"unit": "pixels"}),
    "another order": (
        lambda p: p[:, ::-1], {}, "keypoints.order=h36m17|NAME", {"order": COCO17.joints[::-1]},
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_what_can_be_no_person_is_refused_with_the_option_that_helps(kind: str) -> None:
    change, said, option, helps = REFUSED[kind]
    points = change(person())
    with pytest.raises(KeypointError) as caught:
        check_plausible(read(points, **said))
    assert caught.value.code == "E_KEYPOINTS_IMPLAUSIBLE"
    assert option in caught.value.remedy and any(letter.isdigit() for letter in caught.value.cause)
    assert check_plausible(read(points, **helps)) == []


@pytest.mark.parametrize("unit", ["pixels", "shares"])
@pytest.mark.parametrize("value", [1e9, -999.0, 500.0])
def test_one_wrong_frame_decides_neither_the_unit_nor_the_clip(unit: str, value: float) -> None:
    points = person() / ([640, 480] if unit == "shares" else 1)
    clean = read(points)
    for joints in (slice(9, 10), slice(None)):
        wrong = points.copy()
        wrong[12, joints] = value
        found = read(wrong)
        assert check_plausible(found) == check_plausible(clean) == []
        np.testing.assert_allclose(found.keypoints[13], clean.keypoints[13], rtol=1e-6)


def test_a_body_of_no_size_is_refused() -> None:
    with pytest.raises(KeypointError, match="one place"):
        check_plausible(read(np.full((FRAMES, 17, 2), 7.0)))


def test_arms_longer_than_three_torsos_are_refused() -> None:
    points = person()
    points[:, [9, 10]] += [0, 900]
    with pytest.raises(KeypointError, match=r"the arms are .* torsos long"):
        check_plausible(read(points))


def test_rows_of_several_people_in_turn_are_refused() -> None:
    with pytest.raises(KeypointError, match="several people"):
        check_plausible(read(in_turn(person())))
    shuffled = in_turn(person())[np.random.default_rng(0).permutation(2 * FRAMES)]
    with pytest.raises(KeypointError, match="several people"):
        check_plausible(read(shuffled * [3, 1]))


def test_people_who_lie_down_are_believed_where_the_axes_are_said(tmp_path: Path) -> None:
    lying = person()[..., ::-1]
    with pytest.raises(KeypointError, match="lies on its side in 24 of 24 frames"):
        check_plausible(read(lying))
    (note,) = check_plausible(read(lying, axes="xy"))
    assert "24 of 24" in note
    names = [f"{joint}_{axis}" for joint in COCO17.joints for axis in "xy"]
    rows = "\n".join(",".join(map(str, row)) for row in lying.reshape(FRAMES, -1))
    (tmp_path / "k.csv").write_text(f"{','.join(names)}\n{rows}")
    (note,) = check_plausible(CsvReader().read(tmp_path / "k.csv")[0])
    assert "lies on its side" in note, "the header says which column is x"


def test_nobody_and_a_few_frames_are_left_to_later_checks() -> None:
    nobody = PoseSequence(np.full((9, 18, 2), np.nan), np.zeros((9, 18)), np.arange(9.0))
    assert check_plausible(nobody) == []
    assert check_plausible(read(person()[:3, :, ::-1])) == []


def test_real_keypoints_are_plausible(shared: Path) -> None:
    """549 sequences of four networks; one person does push-ups, which OpenPose's files are believed."""
    landmarks = shared / "body_gesture" / "landmarks_mediapipe33.npz"
    arrays, notes = ArrayReader(), []
    tables = [p for p in sorted((shared / "utd_openpose").rglob("*.csv")) if p.name != "authors_result.csv"]
    poses = [CsvReader().read(path)[0] for path in tables]
    poses += [arrays.read(landmarks, member)[0] for member in arrays.members(landmarks)]
    poses += [arrays.read(path)[0] for path in sorted((shared / "pose_trainer").rglob("*.npy"))]
    folders = [path for path in sorted((shared / "openpose_json").glob("*/*")) if path.is_dir()]
    poses += [OpenPoseJsonReader().read(folder)[0] for folder in folders]
    for pose in poses:
        notes += check_plausible(pose)
    assert len(poses) >= 500
    assert sorted(notes) == [
        "the body jumps by half its size in 14% of the steps",
        "the body jumps by half its size in 23% of the steps",
        "the body jumps by half its size in 41% of the steps",
        "the body lies on its side in 132 of 132 frames, 92° from upright",
    ]


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_joints_at_the_origin_are_missing_whatever_their_score(share: float) -> None:
    pose = read(person())
    points = pose.keypoints.copy()
    there = np.random.default_rng(0).random(len(points)) < share
    for joint in (9, 10):  # wrists
        points[there, joint] = 0
    pose = replace(pose, keypoints=points)
    assert (pose.scores > 0).all()
    assert check_plausible(pose) == []
