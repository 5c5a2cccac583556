"""Built-in filters against SciPy and against what their definitions say."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import J, pose, standing, waving
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from gesture_core.errors import ConfigError, SignalError
from gesture_core.plugin import registry
from gesture_core.settings import load_settings
from gesture_core.signals.chain import CHANNELS, Chain
from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals


def make(name: str, **options: object):  # type: ignore[no-untyped-def]
    return registry().make("filter", name, options)


def body_signals(points: np.ndarray, fps: float = 25.0) -> Signals:
    """Normalised signals without any filter."""
    sets = [("signals.normalizer", "torso"), ("signals.selector", "all"), ("signals.filters", ())]
    return Chain.from_settings(load_settings("paper", environment={}).with_values(sets))(pose(points, fps))


def simple(values: list[float] | np.ndarray, fps: float = 10.0) -> Signals:
    column = np.asarray(values, float)[:, None]
    return Signals(column, np.arange(len(column)) / fps, ("right_wrist_x",))


def test_gaussian_is_scipys() -> None:
    values = np.random.default_rng(0).normal(size=30)
    expected = gaussian_filter1d(np.float32(values).astype(float), 1.0)
    np.testing.assert_allclose(make("gaussian").apply(simple(values)).values[:, 0], expected, atol=1e-6)


def test_gaussian_in_seconds_does_not_depend_on_the_frame_rate() -> None:
    slow, fast = np.sin(np.arange(20) / 5), np.sin(np.arange(77) / 20)
    smooth = make("gaussian", seconds=0.2)
    a = smooth.apply(simple(slow, 10)).values[5:15, 0]
    b = smooth.apply(simple(fast, 40)).values[20:60:4, 0]
    np.testing.assert_allclose(a, b, atol=0.02)


def test_median_takes_out_a_spike() -> None:
    values = np.zeros(20)
    values[[0, 9, 10, 19]] = 7
    assert not make("median", radius=3).apply(simple(values)).values.any()


@given(st.lists(st.floats(-10, 10), min_size=1, max_size=20), st.floats(0, 1))
def test_center_subtracts_its_share_of_the_mean(values: list[float], share: float) -> None:
    found = make("center", share=share).apply(simple(values)).values
    mean = np.array(values, np.float32).mean(dtype=float)
    assert found.mean(dtype=float) == pytest.approx((1 - share) * mean, abs=1e-5)


@given(st.integers(2, 40), st.sampled_from([5.0, 20.0, 50.0]))
def test_resample_keeps_ends_and_duration(frames: int, rate: float) -> None:
    source = simple(np.arange(frames, dtype=float))
    found = make("resample", rate=rate).apply(source)
    assert found.values[0, 0] == source.values[0, 0]
    assert found.values[-1, 0] == source.values[-1, 0]
    assert found.times[-1] == source.times[-1]
    assert abs(len(found) - ((frames - 1) / 10 * rate + 1)) <= 1
    np.testing.assert_allclose(found.values[:, 0], found.times * 10, atol=1e-4)


def test_resample_of_a_single_frame_and_of_an_absurd_clock() -> None:
    one = Signals(np.ones((1, 1)), np.zeros(1), ("x",))
    assert make("resample").apply(one) is one
    absurd = Signals(np.ones((2, 1)), np.array([0.0, 1e12]), ("x",))
    assert make("resample").apply(absurd) is absurd
    hours = Signals(np.zeros((150, 2)), np.arange(150.0), ("x", "y"))
    assert len(make("resample", max_frames=200, rate=5.0).apply(hours)) == 149 * 5 + 1


def test_parts_are_vectors_scaled_by_the_root_of_their_weight() -> None:
    source = body_signals(waving())
    found = make("parts", weights={"forearm": 4.0, "nose": 1.0}).apply(source)
    assert found.channels == (
        "right_forearm_x", "right_forearm_y", "left_forearm_x", "left_forearm_y", "nose_x", "nose_y",
    )  # fmt: skip
    places = [CHANNELS.index(n) for n in ("right_wrist_y", "right_elbow_y")]
    expected = 2 * (source.values[:, places[0]] - source.values[:, places[1]])
    np.testing.assert_allclose(found.values[:, 1], expected, atol=1e-6)


def test_velocity_is_in_body_lengths_per_tenth_of_a_second() -> None:
    points = standing(26)
    points[:, J["left_wrist"], 0] += np.linspace(0, 110, 26)  # one torso length in one second
    found = make("parts", weights={"wrist.velocity": 1.0}).apply(body_signals(points))
    np.testing.assert_allclose(found.values[:, 2], 0.1, atol=1e-4)


def test_turning_tells_clockwise_from_counter_clockwise() -> None:
    angle = np.linspace(0, 6 * np.pi, 75)
    points = standing(75)
    points[:, J["right_wrist"]] += 40 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    backwards = points[::-1].copy()
    step = make("parts", weights={"wrist.turning": 1.0})
    one, other = step.apply(body_signals(points)), step.apply(body_signals(backwards))
    assert one.channels == ("right_wrist.turning", "left_wrist.turning")
    assert (one.values[10:-10, 0] > 0).all()
    assert (other.values[10:-10, 0] < 0).all()


def test_energy_does_not_depend_on_the_phase_of_a_wave() -> None:
    angle = np.linspace(0, 10 * np.pi, 100)
    step = make("parts", weights={"wrist.energy": 1.0}, window=0.3)
    found = []
    for phase in (0.0, 1.3):
        points = standing(100)
        points[:, J["right_wrist"], 0] += 40 * np.sin(angle + phase)
        found.append(step.apply(body_signals(points)).values[25:-25, 0])
    assert np.ptp(found) < 0.15 * np.mean(found)


def test_the_elbow_bends() -> None:
    points = standing(5)
    points[:, J["right_wrist"]] = 2 * points[:, J["right_elbow"]] - points[:, J["right_shoulder"]]
    upper = points[:, J["left_elbow"]] - points[:, J["left_shoulder"]]
    points[:, J["left_wrist"]] = points[:, J["left_elbow"]] + upper[:, ::-1] * (-1, 1)
    found = make("parts", weights={"arm.bend": 1.0}).apply(body_signals(points))
    assert found.channels[:2] == ("right_arm_x.bend", "right_arm_y.bend")
    np.testing.assert_allclose(found.values[0], [0, 1, 1, 0], atol=1e-5)


def test_a_mirror_does_the_same_before_and_after_parts() -> None:
    kinds = ("", ".direction", ".velocity", ".energy", ".spread", ".turning")
    names = [f"{part}{kind}" for part in ("wrist", "forearm", "hands") for kind in kinds]
    step = make("parts", weights=dict.fromkeys([*names, "arm.bend", "nose@0.5"], 1.0))
    points = waving("right_wrist", 2) + np.random.default_rng(0).normal(0, 3, (1, 18, 2))
    signals = body_signals(points)
    one, other = mirrored(step.apply(signals)), step.apply(mirrored(signals))
    assert one.channels == other.channels
    np.testing.assert_allclose(one.values, other.values, atol=1e-5)


@given(st.integers(20, 201))
@settings(max_examples=20, deadline=None)
def test_parts_do_not_depend_on_the_frame_rate_after_resampling(frames: int) -> None:
    weights = {"wrist": 1.0, "forearm.energy": 1.0, "wrist.velocity": 1.0, "forearm.turning": 1.0}
    found = []
    for count in (51, frames):  # the same two seconds, seen with more or fewer frames
        points = waving("right_wrist", 2, frames=count)
        signals = make("resample", rate=20.0).apply(body_signals(points, (count - 1) / 2))
        found.append(make("parts", weights=weights).apply(signals).values)
    assert len(found[0]) == len(found[1])
    assert np.abs(found[0] - found[1]).max() < 0.06


def test_a_limb_without_one_of_its_joints_is_not_present() -> None:
    points = waving()
    points[:, J["left_elbow"]] = np.nan
    found = make("parts", weights={"forearm": 1.0, "wrist": 1.0}).apply(body_signals(points))
    assert found.present.tolist() == [True, True, False, False, True, True, True, True]


def test_parts_need_the_joints_channels() -> None:
    with pytest.raises(SignalError) as caught:
        make("parts").apply(simple([1, 2, 3]))
    assert caught.value.code == "E_SIGNAL_CHANNELS"


@pytest.mark.parametrize(
    "text", ["wing", "wrist.colour", "wrist@2", "wrist@", "wrist energy", "wrist.bend", ""]
)
def test_unknown_parts_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="E_OPTION"):
        make("parts", weights={text: 1.0})


@pytest.mark.parametrize(
    ("kind", "name", "options"),
    [
        ("filter", "parts", {"weights": 3}),
        ("filter", "parts", {"weights": {"wrist": 0.0}}),
        ("filter", "resample", {"max_frames": -1}),
        ("filter", "median", {"radius": 1.5}),
        ("selector", "moving", {"median_radius": 1.5}),
        ("selector", "variance", {"median_radius": 1.5}),
    ],
)
def test_options_that_no_signal_could_be_made_with_are_refused(
    kind: str, name: str, options: dict[str, object]
) -> None:
    with pytest.raises(ConfigError, match="E_OPTION"):
        registry().make(kind, name, options)


@pytest.mark.parametrize("step", [1e-9, 1e-13])
def test_an_absurd_clock_costs_no_memory(step: float) -> None:
    names = [f"wrist.{kind}" for kind in ("energy", "spread", "turning")]
    source = body_signals(waving(frames=30), 1 / step)
    for name, options in (
        ("gaussian", {"seconds": 0.033}),
        ("parts", {"weights": dict.fromkeys(names, 1e-30)}),
    ):
        assert np.isfinite(make(name, **options).apply(source).values).all()


def test_a_very_wide_average_is_the_mean() -> None:
    values = np.random.default_rng(0).normal(size=20)
    wide = make("gaussian", sigma=1e12).apply(simple(values)).values[:, 0]
    np.testing.assert_allclose(wide, values.mean(), atol=1e-4)


def test_selection_is_the_population_variance_after_a_median() -> None:
    values = np.tile([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0], 4)
    selector = registry().make("selector", "variance", {"t_var": 0.2, "median_radius": 1})
    assert selector.select(simple(values)).tolist() == [True]
    strict = registry().make("selector", "variance", {"t_var": 0.26, "median_radius": 1})
    assert strict.select(simple(values)).tolist() == [False]
