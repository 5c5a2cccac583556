"""Which cells a warping path may visit: Sakoe-Chiba, Itakura, or any boolean mask.

A band is defined once, as a boolean (n, m) array; kernels take it as one column interval for each
row, which every band but a mask with holes is.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import WarpingError

_ROUNDING = 1e-9


def radius(n: int, m: int, window: int | float) -> int:
    """Frames of the longer series that a path may leave the diagonal by.

    A fraction is of the longer length and rounds up, as the UCR archive's published windows do.
    """
    if isinstance(window, int):
        return window
    return int(np.ceil(window * max(n, m) - _ROUNDING))


def is_banded(spec: DtwSpec) -> bool:
    """Whether ``spec`` forbids any cell."""
    return spec.window is not None or spec.shape == "itakura" or spec.mask is not None


@lru_cache(maxsize=4096)
def allowed_cells(n: int, m: int, spec: DtwSpec) -> np.ndarray:
    """(n, m) bool, read-only: cells that a path between lengths ``n`` and ``m`` may visit.

    Sakoe and Chiba (1978): at most the radius away from the line between the two corners, measured
    along the longer series, so that the band is the same whichever series is the query. Itakura
    (1975): slopes from both corners between ``1 / max_slope`` and ``max_slope``, relative to that
    line. A mask of another shape is stretched to (n, m) by its nearest cells.
    """
    rows = np.arange(n)[:, None]
    columns = np.arange(m)[None, :]
    cells = np.ones((n, m), bool)
    if spec.mask is not None:
        mask = spec.mask.array()
        cells &= mask[_nearest(n, mask.shape[0])[:, None], _nearest(m, mask.shape[1])[None, :]]
    if spec.window is not None:
        off = np.abs(rows * (m - 1) - columns * (n - 1))
        cells &= off <= radius(n, m, spec.window) * (min(n, m) - 1)
    if spec.shape == "itakura" and min(n, m) > 1:
        u, v = rows / (n - 1), columns / (m - 1)
        steep, flat = spec.max_slope, 1 / spec.max_slope
        cells &= (v <= steep * u + _ROUNDING) & (v >= flat * u - _ROUNDING)
        cells &= (1 - v <= steep * (1 - u) + _ROUNDING) & (1 - v >= flat * (1 - u) - _ROUNDING)
    cells.flags.writeable = False
    return cells


def _nearest(size: int, source: int) -> np.ndarray:
    """For each of ``size`` positions, the nearest of ``source`` positions over the same span."""
    if size == 1:
        return np.zeros(1, np.int64)
    return np.rint(np.arange(size) * ((source - 1) / (size - 1))).astype(np.int64)


@lru_cache(maxsize=16384)
def row_bounds(n: int, m: int, spec: DtwSpec) -> tuple[np.ndarray, np.ndarray]:
    """First column and column past the last of each row, two (n,) int32 arrays.

    Raises
    ------
    WarpingError
        Where a row's columns are not one interval (a mask with holes).
    """
    cells = allowed_cells(n, m, spec)
    low = cells.argmax(axis=1).astype(np.int32)
    high = (m - cells[:, ::-1].argmax(axis=1)).astype(np.int32)
    count = cells.sum(axis=1)
    high[count == 0] = low[count == 0]
    if (high - low != count).any():
        raise WarpingError("the band's mask has holes", remedy="kernel 'numpy'", code="E_BAND_HOLES")
    return low, high


def has_holes(spec: DtwSpec) -> bool:
    """Whether some row of the band's mask is not one interval of columns."""
    if spec.mask is None:
        return False
    edges = np.diff(spec.mask.array().astype(np.int8), axis=1, prepend=0)
    return bool((np.maximum(edges, 0).sum(axis=1) > 1).any())


@lru_cache(maxsize=16384)
def is_feasible(n: int, m: int, spec: DtwSpec) -> bool:
    """Whether any path leads from corner to corner inside the band."""
    cells = allowed_cells(n, m, spec)
    if not (cells[0, 0] and cells[-1, -1]):
        return False
    reached = np.logical_and.accumulate(cells[0])
    for row in cells[1:]:
        entered = row & (reached | np.concatenate(([False], reached[:-1])))
        reached = _spread(entered, row)
        if not reached.any():
            return False
    return bool(reached[-1])


def _spread(entered: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Cells of ``row`` that can be reached by moving right from the ``entered`` ones."""
    position = np.arange(len(row))
    last_entry = np.maximum.accumulate(np.where(entered, position, -1))
    last_gap = np.maximum.accumulate(np.where(row, -1, position))
    return row & (last_entry > last_gap)


def check_feasible(query_lengths: np.ndarray, example_lengths: np.ndarray, spec: DtwSpec) -> None:
    """Refuse a band that leaves some pair without a path.

    Raises
    ------
    WarpingError
        Names the first such pair.
    """
    if not is_banded(spec):
        return
    for n in np.unique(query_lengths).tolist():
        for m in np.unique(example_lengths).tolist():
            if not is_feasible(n, m, spec):
                query = int(np.argmax(query_lengths == n))
                example = int(np.argmax(example_lengths == m))
                raise WarpingError(
                    f"query {query} ({n} frames) and example {example} ({m} frames): "
                    "no warping path fits into the band",
                    remedy="a wider window, a steeper slope, or series of more similar length",
                    code="E_BAND_INFEASIBLE",
                )
