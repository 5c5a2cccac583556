"""Hands and a face in frames of their own, and the parts that are made of them."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from gesture_signals.hands import PALM, HandsNormalizer
from gesture_signals.parts import Parts

from gesture_core.classify.comparison import parts
from gesture_core.classify.estimator import GestureClassifier
from gesture_core.errors import ConfigError, PoseError
from gesture_core.joints import FINGERS
from gesture_core.settings import load_settings
from gesture_core.signals.chain import Chain
from gesture_core.skeletons import COCO18, HANDS42, skeleton
from gesture_core.testing.signals import draw_whole
from gesture_core.types import PoseSequence

WHOLE = skeleton("coco18+hands+face")
AT = {joint: place for place, joint in enumerate(WHOLE.joints)}
RIGHT = [AT[joint] for joint in HANDS42.joints[21:]]


def turned(pose: PoseSequence, joints: list[int], angle: float, size: float = 1.0) -> PoseSequence:
    """``pose`` with some joints turned and enlarged about the first of them."""
    points = pose.keypoints.astype(float)
    cos, sin = size * np.cos(angle), size * np.sin(angle)
    own = points[:, joints] - points[:, joints[:1]]
    points[:, joints] = points[:, joints[:1]] + own @ np.array([[cos, sin], [-sin, cos]])
    return replace(pose, keypoints=points)


@pytest.mark.parametrize("turn", ["hand", "forearm", "none"])
def test_a_hand_is_seen_from_its_wrist_in_its_own_size(turn: str) -> None:
    pose = draw_whole(WHOLE.name)
    normalizer = HandsNormalizer(turn=turn, steady=0.0, face=True)  # type: ignore[arg-type]
    plain = normalizer.normalize(pose)
    np.testing.assert_allclose(plain[:, RIGHT[0]], 0, atol=1e-9)
    palm = np.linalg.norm(plain[:, AT["right_middle_mcp"]], axis=1)
    assert 0.5 * PALM < np.median(palm) <= 1.01 * PALM
    larger = normalizer.normalize(turned(pose, RIGHT, 0.0, 1.8))
    np.testing.assert_allclose(larger, plain, atol=1e-4)
    other = normalizer.normalize(turned(pose, RIGHT, 0.7))
    same = np.allclose(other[:, RIGHT], plain[:, RIGHT], atol=1e-4)
    assert same == (turn == "hand")
    if turn == "forearm":
        arm = [AT["right_elbow"], AT["right_wrist"], *RIGHT]
        both = normalizer.normalize(turned(pose, arm, 0.7))
        np.testing.assert_allclose(both[:, RIGHT], plain[:, RIGHT], atol=1e-3)


def test_a_face_is_level_between_its_eyes() -> None:
    pose = draw_whole(WHOLE.name)
    face = [AT[joint] for joint in WHOLE.group("face")]
    one, other = (
        HandsNormalizer(face=True).normalize(p)[:, face] for p in (pose, turned(pose, face, 0.4, 1.5))
    )
    np.testing.assert_allclose(one, other, atol=1e-3)
    assert np.isfinite(one).all()


def test_the_body_is_that_of_the_torso() -> None:
    from gesture_signals.normalizers import TorsoNormalizer

    pose = draw_whole(WHOLE.name)
    body = HandsNormalizer(face=True).normalize(pose)[:, :18]
    np.testing.assert_array_equal(body, TorsoNormalizer(0.25, 0.2, 1.45).normalize(pose)[:, :18])


def test_hands_alone_take_the_place_of_a_body() -> None:
    pose = draw_whole(WHOLE.name)
    alone = PoseSequence(
        pose.keypoints[:, [AT[joint] for joint in HANDS42.joints]], np.ones((40, 42)), pose.times, "hands42"
    )
    signals = Chain.from_settings(load_settings("hands", environment={}))(alone)
    assert signals.present is not None
    there = {name for name, one in zip(signals.channels, signals.present, strict=True) if one}
    assert {"right_wrist_x.velocity", "hands_x.energy"} <= there and not any(
        "elbow" in name for name in there
    )
    with pytest.raises(PoseError, match="neither a neck nor a hand"):
        HandsNormalizer(face=True).normalize(replace(pose, keypoints=np.full_like(pose.keypoints, np.nan)))
    with pytest.raises(PoseError, match="plane"):
        HandsNormalizer(face=True).normalize(
            replace(pose, keypoints=np.dstack([pose.keypoints, pose.keypoints[..., :1]]))
        )


def test_one_hand_alone_takes_its_place_without_a_warning() -> None:
    points = np.random.default_rng(0).uniform(0, 30, (20, 21, 2)) + np.linspace(0, 100, 20)[:, None, None]
    alone = PoseSequence(points, np.ones((20, 21)), np.arange(20) / 20, "right_hand21")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        signals = Chain.from_settings(load_settings("hands", environment={}))(alone)
    assert np.isfinite(signals.values).all() and signals.values.any()


def test_fingers_have_one_warping() -> None:
    settings = load_settings("hands", ["hands.face=true"], environment={})
    signals = replace(Chain.from_settings(settings), filters=())(draw_whole(WHOLE.name))
    made = Parts({"fingers": 1.0, "fingers.bend": 1.0, "index_end": 1.0, "lips": 1.0}).apply(signals)
    found = parts(made.channels, settings)
    assert {part: len(channels) for part, channels in found.items()} == {
        "fingers": 20, "fingers.bend": 20, "index_end": 4, "lips": 2,
    }  # fmt: skip
    thumb = made.values[:, made.channels.index("left_fingers/thumb_x")]
    np.testing.assert_allclose(thumb, signals.values[:, signals.channels.index("left_thumb_tip_x")])
    bends = [made.channels.index(f"right_fingers/{f}_{a}.bend") for f in FINGERS for a in "xy"]
    np.testing.assert_allclose((made.values[:, bends] ** 2).sum(axis=1), 5, rtol=1e-5)
    with pytest.raises(ValueError, match="bend"):
        Parts({"palm.bend": 1.0})


def fist(pose: PoseSequence, side: str = "right") -> PoseSequence:
    """``pose`` with the fingertips of one hand at their knuckles."""
    points = pose.keypoints.copy()
    for finger in FINGERS[1:]:
        base = points[:, AT[f"{side}_{finger}_mcp"]]
        for place, far in (("pip", 0.3), ("dip", 0.2), ("tip", 0.1)):
            joint = AT[f"{side}_{finger}_{place}"]
            points[:, joint] = base + far * (points[:, joint] - base)
    return replace(pose, keypoints=points)


@pytest.mark.filterwarnings("ignore:examples .* are equal")
def test_what_differs_by_the_hand_alone_is_told_apart() -> None:
    """The same bodies with an open hand and with a fist; no person is among their own examples."""
    open_hands = [draw_whole(WHOLE.name, seed, ("wave", "swipe", "clap")[seed % 3]) for seed in range(14)]
    drawn, labels = [*open_hands, *map(fist, open_hands)], ["open"] * 14 + ["fist"] * 14
    rng = np.random.default_rng(0)
    noisy = [replace(p, keypoints=p.keypoints + rng.normal(scale=0.3, size=p.keypoints.shape)) for p in drawn]
    said = {}
    for preset, poses in (("modern", drawn), ("hands", noisy)):
        known = GestureClassifier(preset).fit(poses[:10] + poses[14:24], labels[:10] + labels[14:24])
        said[preset] = list(known.predict(poses[10:14] + poses[24:]))
    assert said["hands"] == ["open"] * 4 + ["fist"] * 4
    assert said["modern"][:4] == said["modern"][4:], "the bodies are the same"


def test_a_normalizer_of_hands_needs_hands() -> None:
    with pytest.raises(ConfigError, match="more than the body"):
        Chain.from_settings(load_settings("modern", ["signals.normalizer=hands"], environment={}))
    chain = Chain.from_settings(load_settings("modern", environment={}))
    assert chain.skeleton == COCO18.name
    whole, body = draw_whole(WHOLE.name), draw_whole(COCO18.name)
    np.testing.assert_array_equal(chain(whole).values, chain(body).values)
