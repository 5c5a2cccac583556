"""Distances measured by the size of the movements, and one warping for each body part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from gesture_core.classify.comparison import Extents, compare, divided, pair_sizes, parts
from gesture_core.classify.examples import ExampleLibrary
from gesture_core.classify.explanation import align
from gesture_core.dtw.reference import reference_distance
from gesture_core.errors import ConfigError
from gesture_core.settings import Settings, load_settings
from gesture_core.types import Signals

CHANNELS = ("right_wrist_x", "left_wrist_x", "right_wrist_x.energy", "nose_y@0.5")


def some(seed: int, count: int, size: float = 1.0) -> list[Signals]:
    """Sequences of which not every channel is present or salient."""
    random = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        frames = int(random.integers(1, 9))
        masks = random.random((2, 4)) < 0.7
        values = size * random.normal(size=(frames, 4))
        out.append(Signals(values, np.arange(frames), CHANNELS, mask=masks[0], present=masks[1]))
    return out


def under(**values: object) -> Settings:
    settings = load_settings("modern", environment={})
    plain = {"mirror": None, "coverage": False, "separate": False, "relative": None, "rest": 0.0}
    settings = replace(settings, signals=replace(settings.signals, still="refuse"))
    return replace(settings, classify=replace(settings.classify, kernel="numpy", **{**plain, **values}))  # type: ignore[arg-type]


def used(x: Signals, y: Signals) -> np.ndarray:
    masks: np.ndarray = np.asarray(x.mask) | np.asarray(y.mask)
    masks &= np.asarray(x.present) & np.asarray(y.present)
    return masks


def size(x: Signals, channels: np.ndarray, rest: float) -> float:
    return float((x.values[:, channels].astype(float) ** 2).sum() + rest * len(x))


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.5]))
@hypothesis_settings(max_examples=40, deadline=None)
def test_sizes_are_those_of_the_common_channels(seed: int, rest: float) -> None:
    queries, examples = some(seed, 3), some(seed + 1, 2)
    sizes, shares = pair_sizes(Extents.of(queries), Extents.of(examples), rest)
    every = np.ones(4, bool)
    for i, x in enumerate(queries):
        for j, y in enumerate(examples):
            channels = used(x, y)
            expected = np.sqrt(size(x, channels, rest) * size(y, channels, rest))
            np.testing.assert_allclose(sizes[i, j], expected, atol=1e-6)
            whole = np.sqrt(size(x, every, rest) * size(y, every, rest))
            np.testing.assert_allclose(shares[i, j], expected / whole if whole else 0, atol=1e-6)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["sum", "mean"]))
@hypothesis_settings(max_examples=40, deadline=None)
def test_separate_warpings_add_up(seed: int, reduce: str) -> None:
    (x,), (y,) = some(seed, 1), some(seed + 1, 1)
    settings = under(separate=True)
    settings = replace(settings, dtw=settings.dtw.replace(reduce=reduce))
    spec = settings.dtw.replace(reduce="sum")
    found = compare([x], [y], settings)[0, 0]
    channels = used(x, y)
    if not channels.any():
        assert found == np.inf
        return
    expected = 0.0
    for part in ([0, 1], [2], [3]):  # wrist, wrist.energy, nose@0.5
        mask = np.zeros(4, bool)
        mask[part] = channels[part]
        expected += reference_distance(x.values, y.values, spec, mask) if mask.any() else 0.0
    assert found == pytest.approx(expected / (channels.sum() if reduce == "mean" else 1), rel=1e-4)


def test_parts_are_told_by_names() -> None:
    modern, sensors = (load_settings(name, environment={}) for name in ("modern", "sensors"))
    assert parts(CHANNELS, modern) == {"wrist": [0, 1], "wrist.energy": [2], "nose@0.5": [3]}
    others = ("left_forearm.turning", "right_elbow_y@1", "right_upper_arm_x.direction@0.5")
    assert list(parts(others, modern)) == ["forearm.turning", "elbow@1", "upper_arm.direction@0.5"]
    watches = ("left_acc/x[g]", "right_acc/x[g]", "left_acc/y[g]", "left_acc/x[g].velocity")
    assert parts(watches, sensors) == {"left_acc": [0, 2], "right_acc": [1], "left_acc.velocity": [3]}


@pytest.mark.parametrize("separate", [False, True])
def test_a_relative_distance_does_not_know_how_large_the_movements_are(separate: bool) -> None:
    small, large = some(3, 4), some(3, 4, size=7.0)
    settings = under(separate=separate, relative=1.0, coverage=True)
    found = compare(small, small, settings)
    np.testing.assert_allclose(compare(large, large, settings), found, rtol=1e-4, atol=1e-6)
    half = under(separate=separate, relative=0.5)
    finite = np.isfinite(found) & (found > 0)
    ratio = compare(large, large, half)[finite] / compare(small, small, half)[finite]
    np.testing.assert_allclose(ratio, 7.0, rtol=1e-4)


def test_nothing_is_not_far_from_nothing() -> None:
    assert divided(np.array([0.0, 2.0, 3.0, np.inf]), np.array([0.0, 0.0, 1.5, 1.0])).tolist() == [
        0.0, np.inf, 2.0, np.inf,
    ]  # fmt: skip
    still = [Signals(np.zeros((3, 4)), np.arange(3), CHANNELS)]
    assert compare(still, still, under(relative=1.0)).tolist() == [[0.0]]


@given(st.integers(0, 2**32 - 1), st.booleans(), st.booleans(), st.sampled_from([None, 0.5, 1.0]))
@hypothesis_settings(max_examples=40, deadline=None)
def test_explanations_add_up_to_what_was_compared(
    seed: int, separate: bool, coverage: bool, relative: float | None
) -> None:
    (x,), (y,) = some(seed, 1), some(seed + 1, 1)
    settings = under(separate=separate, coverage=coverage, relative=relative, rest=0.1)
    distance = compare([x], [y], settings)[0, 0]
    found = align(x, ExampleLibrary((y,), ("a",), ("y",)), 0, settings)
    np.testing.assert_array_equal(found.used, used(x, y))
    assert found.distance == pytest.approx(distance, rel=1e-4)
    if np.isfinite(distance):
        assert found.costs.sum() == pytest.approx(distance, rel=1e-4)
    for channel in np.flatnonzero(found.used):
        assert found.path_of(int(channel))[-1].tolist() == [len(x) - 1, len(y) - 1]


@pytest.mark.parametrize(
    "factor",
    [{"neighbors": 0}, {"classifier": "blend"}, {"mirror": 1.1}, {"coverage": True}, {"relative": 1.0}, {}],
)
def test_soft_distances_may_be_negative_and_take_no_factor(factor: dict[str, object]) -> None:
    settings = under(**{"neighbors": 1, **factor})
    settings = replace(settings, dtw=settings.dtw.replace(gamma=1.0))
    if not factor:
        assert compare(some(1, 1), some(1, 1), settings)[0, 0] < 0
        return
    with pytest.raises(ConfigError, match=f"gamma=none, or --set classify.{next(iter(factor))}="):
        compare(some(1, 1), some(1, 1), settings)


@pytest.mark.parametrize("separate", [False, True])
@pytest.mark.parametrize("count", [2, 5])
def test_weights_are_as_many_as_channels(separate: bool, count: int) -> None:
    settings = under(separate=separate)
    settings = replace(settings, dtw=settings.dtw.replace(weights=(1.0,) * count))
    with pytest.raises(ConfigError, match=f"{count} weights for series of 4 dimensions"):
        compare(some(1, 1), some(2, 1), settings)


@pytest.mark.parametrize("text", ["classify.relative=2", "classify.rest=-1", "classify.separate=maybe"])
def test_wrong_values_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"classify\."):
        load_settings("modern", [text], environment={})
