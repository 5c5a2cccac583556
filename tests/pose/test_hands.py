"""Hands in pictures: where they are looked for, whose they are, when none is one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from gesture_core.errors import ModelError
from gesture_core.pose.decode import decode
from gesture_core.pose.extract import extract_poses
from gesture_core.pose.hands import HandFinder, after_landmarks
from gesture_core.pose.live import LivePose
from gesture_core.pose.models import ModelFile, choose_pose, known_models
from gesture_core.pose.network import NetworkBackend
from gesture_core.pose.parts import Parts, open_parts
from gesture_core.settings import load_settings
from gesture_core.skeletons import COCO18, HANDS42, skeleton
from gesture_core.testing.signals import draw_whole
from gesture_core.types import Person

AT = {joint: place for place, joint in enumerate(COCO18.joints)}
SHAPE = np.array([(0, 0), *((4.0 * (f - 2), -8.0 - 5 * k) for f in range(5) for k in range(4))])


class Network:
    """Sees a hand wherever there is a bright spot, which is its wrist."""

    region = 224

    def __init__(self) -> None:
        self.seen: list[np.ndarray] = []

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        (frame,) = frames
        self.seen.append(frame)
        high = int(frame.max())
        y, x = np.argwhere(frame[..., 0] == high).mean(axis=0)
        points = (SHAPE * 5 + (x, y)).astype(np.float32)
        presence = 0.99 if high > 100 else 0.01
        return [[Person(points, np.full(21, presence, np.float32), presence=presence)]]


def finder() -> HandFinder:
    return HandFinder(cast(NetworkBackend, Network()), COCO18)


def frame_of(points: np.ndarray, sides: Sequence[str] = ("left", "right")) -> np.ndarray:
    frame = np.zeros((480, 640, 3), np.uint8)
    for side in sides:
        x, y = np.rint(points[AT[f"{side}_wrist"]]).astype(int)
        frame[y - 2 : y + 3, x - 2 : x + 3] = 255
    return frame


class Body:
    """A backend that knows where everybody is."""

    skeleton, batch_size = "coco18", 3

    def __init__(self, points: np.ndarray, count: int = 1) -> None:
        self.points, self.count, self.number = points, count, 0

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        out = []
        for _ in frames:
            one = Person(self.points[self.number], np.ones(18, np.float32))
            out.append([one] * self.count)
            self.number += 1
        return out


POINTS = draw_whole("coco18", frames=10).keypoints


def test_hands_belong_to_their_arms() -> None:
    find = finder()
    for points in POINTS:
        hands = find.find(frame_of(points), Person(points, np.ones(18)))
        for side, place in (("left", 0), ("right", 21)):
            np.testing.assert_allclose(hands.keypoints[place], points[AT[f"{side}_wrist"]], atol=2.5)
            assert hands.scores[place] == pytest.approx(0.99)
    assert find.looks < 3 * len(POINTS), "a hand that is followed is looked at once"
    one = find.find(frame_of(points, ("left",)), Person(points, np.ones(18)))
    assert np.isnan(one.keypoints[21:]).all() and (one.scores[21:] == 0).all() and one.scores[0] > 0.9
    assert np.isnan(find.find(frame_of(points), None).keypoints).all()


def test_arms_that_are_not_seen_or_too_small_have_no_hand() -> None:
    find = finder()
    points = POINTS[0].copy()
    points[AT["left_elbow"]] = np.nan
    hands = find.find(frame_of(points), Person(points, np.ones(18)))
    assert np.isnan(hands.keypoints[:21]).all() and np.isfinite(hands.keypoints[21:]).all()
    small = POINTS[0] * 0.1 + 100
    looks = find.looks
    assert np.isnan(find.find(frame_of(small), Person(small, np.ones(18))).keypoints).all()
    assert find.looks == looks


def test_a_hand_is_found_where_the_wrist_is_missed_by_half_a_forearm() -> None:
    find, points = finder(), POINTS[0].copy()
    points[AT["left_wrist"]] = points[AT["left_elbow"]] + (60, 0)
    *_, wide = find.squares(dict(zip(AT, points, strict=True)), "left")
    hand = points[AT["left_wrist"]] - (0.55 * wide.side / 1.4, 0)
    there = {"left_wrist": hand, "right_wrist": hand}
    shown = frame_of(np.array([there.get(joint, point) for joint, point in zip(AT, points, strict=True)]))
    found = find.find(shown, Person(points, np.ones(18)))
    np.testing.assert_allclose(found.keypoints[0], hand, atol=4)


def test_the_next_square_follows_the_hand() -> None:
    region = after_landmarks(SHAPE * 4 + (100, 200))
    assert region and region.angle == pytest.approx(0, abs=0.05) and region.y < 200
    turned = after_landmarks(SHAPE[:, ::-1] * (-4, 4) + (100, 200))
    assert turned and turned.angle == pytest.approx(np.pi / 2, abs=0.05) and turned.x > 100
    assert turned.side == pytest.approx(region.side)
    assert after_landmarks(np.zeros((21, 2))) is None and after_landmarks(np.full((21, 2), np.nan)) is None


@pytest.mark.parametrize("people", ["single", "multi"])
def test_videos_have_hands_where_they_are_wanted(people: str) -> None:
    frames = [(n / 10, frame_of(points)) for n, points in enumerate(POINTS)]
    (pose,) = extract_poses(frames, Body(POINTS), people, parts=Parts([finder()]))
    assert pose.skeleton == "coco18+hands" and pose.seen.all()
    (plain,) = extract_poses(frames, Body(POINTS), people)
    np.testing.assert_array_equal(pose.keypoints[:, :18], plain.keypoints)
    live = LivePose(Body(POINTS), parts=Parts([finder()]), steady=False)
    one = live.push(0.0, frames[0][1])
    assert one.skeleton == "coco18+hands" and one.seen.all()


def test_what_is_not_here_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("GESTURE_MODELS", str(tmp_path))
    assert open_parts(load_settings("modern", environment={}), "coco18") is None
    with pytest.raises(ModelError, match="gesture models get blazehand"):
        open_parts(load_settings("hands", environment={}), "coco18")
    known = known_models()["blazehand"]
    assert known.contract and skeleton(known.contract.skeleton).has_hands
    outputs = [np.full((1, 63), 5.0), np.array([[0.7]]), np.zeros((1, 1)), np.zeros((1, 63))]
    ((hand,),) = decode(outputs, known.contract, (224, 224), "single", 0.0)
    assert hand.presence == pytest.approx(0.7) and hand.keypoints.shape == (21, 2)
    monkeypatch.setattr(
        "gesture_core.pose.models.find_model",
        lambda name: type(
            "Found", (), {"contract": known.contract, "path": Path("a.tflite"), "name": name}
        )(),
    )
    with pytest.raises(ModelError, match="finds hands or faces, not people"):
        choose_pose(load_settings("hands", ["pose.model=blazehand"], environment={}))


def test_the_real_network_sees_no_hand_in_noise(
    blazehand: ModelFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GESTURE_MODELS", str(blazehand.path.parents[1]))
    found = open_parts(load_settings("hands", environment={}), "coco18", 1)
    assert found and blazehand.contract
    noise = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    hands = found.find(noise, Person(POINTS[0], np.ones(18)))
    assert hands.keypoints.shape == (len(HANDS42.joints), 2) and not (hands.scores > 0).any()
