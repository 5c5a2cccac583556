"""A specification means what it says: types are told apart, and what cannot be meant is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gesture_core.dtw import (
    DtwSpec,
    barycenter,
    nearest,
    soft_divergence,
    soft_warping,
    soft_warping_gradient,
    warping_distance,
    warping_distances,
    warping_path,
)
from gesture_core.dtw.bands import row_spans
from gesture_core.dtw.reference import reference_distance
from gesture_core.errors import ConfigError


@pytest.mark.parametrize("order", [(1, 1.0), (1.0, 1), (0, 0.0), (0.0, 0)])
def test_a_radius_of_one_frame_is_not_the_whole_table(order: tuple[float, float]) -> None:
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, 9, 1)).cumsum(axis=1)
    for window in order:
        spec = DtwSpec(window=window)
        inside = [
            np.abs(i - j) <= window * (9 if isinstance(window, float) else 1) for i, j in np.ndindex(9, 9)
        ]
        low, high = row_spans(9, np.array([9]), spec)
        assert (high - low).sum() == sum(inside)
        assert warping_distances([x], [y], spec)[0, 0] == pytest.approx(reference_distance(x, y, spec))
    first, second = (DtwSpec(window=window) for window in order)
    assert first != second and len({first, second}) == 2 and first == first.replace()


@pytest.mark.parametrize("window", [np.int64(1), np.int8(2), np.uint16(3), np.float32(0.5), np.float64(0.25)])
def test_numbers_of_numpy_are_numbers(window: Any) -> None:
    numbers: dict[str, Any] = {"gamma": np.float32(0.5), "max_slope": np.int64(3), "root": np.bool_(False)}
    spec = DtwSpec(window=window, **numbers)
    assert spec == DtwSpec(window=window.item(), gamma=0.5, max_slope=3.0)
    assert [type(v) for v in (spec.window, spec.gamma, spec.root)] == [type(window.item()), float, bool]


@pytest.mark.parametrize(
    "wrong",
    [
        {"window": "0.1"},
        {"window": True},
        {"window": -1},
        {"window": 1.5},
        {"window": float("nan")},
        {"window": np.array([1, 2])},
        {"gamma": "1"},
        {"gamma": 0},
        {"gamma": float("inf")},
        {"gamma": 1e-320},
        {"gamma": 1e40},
        {"root": "no"},
        {"root": 1},
        {"length_norm": None},
        {"max_slope": "2"},
        {"max_slope": 1},
        {"max_slope": float("inf")},
        {"mode": 3},
        {"cost": np.array(["absolute", "squared"])},
        {"weights": 3},
        {"weights": ("a",)},
        {"weights": (-1.0,)},
        {"mask": [[True, False], [True]]},
        {"mask": "band"},
    ],
    ids=str,
)
def test_what_cannot_be_meant_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=f"E_OPTION dtw.{next(iter(wrong))}"):
        DtwSpec(**wrong)


@pytest.mark.parametrize("gamma", [1e-300, 1e30])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_outermost_softnesses_give_numbers(gamma: float, dtype: type) -> None:
    series: list[np.ndarray] = [np.array([0.0, 1, 3], dtype), np.array([0.0, 2, 2, 1], dtype)]
    spec = DtwSpec(gamma=gamma)
    assert np.isfinite(warping_distances(series, series, spec)).all()


def test_a_specification_is_one() -> None:
    one, series, spec = np.zeros(3), [np.zeros(3)], {"cost": "squared"}
    calls: tuple[Callable[..., object], ...]
    call: Callable[..., object]
    calls = (warping_distances, nearest, soft_warping, soft_warping_gradient, soft_divergence)
    for call in calls:
        with pytest.raises(ConfigError, match="E_OPTION"):
            call(series, series, spec=spec)
    calls = (warping_distance, warping_path)
    for call in calls:
        with pytest.raises(ConfigError, match="E_OPTION"):
            call(one, one, spec=spec)
    with pytest.raises(ConfigError, match="E_OPTION"):
        barycenter(series, spec)  # type: ignore[arg-type]
