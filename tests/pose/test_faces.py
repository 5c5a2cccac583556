"""Faces in pictures: where they are looked for, what of the body gives way to them, when none is one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import pytest

from gesture_core.classify.estimator import GestureClassifier
from gesture_core.errors import ConfigError, ModelError
from gesture_core.joints import FACE, FACE_POINTS
from gesture_core.pose.decode import decode
from gesture_core.pose.extract import extract_poses
from gesture_core.pose.faces import FaceFinder
from gesture_core.pose.live import LivePose
from gesture_core.pose.models import ModelFile, known_models
from gesture_core.pose.network import NetworkBackend
from gesture_core.pose.parts import Parts, open_parts
from gesture_core.settings import Settings, load_settings
from gesture_core.skeletons import BLAZEPOSE33, FACE20
from gesture_core.types import Person

AT = {joint: place for place, joint in enumerate(BLAZEPOSE33.joints)}
LIPS = [FACE.index("upper_lip"), FACE.index("lower_lip")]


class Network:
    """Sees a face in what is bright: its lips are at the top and the bottom of it."""

    region = 192

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        (frame,) = frames
        y, x = np.nonzero(frame[..., 0] > 100)
        presence = 0.99 if len(x) else 0.01
        points = np.full((len(FACE), 2), 96.0, np.float32)
        region = np.array([(95.5, 95.5), (95.5, 20.0)])
        if len(x):
            points[LIPS] = [(x.mean(), y.min()), (x.mean(), y.max())]
        scores = np.full(len(FACE), presence, np.float32)
        return [[Person(points, scores, presence=presence, region=region)]]


class Body:
    """A backend that knows where everybody is."""

    skeleton, batch_size = "blazepose33", 4

    def __init__(self, points: np.ndarray, scores: np.ndarray | None = None) -> None:
        self.points, self.scores = points, np.ones(33, np.float32) if scores is None else scores

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        depth = np.zeros(33, np.float32)
        return [[Person(self.points, self.scores, depth=depth)] for _ in frames]


def body(apart: float = 40.0, turn: float = 0.0) -> np.ndarray:
    """33 joints, the middle of the eyes at (300, 200), so far apart."""
    points = np.random.default_rng(0).uniform(100, 400, (33, 2)).astype(np.float32)
    cos, sin = np.cos(turn) * apart, np.sin(turn) * apart
    for joint, (x, y) in {"left_eye": (0.5, 0), "right_eye": (-0.5, 0), "nose": (0, 0.6)}.items():
        points[AT[joint]] = 300 + cos * x - sin * y, 200 + sin * x + cos * y
    return points


def frame_of(opening: int) -> np.ndarray:
    frame = np.zeros((480, 640, 3), np.uint8)
    frame[205 - opening // 2 : 207 + opening // 2, 290:310] = 255
    return frame


def finder() -> FaceFinder:
    return FaceFinder(cast(NetworkBackend, Network()), BLAZEPOSE33)


def at(points: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(BLAZEPOSE33.joints, points, strict=True))


def wanted(*changes: str) -> Settings:
    return load_settings("hands", ["keypoints.parts=body,face", *changes], environment={})


def test_the_square_is_level_between_the_eyes_and_wide_as_a_face() -> None:
    (square,) = finder().squares(at(body()), "face")
    assert (square.x, square.angle) == pytest.approx((300, 0)) and 200 < square.y < 224
    (turned,) = finder().squares(at(body(turn=0.5)), "face")
    assert turned.angle == pytest.approx(0.5) and turned.side == pytest.approx(square.side)
    blind = body()
    blind[AT["nose"]] = np.nan
    assert finder().squares(at(blind), "face") == []


def test_small_faces_are_not_asked_about() -> None:
    find = finder()
    small = find.find(frame_of(4), Person(body(11.9), np.ones(33)))
    assert find.looks == 0 and np.isnan(small.keypoints).all() and not small.scores.any()
    large = find.find(frame_of(4), Person(body(12.1), np.ones(33)))
    assert find.looks == 2 and large.scores == pytest.approx(0.99)
    assert np.isnan(find.find(frame_of(4), None).keypoints).all()


def test_mouths_of_the_body_give_way_to_those_of_the_face_or_to_none() -> None:
    frames = [(n / 10, frame_of(n)) for n in range(6)] + [(0.6, np.zeros((480, 640, 3), np.uint8))]
    (pose,) = extract_poses(frames, Body(body()), parts=Parts([finder()]), steady=False)
    assert pose.skeleton == "blazepose33+face"
    names = Parts([finder()]).skeleton.joints
    face = [names.index(joint) for joint in FACE]
    assert np.isfinite(pose.keypoints[:6, face]).all() and np.isnan(pose.keypoints[6, face]).all()
    assert names.index("left_mouth") == AT["left_mouth"]
    rest = [place for joint, place in AT.items() if joint not in FACE]
    np.testing.assert_array_equal(pose.keypoints[:, rest], np.tile(body()[rest], (7, 1, 1)))
    assert pose.depth is not None and np.isnan(pose.depth[:, face]).all()
    assert np.isfinite(pose.depth[:, rest]).all()
    live = LivePose(Body(body()), parts=Parts([finder()]), steady=False).push(*frames[2])
    assert live.skeleton == pose.skeleton and np.isfinite(live.keypoints[0, face]).all()
    assert live.depth is not None and np.isnan(live.depth[:, face]).all()


def test_what_the_network_says_is_read() -> None:
    contract = known_models()["blazeface"].contract
    assert contract
    mesh = np.zeros((468, 3))
    mesh[:, :2] = np.random.default_rng(0).uniform(50, 150, (468, 2))
    for joint, x in (
        ("right_eye_outer", 60),
        ("right_eye_inner", 80),
        ("left_eye_inner", 110),
        ("left_eye_outer", 130),
    ):
        mesh[FACE_POINTS[joint][1]] = x, 80, 0
    ((face,),) = decode(
        [mesh.reshape(1, 1, 1, -1), np.full((1, 1, 1, 1), 2.0)], contract, (192, 192), "single", 0.0
    )
    assert face.presence == pytest.approx(1 / (1 + np.exp(-2)))
    chin = FACE20.index("chin")
    np.testing.assert_allclose(face.keypoints[chin], mesh[FACE_POINTS["chin"][1], :2] - 0.5, rtol=1e-6)
    again = finder().after(face)
    assert again and again.angle == pytest.approx(0, abs=1e-6) and again.side == pytest.approx(150, rel=0.05)


def test_what_is_not_here_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("GESTURE_MODELS", str(tmp_path))
    with pytest.raises(ModelError, match="gesture models get blazeface"):
        open_parts(wanted(), "blazepose33")
    with pytest.raises(ConfigError, match="has no left_eye, right_eye"):
        open_parts(wanted(), "mpi15")


def test_the_real_network_sees_mouths_open(
    blazeface: ModelFile, shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GESTURE_MODELS", str(blazeface.path.parents[1]))
    picture = next(
        iter(sorted((shared / "people_more" / "webcam_farzadmalik").glob("Good.a093de42*.jpg"))), None
    )
    if picture is None:
        pytest.skip("the picture of a face is absent here")
    points, scores = np.full((33, 2), np.nan, np.float32), np.zeros(33, np.float32)
    seen = {
        "left_eye": (363, 230), "right_eye": (297, 228), "nose": (329, 262), "left_shoulder": (470, 431),
        "right_shoulder": (168, 434), "left_elbow": (480, 470), "right_elbow": (150, 470),
        "left_hip": (433, 837), "right_hip": (200, 837),
    }  # fmt: skip
    for joint, place in seen.items():
        points[AT[joint]], scores[AT[joint]] = place, 1.0
    settings = wanted("hands.face=true", "parts.weights={lips=1.0}")
    parts = open_parts(settings, "blazepose33", 1)
    assert parts
    closed, clips, labels = np.asarray(cv2.imread(str(picture))), [], []
    for number in range(6):
        away = np.array([[2 * number], [-3 * number]], np.float32)  # the face is elsewhere in each clip
        onto = np.hstack([np.eye(2, dtype=np.float32), away])
        label = ("talks", "is silent")[number % 2]
        frames = []
        for n in range(8):
            gap = (10 + 8 * np.sin(n + number)) * (label == "talks")
            frames.append((n / 8, np.asarray(cv2.warpAffine(with_open_mouth(closed, gap), onto, (640, 480)))))
        backend = Body(points + away.T, scores)
        (pose,) = extract_poses(frames, backend, steady=False, parts=parts)
        clips.append(pose)
        labels.append(label)
    lips = [parts.skeleton.index(joint) for joint in ("upper_lip", "lower_lip")]
    assert all(np.isfinite(pose.keypoints[:, lips]).all() for pose in clips)
    opened = [float(np.ptp(np.diff(pose.keypoints[:, lips, 1], axis=1))) for pose in clips]
    assert min(opened[::2]) > 4 * max(opened[1::2])
    said = GestureClassifier(settings).fit(clips[:4], labels[:4]).predict(clips[4:])
    assert list(said) == labels[4:]


def with_open_mouth(picture: np.ndarray, gap: float) -> np.ndarray:
    """The picture of a face with a hole between its lips, so many pixels high, and its chin as much lower."""
    y, x = np.mgrid[:480, :640].astype(np.float32)
    below = y - 308
    hole = gap * np.sqrt(np.clip(1 - ((x - 325) / 30) ** 2, 0, 1))
    source = y - np.where(below > hole, hole * np.clip(1 - (below - hole) / 90, 0, 1), 0)
    opened = cv2.remap(picture, x, source.astype(np.float32), cv2.INTER_LINEAR)
    opened[(below > 0) & (below < hole)] = (20, 15, 40)
    return opened
