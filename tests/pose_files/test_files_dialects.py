"""Arrays as other tools shape them: whole bodies, people, side arrays, a file a frame, scores above 1."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from gesture_pose_files.array_frames import ArrayFramesReader
from gesture_pose_files.arrays import ArrayReader
from gesture_pose_files.openpose_json import OpenPoseJsonReader

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import COCO17

T = 10
RNG = np.random.default_rng(3)
COCO = np.concatenate([RNG.uniform(50, 400, (T, 17, 2)), np.full((T, 17, 1), 0.9)], axis=2)
MEDIA_PIPE = np.concatenate(
    [RNG.uniform(0.2, 0.8, (T, 33, 2)), np.full((T, 33, 1), -0.1), np.full((T, 33, 1), 0.9)], axis=2
)


def near(joints: int, values: int, at: float = 0.5) -> np.ndarray:
    """Hands or a face: many joints in a small place."""
    return RNG.uniform(at, at + 0.05, (T, joints, values))


def holistic(order: str) -> np.ndarray:
    parts = {"b": MEDIA_PIPE[..., :3], "f": near(468, 3), "l": near(21, 3), "r": near(21, 3)}
    return np.concatenate([parts[part] for part in order], axis=1)


LAYOUTS: dict[str, tuple[np.ndarray, str]] = {
    "whole body": (np.concatenate([COCO, near(116, 3, 200) % 1 + [200, 200, 0]], axis=1), "coco17"),
    "whole body, flat": (np.concatenate([COCO, near(116, 3)], axis=1).reshape(T, -1), "coco17"),
    "axes of one": (COCO[:, None, None], "coco17"),
    "one person first": (COCO[None], "coco17"),
    "a batch of one": (COCO.reshape(1, T, 51), "coco17"),
    "holistic 1662": (
        np.hstack([MEDIA_PIPE.reshape(T, -1), near(468, 3).reshape(T, -1), near(42, 3).reshape(T, -1)]),
        "blazepose33",
    ),
    "holistic 258": (np.hstack([MEDIA_PIPE.reshape(T, -1), near(42, 3).reshape(T, -1)]), "blazepose33"),
    "holistic 543, body first": (holistic("bflr"), "blazepose33"),
    "holistic 543, face first": (holistic("flbr"), "blazepose33"),
    "holistic 1629": (holistic("flbr").reshape(T, -1), "blazepose33"),
    "body and hands": (holistic("blr"), "blazepose33"),
}


@pytest.mark.parametrize("form", LAYOUTS)
def test_the_body_of_every_layout(tmp_path: Path, form: str) -> None:
    array, kind = LAYOUTS[form]
    np.save(tmp_path / "clip.npy", array)
    (sequence,) = ArrayReader().read(tmp_path / "clip.npy")
    wanted = COCO[..., :2] if kind == "coco17" else MEDIA_PIPE[..., :2] * [640, 480]
    assert sequence.skeleton == kind
    np.testing.assert_allclose(sequence.keypoints, wanted, rtol=1e-5)
    whole = array.size // T > 132
    assert ("hands and face are not used" in sequence.provenance.get("notes", "")) == whole


def test_a_face_alone_is_no_body(tmp_path: Path) -> None:
    np.save(tmp_path / "clip.npy", near(543, 3))
    with pytest.raises(KeypointError) as caught:
        ArrayReader().read(tmp_path / "clip.npy")
    assert caught.value.code == "E_KEYPOINTS_SHAPE" and "543" in caught.value.cause


@pytest.mark.parametrize("axis", [0, 1])
def test_people_are_an_axis(tmp_path: Path, axis: int) -> None:
    both = np.stack([COCO * [1, 1, 0.5], COCO + np.array([500, 0, 0])], axis=axis)
    np.save(tmp_path / "clip.npy", both)
    (best,) = ArrayReader().read(tmp_path / "clip.npy")
    np.testing.assert_allclose(best.keypoints, COCO[..., :2] + [500, 0], rtol=1e-5)
    assert "the best of 2 people" in best.provenance["notes"]
    assert [one.person for one in ArrayReader(people="multi").read(tmp_path / "clip.npy")] == [0, 1]


SIDES: dict[str, dict[str, np.ndarray]] = {
    "mmaction": {"keypoint": COCO[None, ..., :2], "keypoint_score": COCO[None, ..., 2]},
    "mmaction without people": {
        "keypoint": COCO[..., :2],
        "keypoint_score": COCO[..., 2],
        "label": np.array(3),
    },
    "boxes": {"keypoints": COCO, "boxes": np.ones((T, 4)), "frame_names": np.array(["a"] * T)},
    "a name of its own": {"xy": COCO[..., :2], "conf": COCO[..., 2], "bbox": np.ones((T, 5))},
    "holistic": {
        "pose": MEDIA_PIPE,
        "left_hand": near(21, 3),
        "right_hand": near(21, 3),
        "face": near(468, 3),
    },
    "holistic, flat": {"pose": MEDIA_PIPE.reshape(T, -1), "lh": near(21, 3).reshape(T, -1)},
}


@pytest.mark.parametrize("form", SIDES)
def test_arrays_beside_the_body_are_no_clips(tmp_path: Path, form: str) -> None:
    path = tmp_path / "clip.npz"
    np.savez(path, allow_pickle=False, **SIDES[form])
    assert ArrayReader().members(path) == [""]
    (sequence,) = ArrayReader().read(path)
    wanted = MEDIA_PIPE[..., :2] * [640, 480] if form.startswith("holistic") else COCO[..., :2]
    np.testing.assert_allclose(sequence.keypoints, wanted, rtol=1e-5)
    np.testing.assert_allclose(sequence.scores, 0.9, rtol=1e-5)
    used = {"keypoint", "keypoints", "keypoint_score", "xy", "conf", "pose"}
    unused = [name for name in SIDES[form] if name not in used]
    notes = [f"arrays that are not used: {', '.join(unused)}"] if unused else []
    notes += ["feet: read and not compared"] if form.startswith("holistic") else []
    assert sequence.provenance.get("notes", "") == "; ".join(notes)


def test_the_rate_of_an_archive(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", keypoints=COCO, fps=np.array(10))
    (sequence,) = ArrayReader().read(tmp_path / "a.npz")
    np.testing.assert_allclose(sequence.times, np.arange(T) / 10)
    (sequence,) = ArrayReader(ReadOptions(fps=20)).read(tmp_path / "a.npz")
    np.testing.assert_allclose(sequence.times, np.arange(T) / 20)


@pytest.mark.parametrize(
    ("greatest", "expected", "word"),
    [(1.3, 1.0, ""), (2.0, 1.0, "visibility"), (3.1, 1.0, "divided by the greatest"), (90.0, 0.9, "percent")],
)
def test_scores_above_one(tmp_path: Path, greatest: float, expected: float, word: str) -> None:
    array = COCO.copy()
    array[..., 2] = greatest
    array[2, 3, 2] = 0
    np.save(tmp_path / "a.npy", array)
    (sequence,) = ArrayReader().read(tmp_path / "a.npy")
    assert sequence.scores.max() == pytest.approx(expected) and not sequence.seen[2, 3]
    assert word in sequence.provenance.get("notes", "") and bool(word) == ("notes" in sequence.provenance)


@pytest.mark.parametrize("low", [-5.0, 400.0])
def test_a_depth_is_no_score(tmp_path: Path, low: float) -> None:
    array = COCO.copy()
    array[..., 2] = np.linspace(low, low + 300, 17)
    np.save(tmp_path / "a.npy", array)
    metres = COCO * [0.002, 0.002, 3]
    np.save(tmp_path / "b.npy", metres)
    for name in ("a.npy", "b.npy"):
        with pytest.raises(KeypointError) as caught:
            ArrayReader().read(tmp_path / name)
        assert caught.value.code == "E_KEYPOINTS_VALUE" and "no score" in caught.value.cause


FRAMES: dict[str, np.ndarray] = {
    "holistic": LAYOUTS["holistic 1662"][0],
    "media pipe": MEDIA_PIPE.reshape(T, -1),
    "joints": COCO,
    "flat joints": COCO.reshape(T, -1),
}


@pytest.mark.parametrize("form", FRAMES)
def test_one_file_a_frame(tmp_path: Path, form: str) -> None:
    for number, frame in enumerate(FRAMES[form], 3):
        np.save(tmp_path / f"{number}.npy", frame)
    assert not ArrayReader().accepts(tmp_path / "3.npy"), "it is one frame"
    reader = ArrayFramesReader(ReadOptions(fps=10))
    assert reader.accepts(tmp_path) and reader.members(tmp_path) == [""]
    (sequence,) = reader.read(tmp_path)
    wanted = COCO[..., :2] if "joints" in form else MEDIA_PIPE[..., :2] * [640, 480]
    np.testing.assert_allclose(sequence.keypoints, wanted, rtol=1e-5)
    np.testing.assert_allclose(sequence.times, np.arange(3, 3 + T) / 10)
    (tmp_path / "5.npy").write_bytes((tmp_path / "5.npy").read_bytes()[:150])
    np.save(tmp_path / "6.npy", np.zeros(7))
    (sequence,) = reader.read(tmp_path)
    assert sequence.seen.any(axis=1).tolist() == [True, True, False, False] + [True] * (T - 4)
    assert sequence.provenance["lost"].startswith("2 of 10 frames cannot be read: ")
    for number in range(3, 3 + T):
        (tmp_path / f"{number}.npy").write_bytes(b"no array")
    with pytest.raises(KeypointError) as caught:
        reader.read(tmp_path)
    assert caught.value.code == "E_KEYPOINTS_FORMAT"


def test_a_folder_of_clips_is_no_clip(tmp_path: Path) -> None:
    for number in range(3):
        np.save(tmp_path / f"wave_{number}.npy", COCO)
        np.save(tmp_path / f"flat_{number}.npy", COCO.reshape(T, -1))
    assert not ArrayFramesReader().accepts(tmp_path)


def test_frames_of_one_person_with_an_axis_for_people(tmp_path: Path) -> None:
    for number, frame in enumerate(COCO):
        np.save(tmp_path / f"{number}.npy", frame[None])
    assert ArrayFramesReader().accepts(tmp_path) and not ArrayReader().accepts(tmp_path / "0.npy")
    (pose,) = ArrayFramesReader().read(tmp_path)
    np.testing.assert_allclose(pose.keypoints, COCO[..., :2], rtol=1e-6)


def test_python_objects_beside_keypoints_are_left_alone(tmp_path: Path) -> None:
    np.savez(tmp_path / "k.npz", keypoints=COCO, meta=np.array({"never": "unpickled"}, dtype=object))
    (pose,) = ArrayReader().read(tmp_path / "k.npz")
    assert len(pose) == T and "not used: meta" in pose.provenance["notes"]
    np.savez(tmp_path / "o.npz", keypoints=np.array([COCO[0], None], dtype=object))
    with pytest.raises(KeypointError, match="Python objects"):
        ArrayReader().read(tmp_path / "o.npz")


def marks(frame: np.ndarray) -> list[dict[str, float]]:
    return [dict(zip(("x", "y", "z", "visibility"), map(float, mark), strict=True)) for mark in frame]


TREES: dict[str, Callable[[np.ndarray], object]] = {
    "message": lambda frame: {"landmark": marks(frame)},
    "nested message": lambda frame: {"pose_landmarks": {"landmark": marks(frame)}, "face_landmarks": None},
    "list": marks,
    "editor": lambda frame: [{"people": [{"pose_keypoints_2d": flat17()}], "canvas_width": 640}],
    "detectron": lambda frame: {"instances": [{"pred_keypoints": COCO[0].tolist(), "pred_boxes": []}]},
}


def flat17() -> list[float]:
    return [float(value) for value in COCO[0].reshape(-1)]


@pytest.mark.parametrize("kind", TREES)
def test_frames_as_mediapipe_editors_and_detectron_write_them(tmp_path: Path, kind: str) -> None:
    for number, frame in enumerate(MEDIA_PIPE):
        (tmp_path / f"{number}.json").write_text(json.dumps(TREES[kind](frame)))
    reader = OpenPoseJsonReader()
    assert reader.accepts(tmp_path)
    (pose,) = reader.read(tmp_path)
    assert len(pose) == T and pose.seen.all()
    if kind in ("message", "nested message", "list"):
        assert pose.skeleton == "blazepose33"
        np.testing.assert_allclose(pose.keypoints / (640, 480), MEDIA_PIPE[..., :2], atol=1e-5)
    else:
        assert pose.skeleton == "coco17"


def test_joints_of_a_frame_are_known_by_their_names(tmp_path: Path) -> None:
    names = list(COCO17.joints)
    for number, frame in enumerate(COCO):
        places = zip(names, frame.tolist(), strict=True)
        marks = [{"name": name, "x": x, "y": y} for name, (x, y, _) in places]
        (tmp_path / f"{number}.json").write_text(json.dumps(marks[::-1]))
    (pose,) = OpenPoseJsonReader().read(tmp_path)
    np.testing.assert_allclose(pose.keypoints, COCO[..., :2], rtol=1e-5)
    for file in tmp_path.iterdir():
        file.write_text(file.read_text().replace("nose", "tail"))
    assert not OpenPoseJsonReader().accepts(tmp_path)


@pytest.mark.parametrize("form", ["{}_01.npy", "{}.npy"])
def test_a_clip_in_a_list_of_its_own_is_no_frame(tmp_path: Path, form: str) -> None:
    path = tmp_path / form.format("clip")
    np.save(path, COCO[None, ..., :2].reshape(1, T, -1))
    assert ArrayReader().accepts(path) and not ArrayFramesReader().accepts(tmp_path)
    np.testing.assert_allclose(ArrayReader().read(path)[0].keypoints, COCO[..., :2], rtol=1e-5)


def test_frames_without_anybody_are_no_lost_ones_and_what_lies_beside_a_body_is_named(tmp_path: Path) -> None:
    for number, frame in enumerate(MEDIA_PIPE):
        nobody: object = [None, [], {"landmark": []}][number % 3]
        hand = {"landmark": marks(near(21, 4)[0])}
        message = {"poseLandmarks": nobody if number < 3 else marks(frame), "leftHandLandmarks": hand}
        (tmp_path / f"{number}.json").write_text(json.dumps(message))
    assert OpenPoseJsonReader().accepts(tmp_path)
    (pose,) = OpenPoseJsonReader().read(tmp_path)
    assert pose.seen.any(axis=1).tolist() == [False] * 3 + [True] * (T - 3)
    assert "lost" not in pose.provenance
    for note in ("hands and face beside landmarks", "depth (z) is not used"):
        assert note in pose.provenance["notes"]
