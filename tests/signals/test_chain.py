"""The chain as a whole: what comes out, and what it refuses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from bodies import J, pose, standing, waving
from hypothesis import given, settings
from hypothesis import strategies as st

from gesture_core import GestureClassifier
from gesture_core.errors import ConfigError, GestureError, PluginError, PoseError, SignalError
from gesture_core.joints import other_side
from gesture_core.plugin import registry
from gesture_core.settings import load_settings, presets
from gesture_core.signals.chain import CHANNELS, Chain
from gesture_core.signals.mirror import mirrored
from gesture_core.types import PoseSequence, Signals

OF_PEOPLE = sorted(set(presets()) - {"sensors", "depth"})
"""Presets whose inputs have joints in the plane."""


def chain(preset: str = "paper", dotted: Mapping[str, object] | None = None, **values: object) -> Chain:
    pairs = [*(dotted or {}).items(), *((key.replace("__", "."), value) for key, value in values.items())]
    return Chain.from_settings(load_settings(preset, environment={}).with_values(pairs))


def test_the_paper_selects_the_wrist_that_moves_and_centres_it() -> None:
    signals = chain()(pose(waving()))
    assert signals.channels == CHANNELS
    assert signals.selected == ("right_wrist_y",)
    np.testing.assert_allclose(signals.values.mean(axis=0), 0, atol=1e-5)


def test_a_person_who_stands_still_makes_no_gesture() -> None:
    with pytest.raises(SignalError) as caught:
        chain()(pose(standing()))
    assert caught.value.code == "E_NO_SALIENT"
    assert "t_var" in caught.value.remedy
    still = replace(chain(), allow_still=True)(pose(standing()))
    assert still.selected == ()


def test_a_single_wild_frame_is_not_motion() -> None:
    points = standing()
    points[20, J["left_wrist"]] += 4000
    with pytest.raises(SignalError, match="E_NO_SALIENT"):
        chain()(pose(points))


@pytest.mark.parametrize("preset", OF_PEOPLE)
@given(shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500)), factor=st.floats(0.2, 5))
@settings(max_examples=15, deadline=None)
def test_place_and_size_in_the_picture_do_not_matter(
    preset: str, shift: tuple[float, float], factor: float
) -> None:
    whole = chain(preset)
    moved = whole(pose(waving() * factor + np.array(shift)))
    np.testing.assert_allclose(moved.values, whole(pose(waving())).values, atol=2e-3)


@pytest.mark.parametrize("preset", OF_PEOPLE)
def test_the_other_hand_is_the_mirror_of_the_signals(preset: str) -> None:
    points = waving("right_wrist", 2) + 0.4 * (waving("right_elbow", 1, axis=0) - standing())
    flipped = (points - 300)[:, list(_mirror_order())] * (-1, 1) + 300
    whole = chain(preset)
    expected, found = whole(pose(flipped)), mirrored(whole(pose(points)))
    assert found.channels == expected.channels
    np.testing.assert_allclose(found.values, expected.values, atol=1e-5)
    np.testing.assert_array_equal(found.mask, expected.mask)
    again = mirrored(mirrored(expected))
    np.testing.assert_array_equal(again.values, expected.values)


def _mirror_order() -> tuple[int, ...]:
    from gesture_core.skeletons import COCO18

    return COCO18.mirror


@pytest.mark.parametrize("preset", OF_PEOPLE)
def test_a_missing_joint_has_no_channel_and_no_influence(preset: str) -> None:
    points = waving()
    points[:, J["left_wrist"]] = np.nan
    without = chain(preset)(pose(points))
    lost = [i for i, name in enumerate(without.channels) if "left_wrist" in name]
    assert lost
    assert without.present is not None and not without.present[lost].any()
    assert not without.values[:, lost].any()


def test_zero_width_shoulders_never_become_a_scale() -> None:
    points = waving()
    points[:, J["left_shoulder"]] = points[:, J["right_shoulder"]]
    with pytest.raises(PoseError) as caught:
        chain()(pose(points))
    assert caught.value.code == "E_POSE_SCALE"
    assert caught.value.subject == "clip"


def test_frames_with_collapsed_shoulders_are_gaps() -> None:
    points = waving()
    whole = chain()(pose(points)).values
    points[10:12, J["left_shoulder"]] = points[10:12, J["right_shoulder"]] + 0.5
    damaged = chain()(pose(points))
    assert np.abs(damaged.values - whole).max() < 0.2


@pytest.mark.parametrize("normalizer", ["torso", "upright"])
def test_without_hips_the_shoulders_serve_only_where_that_was_asked_for(normalizer: str) -> None:
    points = waving()
    points[:, [J["left_hip"], J["right_hip"]]] = np.nan
    chosen: dict[str, object] = {"signals.normalizer": normalizer, "variance.t_var": 0.01}
    with pytest.raises(PoseError, match="E_POSE_SCALE"):
        chain("paper", {**chosen, f"{normalizer}.shoulders": 0.0})(pose(points))
    signals = chain("paper", {**chosen, f"{normalizer}.shoulders": 1.5})(pose(points))
    assert "right_wrist_y" in signals.selected


@pytest.mark.parametrize("normalizer", ["shoulder", "torso", "upright"])
def test_without_a_neck_the_reason_is_not_that_nothing_moves(normalizer: str) -> None:
    points = waving()
    points[:, J["neck"]] = np.nan
    with pytest.raises(PoseError, match=r"E_POSE_SCALE clip: the .*neck.* is missing, .*seen too seldom"):
        chain(signals__normalizer=normalizer)(pose(points))


def test_a_normalizer_that_leaves_no_joint_leaves_no_signals() -> None:
    class Seldom:
        def normalize(self, pose: PoseSequence) -> np.ndarray:
            return np.where(np.arange(len(pose))[:, None, None] % 3 == 0, pose.keypoints, np.nan)

    with pytest.raises(PoseError, match="E_POSE_SPARSE clip: no joint has a place in 50% of the frames"):
        replace(chain("modern"), normalizer=Seldom())(pose(waving()))


@given(st.floats(-180, 180))
@settings(max_examples=20, deadline=None)
def test_upright_undoes_the_roll_of_the_camera(degrees: float) -> None:
    turn = np.radians(degrees)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    upright = chain(signals__normalizer="upright", variance__t_var=0.02)
    level = upright(pose(waving())).values
    np.testing.assert_allclose(upright(pose(waving() @ matrix.T)).values, level, atol=1e-3)


def test_nobody_is_sparse() -> None:
    points = np.full((30, 18, 2), np.nan)
    with pytest.raises(PoseError, match="E_POSE_SPARSE"):
        chain()(pose(points))


def test_no_frames_at_all() -> None:
    with pytest.raises(PoseError, match="E_POSE_SHORT"):
        chain()(PoseSequence(np.empty((0, 18, 2)), np.empty((0, 18)), np.empty(0)))


@given(st.integers(0, 12), st.floats(0, 1), st.sampled_from(OF_PEOPLE), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_any_keypoints_give_finite_signals_or_a_typed_error(
    frames: int, missing: float, preset: str, seed: int
) -> None:
    random = np.random.default_rng(seed)
    points = random.normal(0, 10.0 ** random.integers(-6, 7), (frames, 18, 2))
    points[random.random((frames, 18)) < missing] = np.nan
    times = np.sort(random.integers(0, 5, frames)) / 10
    try:
        signals = chain(preset)(PoseSequence(points, np.ones((frames, 18)), times))
    except GestureError as error:
        assert error.code.startswith("E_")
    else:
        assert np.isfinite(signals.values).all()


def test_a_plugin_that_breaks_its_contract_is_named() -> None:
    class Raises:
        def normalize(self, pose: PoseSequence) -> np.ndarray:
            raise ZeroDivisionError("no")

    class Short:
        def select(self, signals: Signals) -> np.ndarray:
            return np.ones(3, bool)

    class Nothing:
        def apply(self, signals: Signals) -> None:
            return None

    whole = chain()
    for broken, word in (
        (replace(whole, normalizer=Raises()), "Raises raised ZeroDivisionError"),
        (replace(whole, selector=Short()), "Short returned a mask of shape (3,)"),
        (
            replace(whole, filters=(Nothing(),)),  # type: ignore[arg-type]
            "Nothing returned NoneType",
        ),
    ):
        with pytest.raises(PluginError) as caught:
            broken(pose(waving()))
        assert word in str(caught.value)


def test_a_step_may_be_named_twice_with_its_own_options() -> None:
    settings = load_settings("paper", environment={})
    settings = replace(
        settings,
        signals=replace(settings.signals, filters=("gaussian", "gaussian:wide", "center")),
        options={**settings.options, "gaussian:wide": {"sigma": 5.0}},
    )
    widths = [getattr(step, "sigma", None) for step in Chain.from_settings(settings).filters]
    assert widths == [1.0, 5.0, None]


def test_unknown_steps_and_options_are_refused() -> None:
    with pytest.raises(PluginError, match="did you mean gaussian"):
        chain(signals__filters=("gausian",))
    with pytest.raises(ConfigError, match="E_OPTION"):
        chain(gaussian__sigma=-1)


@pytest.mark.parametrize("name", registry().names("filter", usable=True))
def test_every_filter_keeps_signals_valid(name: str) -> None:
    source = replace(chain(signals__filters=()), allow_still=True)(pose(waving()))
    found = registry().make("filter", name).apply(source)
    assert isinstance(found, Signals)
    assert np.isfinite(found.values).all()
    assert len(found.times) == len(found.values)
    assert found.mask is not None and found.present is not None
    assert found.mask.shape == found.present.shape == (len(found.channels),)


def turned(points: np.ndarray, degrees: float) -> np.ndarray:
    """(T, 18, 3) of a body in the plane, around the axis that points down."""
    angle = np.radians(degrees)
    across, depth = points[..., 0] - 300, 0.3 * (points[..., 1] - 300)
    sides = [np.cos(angle), np.sin(angle)] @ np.stack([across, depth], axis=-2)
    other = [-np.sin(angle), np.cos(angle)] @ np.stack([across, depth], axis=-2)
    return np.stack([sides, points[..., 1], other], axis=-1)


@pytest.mark.parametrize("degrees", [0, 40, 120, 180])
def test_in_three_dimensions_a_turn_of_the_body_does_not_matter(degrees: float) -> None:
    whole = chain("depth")
    one, other = whole(pose(turned(waving(), 0))), whole(pose(turned(waving(), degrees)))
    assert "right_wrist_z.velocity" in one.channels and "right_forearm_x.turning" in one.channels
    np.testing.assert_allclose(one.values, other.values, atol=2e-3)


def test_in_three_dimensions_a_mirror_is_the_other_hand() -> None:
    whole, points = chain("depth"), turned(waving("right_wrist", axis=0), 0)
    sides = [J[other_side(name)] for name in J]
    other = whole(pose(points[:, sides] * [-1, 1, 1]))
    found = mirrored(whole(pose(points)))
    np.testing.assert_allclose(found.values, other.values, atol=2e-3)


def test_what_needs_a_depth_says_so() -> None:
    with pytest.raises(PoseError, match="has no depth"):
        chain("depth")(pose(waving()))


def posture(arm: float, seed: int) -> PoseSequence:
    """A body whose right arm is held at an angle, in one frame."""
    points = standing(1)
    shoulder = points[0, J["right_shoulder"]]
    way = np.array([-np.sin(np.radians(arm)), np.cos(np.radians(arm))])
    points[0, J["right_elbow"]], points[0, J["right_wrist"]] = shoulder + 60 * way, shoulder + 115 * way
    points += np.random.default_rng(seed).normal(0, 2, points.shape)
    return PoseSequence(points, np.ones(points.shape[:2]), np.zeros(1), source=f"{arm} {seed}")


def test_postures_of_one_frame_are_told_apart() -> None:
    angles = {"down": 5.0, "side": 90.0, "up": 170.0}
    X = [posture(angle, n) for angle in angles.values() for n in range(2)]
    y = [name for name in angles for _ in range(2)]
    fitted = GestureClassifier("pose").fit(X, y)
    found = fitted.predict([posture(angle, 7) for angle in angles.values()])
    assert found.tolist() == list(angles)
