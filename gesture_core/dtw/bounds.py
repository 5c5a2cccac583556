"""Lower bounds of hard warping distances: LB_Kim and LB_Keogh, for each dimension and summed.

Every bound is of one dimension's accumulated cost, before norm and root, and holds for padded
batches of unequal lengths. Bounds are computed in float64 and shrunk by a hair, so that a bound
never exceeds the distance that a float32 kernel computes.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gesture_core.dtw.bands import is_banded, row_bounds
from gesture_core.dtw.spec import DtwSpec

MARGIN = {np.dtype(np.float32): 1e-4, np.dtype(np.float64): 1e-10}
"""Relative share by which a bound is lowered: above the rounding of a kernel's sums."""


def point_cost(difference: np.ndarray, squared: bool) -> np.ndarray:
    """The local cost of differences of one dimension."""
    return difference * difference if squared else np.abs(difference)


def envelope(
    values: np.ndarray, lengths: np.ndarray, rows: int, spec: DtwSpec
) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest value that each of ``rows`` query frames can meet in each example.

    Parameters
    ----------
    values : (N, T, D) float
    lengths : (N,) int64

    Returns
    -------
    lower, upper : (N, rows, D)
        LB_Keogh's envelope (Keogh and Ratanamahatana 2005), for any band; without a band the
        range of the whole example.
    """
    count, _, width = values.shape
    lower, upper = np.empty((count, rows, width)), np.empty((count, rows, width))
    for length in np.unique(lengths).tolist():
        which = np.flatnonzero(lengths == length)
        part = values[which, :length]
        if not is_banded(spec):
            lower[which], upper[which] = part.min(axis=1, keepdims=True), part.max(axis=1, keepdims=True)
            continue
        low, high = _bounds(rows, length, spec)
        lower[which] = _range_extreme(part, low, high, np.minimum)
        upper[which] = _range_extreme(part, low, high, np.maximum)
    return lower, upper


@lru_cache(maxsize=1024)
def _bounds(rows: int, columns: int, spec: DtwSpec) -> tuple[np.ndarray, np.ndarray]:
    low, high = row_bounds(rows, columns, spec)
    return low.astype(np.int64), high.astype(np.int64)


def _range_extreme(values: np.ndarray, low: np.ndarray, high: np.ndarray, pick: np.ufunc) -> np.ndarray:
    """``pick`` over ``values[:, low[i]:high[i]]`` for every i, by doubling windows (a sparse table)."""
    levels = [values]
    span = 1
    while span * 2 <= int((high - low).max()):
        levels.append(pick(levels[-1][:, :-span], levels[-1][:, span:]))
        span *= 2
    level = np.floor(np.log2(high - low)).astype(np.int64)
    out = np.empty((len(values), len(low), values.shape[2]), values.dtype)
    for k in np.unique(level).tolist():
        rows = np.flatnonzero(level == k)
        out[:, rows] = pick(levels[k][:, low[rows]], levels[k][:, high[rows] - (1 << k)])
    return out


def keogh(
    query: np.ndarray, lower: np.ndarray, upper: np.ndarray, squared: bool, margin: float
) -> np.ndarray:
    """(N, D) LB_Keogh of one query (n, D) against envelopes (N, n, D)."""
    outside = np.maximum(query - upper, lower - query)
    np.maximum(outside, 0, out=outside)
    if squared:
        outside *= outside
    return outside.sum(axis=1) * (1 - margin)


def kim(query: np.ndarray, ends: np.ndarray, single: np.ndarray, squared: bool, margin: float) -> np.ndarray:
    """(N, D) LB_Kim (Kim et al. 2001; its first and last frames, which every path matches).

    Parameters
    ----------
    query : (n, D)
    ends : (2, N, D)
        First and last frames of the examples.
    single : (N,) bool
        Pairs of two single frames, whose two ends are one cell.
    """
    first = point_cost(query[0] - ends[0], squared)
    last = point_cost(query[-1] - ends[1], squared)
    return np.where(single[:, None], first, first + last) * (1 - margin)
