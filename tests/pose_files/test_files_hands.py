"""Hands and faces in keypoint files: kept where they are wanted, said where they are not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from frames import frame_name
from gesture_pose_files.array_frames import ArrayFramesReader
from gesture_pose_files.arrays import ArrayReader
from gesture_pose_files.csv_table import CsvReader
from gesture_pose_files.openpose_json import OpenPoseJsonReader

from gesture_core.errors import ConfigError, GestureError
from gesture_core.joints import FACE
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import (
    BLAZEPOSE33,
    BODY25,
    COCO17,
    HANDS42,
    MEDIAPIPE543,
    MEDIAPIPE543_FACE,
    OPENPOSE137,
    OPENPOSE137_HANDS,
    SKELETONS,
    Skeleton,
    skeleton,
)
from gesture_core.testing.signals import draw_pose
from gesture_core.types import PoseSequence

HANDS = ReadOptions(parts=("body", "hands"))
ALL = ReadOptions(parts=("body", "hands", "face"))
FRAMES = 12


def whole(layout: Skeleton) -> np.ndarray:
    """(T, J, 3) a drawn person in ``layout``, hands at the wrists, a face at the nose."""
    body = draw_pose(frames=FRAMES)
    at = {name: body.keypoints[:, n].astype(float) for n, name in enumerate(skeleton("coco18").joints)}
    out = np.zeros((FRAMES, len(layout.joints), 3))
    for place, joint in enumerate(layout.joints):
        side = joint.partition("_")[0]
        near = at["nose"]
        if joint in HANDS42.joints:
            near = at[f"{side}_wrist"] + 0.5 * HANDS42.joints.index(joint)
        elif joint in at:
            near = at[joint]
        elif not joint.startswith("face_") and joint not in FACE:
            near = at.get(f"{side}_ankle", at["neck"]) + 0.25 * len(joint)
        out[:, place, :2] = near + (0.01 * place if joint in FACE or joint.startswith("face_") else 0)
        out[:, place, 2] = 0.9
    return out


def agrees(pose: PoseSequence, points: np.ndarray, layout: Skeleton, parts: str = "hands") -> None:
    assert pose.skeleton.endswith(f"+{parts}"), pose.skeleton
    wanted = (*HANDS42.joints, *(FACE if "face" in parts else ()), "left_wrist", "right_elbow")
    for joint in wanted:
        found = pose.keypoints[:, skeleton(pose.skeleton).index(joint)]
        np.testing.assert_allclose(found, points[:, layout.index(joint), :2], atol=1e-3)


def read(reader: type, path: Path, options: ReadOptions = HANDS) -> PoseSequence:
    (pose,) = reader(options).read(path)
    assert isinstance(pose, PoseSequence)
    return pose


@pytest.mark.parametrize("layout", [OPENPOSE137, SKELETONS["openpose130"]], ids=lambda one: one.name)
def test_openpose_folders(tmp_path: Path, layout: Skeleton) -> None:
    points, body = whole(layout), len(skeleton(layout.body).joints)
    for number, frame in enumerate(points):
        lists = np.split(frame, [body, body + 70, body + 91])
        keys = ("pose", "face", "hand_left", "hand_right")
        one = {
            f"{key}_keypoints_2d": part.reshape(-1).tolist() for key, part in zip(keys, lists, strict=True)
        }
        if number == 3:
            one["hand_left_keypoints_2d"] = []
        (tmp_path / frame_name("c", number)).write_text(json.dumps({"people": [one]}))
    pose = read(OpenPoseJsonReader, tmp_path, ALL)
    left = [skeleton(pose.skeleton).index(joint) for joint in HANDS42.joints[:21]]
    assert not pose.seen[3, left].any() and pose.seen[2, left].all()
    points[3, [layout.index(joint) for joint in HANDS42.joints[:21]]] = np.nan
    agrees(pose, points, layout, "face")
    pose = read(OpenPoseJsonReader, tmp_path)
    agrees(pose, points, layout)
    assert pose.provenance["notes"].startswith("the face is not used (keypoints.parts)")
    plain = read(OpenPoseJsonReader, tmp_path, ReadOptions())
    assert plain.skeleton == layout.body and plain.provenance["notes"].startswith(
        "hands and face are not used"
    )
    one["hand_left_keypoints_2d"] = [1.0] * 60
    (tmp_path / frame_name("c", 5)).write_text(json.dumps({"people": [one]}))
    assert "21 joints in hand_left_keypoints_2d" in read(OpenPoseJsonReader, tmp_path).provenance["lost"]


@pytest.mark.parametrize(
    "layout",
    [
        MEDIAPIPE543, MEDIAPIPE543_FACE, SKELETONS["mediapipe75"], SKELETONS["coco133"],
        SKELETONS["halpe136"], OPENPOSE137, OPENPOSE137_HANDS,
    ],
    ids=lambda one: one.name,
)  # fmt: skip
@pytest.mark.parametrize("flat", [False, True])
def test_arrays_of_whole_bodies(tmp_path: Path, layout: Skeleton, flat: bool) -> None:
    points = whole(layout)
    np.save(tmp_path / "a.npy", points.reshape(FRAMES, -1) if flat else points)
    agrees(read(ArrayReader, tmp_path / "a.npy"), points, layout)
    plain = read(ArrayReader, tmp_path / "a.npy", ReadOptions())
    assert len(skeleton(plain.skeleton).joints) <= 33 and "not used" in plain.provenance["notes"]


def test_landmarks_of_mediapipe_have_no_visibility_in_hands(tmp_path: Path) -> None:
    points = whole(MEDIAPIPE543)
    hands = np.concatenate([points[:, 501:, :2], np.zeros((FRAMES, 42, 1))], axis=2)
    body = np.concatenate([points[:, :33, :2], np.zeros((FRAMES, 33, 1)), points[:, :33, 2:]], axis=2)
    hands[4, :21] = 0  # as a hand that is not found is written
    row = np.concatenate([body.reshape(FRAMES, -1), hands.reshape(FRAMES, -1)], axis=1)
    np.save(tmp_path / "a.npy", row)
    pose = read(ArrayReader, tmp_path / "a.npy")
    assert row.shape[1] == 258 and not pose.seen[4, 33:54].any() and pose.seen[3, 33:].all()
    four = np.concatenate([points[:, :, :2], np.zeros((FRAMES, 543, 1)), points[:, :, 2:]], axis=2)
    four[:, 33:, 3] = 0
    np.save(tmp_path / "a.npy", four)
    agrees(read(ArrayReader, tmp_path / "a.npy"), points, MEDIAPIPE543)


@pytest.mark.parametrize("shape", [(21, 3), (42, 3), (2, 21, 3), (63,), (126,)])
def test_hands_without_a_body(tmp_path: Path, shape: tuple[int, ...]) -> None:
    points = whole(MEDIAPIPE543)[:, 501:]
    points = points[:, 21:] if shape in ((21, 3), (63,)) else points
    np.save(tmp_path / "a.npy", points.reshape(FRAMES, *shape))
    pose = read(ArrayReader, tmp_path / "a.npy")
    assert pose.skeleton == "coco18+hands" and pose.seen[:, -21:].all() and not pose.seen[:, :2].any()
    np.testing.assert_allclose(pose.keypoints[:, -21:], points[:, -21:, :2], atol=1e-3)
    wrist = skeleton(pose.skeleton).index("right_wrist")
    np.testing.assert_allclose(pose.keypoints[:, wrist], points[:, -21, :2], atol=1e-3)
    left = ReadOptions(parts=("body", "hands"), order=("left_hand21",))
    if points.shape[1] == 21:
        assert read(ArrayReader, tmp_path / "a.npy", left).seen[:, 18:39].all()
    if len(shape) == 2:
        for number, frame in enumerate(points):
            np.save(tmp_path / f"{number}.npy", frame)
        (tmp_path / "a.npy").unlink()
        assert read(ArrayFramesReader, tmp_path).seen[:, -21:].all()
        with pytest.raises(GestureError):
            read(ArrayFramesReader, tmp_path, ReadOptions())


def test_a_table_names_its_hands(tmp_path: Path) -> None:
    points = whole(HANDS42)[:, 21:]
    names = ["WRIST", "THUMB_CMC", "THUMB_MCP", "THUMB_IP", "THUMB_TIP"]
    names += [f"{finger}_FINGER_{place}" for finger in ("INDEX", "MIDDLE", "RING")
              for place in ("MCP", "PIP", "DIP", "TIP")]  # fmt: skip
    names += [f"PINKY_{place}" for place in ("MCP", "PIP", "DIP", "TIP")]
    header = [f"RIGHT_{'HAND_WRIST' if name == 'WRIST' else name}.{axis}" for name in names for axis in "xy"]
    rows = [
        ",".join(header),
        *(",".join(f"{v:.4f}" for v in row) for row in points[..., :2].reshape(FRAMES, -1)),
    ]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    pose = read(CsvReader, tmp_path / "a.csv")
    np.testing.assert_allclose(pose.keypoints[:, -21:], points[..., :2], atol=1e-3)


def test_a_skeleton_from_a_file(tmp_path: Path) -> None:
    layout = tmp_path / "glove.toml"
    layout.write_text(
        'joints = ["Brust", "Handgelenk_L", "Handgelenk_R", "left_shoulder", "right_shoulder", "x9"]\n'
        "[names]\nHandgelenk_L = 'left_wrist'\nHandgelenk_R = 'right_wrist'\n"
        "[derived]\nnose = ['left_shoulder', 'right_shoulder']\n"
    )
    options = ReadOptions(order=(str(layout),))
    assert options.order[1] == "left_wrist" and options.order[-1] == "nose=left_shoulder+right_shoulder"
    points = np.random.default_rng(0).uniform(50, 400, (FRAMES, 6, 2))
    np.save(tmp_path / "a.npy", points)
    pose = read(ArrayReader, tmp_path / "a.npy", options).onto("coco18")
    np.testing.assert_allclose(pose.keypoints[:, 4], points[:, 2], atol=1e-3)
    np.testing.assert_allclose(pose.keypoints[:, 0], points[:, 3:5].mean(axis=1), atol=1e-3)
    again = ReadOptions(order=options.order)
    assert again == options, "what a run keeps needs no file"
    for text in (
        "joints = 3",
        "joints = []",
        "joint = ['a']",
        "joints = ['neck']\nderived = {nose = ['a', 'b']}",
        "joints = ['neck']\nnames = {b = 'nose'}",
        "joints = ['ne+ck']",
        "joints = [",
        "joints = ['nose']",
    ):
        layout.write_text(text)
        with pytest.raises(ConfigError, match="order"):
            ReadOptions(order=(str(layout),))
    with pytest.raises(ConfigError, match="order"):
        ReadOptions(order=("absent.toml",))


def test_the_body_is_what_it_was(tmp_path: Path) -> None:
    for layout in (COCO17, BODY25, BLAZEPOSE33):
        points = whole(layout)
        np.save(tmp_path / "a.npy", points)
        one, other = (read(ArrayReader, tmp_path / "a.npy", options) for options in (ReadOptions(), ALL))
        assert one.skeleton == other.skeleton == layout.name
        np.testing.assert_array_equal(one.keypoints, other.keypoints)
    with pytest.raises(ConfigError, match="parts"):
        ReadOptions(parts=("hands",))
    with pytest.raises(ConfigError, match="parts"):
        ReadOptions(parts=("body", "tail"))
