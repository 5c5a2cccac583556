"""Bands by their formula are the bands of their definition, and cost no memory beside the series."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesture_core.dtw.bands import allowed_cells, has_holes, is_feasible, row_spans
from gesture_core.dtw.distances import warping_distances
from gesture_core.dtw.reference import accumulate
from gesture_core.dtw.spec import BandMask, DtwSpec

ROUNDING = 1e-9


def defined(n: int, m: int, spec: DtwSpec) -> np.ndarray:
    """(n, m) bool, each cell by the band's definition."""
    rows, columns = np.arange(n)[:, None], np.arange(m)[None, :]
    cells = np.ones((n, m), bool)
    if spec.window is not None:
        reach = spec.window if isinstance(spec.window, int) else np.ceil(spec.window * max(n, m) - ROUNDING)
        cells &= np.abs(rows * (m - 1) - columns * (n - 1)) <= reach * (min(n, m) - 1)
    if spec.shape == "itakura" and min(n, m) > 1:
        u, v = rows / (n - 1), columns / (m - 1)
        steep, flat = spec.max_slope, 1 / spec.max_slope
        cells &= (v <= steep * u + ROUNDING) & (v >= flat * u - ROUNDING)
        cells &= (1 - v <= steep * (1 - u) + ROUNDING) & (1 - v >= flat * (1 - u) - ROUNDING)
    if spec.mask is not None:
        mask = spec.mask.array()
        nearest = [
            np.rint(np.arange(size) * ((source - 1) / max(size - 1, 1))).astype(int)
            if size > 1
            else np.zeros(1, int)
            for size, source in zip((n, m), mask.shape, strict=True)
        ]
        cells &= mask[np.ix_(*nearest)]
    return cells


@st.composite
def bands(draw: st.DrawFn) -> DtwSpec:
    kind = draw(st.sampled_from(["radius", "share", "itakura", "both", "mask"]))
    if kind == "mask":
        shape = draw(st.tuples(st.integers(1, 8), st.integers(1, 8)))
        spans = [sorted(draw(st.tuples(*[st.integers(0, shape[1])] * 2))) for _ in range(shape[0])]
        column = np.arange(shape[1])
        return DtwSpec(mask=BandMask.of(np.array([(column >= a) & (column < b) for a, b in spans])))
    choices: dict[str, Any] = {}
    if kind in ("radius", "both"):
        choices["window"] = draw(st.integers(0, 60))
    if kind == "share":
        choices["window"] = draw(st.floats(0, 1))
    if kind in ("itakura", "both"):
        choices |= {"shape": "itakura", "max_slope": draw(st.sampled_from([1.01, 1.5, 2.0, 3.0, 17.3]))}
    return DtwSpec(**choices)


@settings(max_examples=400)
@given(st.integers(1, 40), st.lists(st.integers(1, 40), min_size=1, max_size=3), bands())
def test_the_formula_is_the_definition(n: int, lengths: list[int], spec: DtwSpec) -> None:
    low, high = row_spans(n, np.array(lengths), spec)
    feasible = is_feasible(n, np.array(lengths), spec)
    for k, m in enumerate(lengths):
        cells = defined(n, m, spec)
        column = np.arange(m)
        assert ((column >= low[k][:, None]) & (column < high[k][:, None]) == cells).all()
        assert (allowed_cells(n, m, spec) == cells).all()
        table = accumulate(np.ones((n, m)), cells, 0.0)
        assert feasible[k] == np.isfinite(table[-1, -1])


def test_a_mask_with_holes_has_no_intervals() -> None:
    holes = np.array([[True, True, True], [True, False, True], [True, True, True]])
    spec = DtwSpec(mask=BandMask.of(holes))
    assert has_holes(spec) and not has_holes(DtwSpec(mask=BandMask.of(~holes | np.eye(3, dtype=bool))))
    assert (allowed_cells(3, 3, spec) == holes).all()


@pytest.mark.parametrize("kernel", ["numpy", "auto"])
@pytest.mark.parametrize("band", [{"window": 10}, {"shape": "itakura"}], ids=str)
def test_a_band_takes_no_memory_of_its_own(kernel: str, band: dict[str, Any]) -> None:
    x, y, spec = np.zeros(3000), np.ones(3001), DtwSpec(**band)
    warping_distances([x[:300]], [y[:300]], spec, kernel)  # compiles
    tracemalloc.start()
    try:
        assert np.isfinite(warping_distances([x], [y], spec, kernel)).all()
        assert tracemalloc.get_traced_memory()[1] < 4 << 20  # a table of truth values alone has 9 MB
    finally:
        tracemalloc.stop()


def test_bands_of_many_lengths_are_not_kept() -> None:
    rng = np.random.default_rng(0)
    series = [rng.normal(size=n).astype(np.float32) for n in range(600, 640)]
    spec = DtwSpec(window=0.1)
    warping_distances(series[:2], series[:2], spec)
    tracemalloc.start()
    try:
        warping_distances(series, series, spec)
        assert tracemalloc.get_traced_memory()[0] < 1 << 20
    finally:
        tracemalloc.stop()
