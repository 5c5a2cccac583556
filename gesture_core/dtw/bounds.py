"""Lower bounds of hard warping distances: LB_Kim and LB_Keogh, for each dimension and summed.

Every bound is of one dimension's accumulated cost, before norm and root, and holds for padded
batches of unequal lengths. Bounds are computed in float64; `lower_bounds` shrinks them by a hair,
so that none exceeds the distance that a float32 kernel computes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gesture_core.dtw.bands import is_banded, row_spans
from gesture_core.dtw.lanes import used_dimensions, weighted
from gesture_core.dtw.spec import DtwSpec
from gesture_core.types import SignalBatch

Keogh = Callable[[np.ndarray, np.ndarray, np.ndarray, bool], np.ndarray]

MARGIN = {np.dtype(np.float32): 1e-4, np.dtype(np.float64): 1e-10}
"""Relative share by which a bound of short series is lowered."""


def margin(dtype: np.dtype, terms: np.ndarray) -> np.ndarray:
    """Relative share by which a bound is lowered: twice what a kernel's sum of ``terms`` can lose.

    A sum of non-negative numbers, one after the other, is at most its number of terms times half of
    the machine epsilon off (Higham 2002, section 4.2).
    """
    return np.maximum(MARGIN[dtype], terms * float(np.finfo(dtype).eps))


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
    lower, upper : (N, D, rows)
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
        (low,), (high,) = row_spans(rows, np.array([length]), spec)
        lower[which] = _range_extreme(part, low, high, np.minimum)
        upper[which] = _range_extreme(part, low, high, np.maximum)
    return tuple(np.ascontiguousarray(side.transpose(0, 2, 1)) for side in (lower, upper))  # type: ignore[return-value]


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


def keogh(query: np.ndarray, lower: np.ndarray, upper: np.ndarray, squared: bool) -> np.ndarray:
    """(N, D) LB_Keogh of one query (D, n) against envelopes (N, D, n), without a margin.

    A kernel may have a faster method of this name and signature.
    """
    outside = np.maximum(query - upper, lower - query)
    np.maximum(outside, 0, out=outside)
    if squared:
        outside *= outside
    return outside.sum(axis=2)


def kim(query: np.ndarray, ends: np.ndarray, single: np.ndarray, squared: bool) -> np.ndarray:
    """(N, D) LB_Kim (Kim et al. 2001; its first and last frames, which every path matches), without a margin.

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
    return np.where(single[:, None], first, first + last)


def lower_bounds(
    queries: SignalBatch, examples: SignalBatch, spec: DtwSpec, keogh: Keogh = keogh
) -> np.ndarray:
    """(Q, N) float64 numbers that no hard warping distance is below; infinity where it is infinite.

    The greater of LB_Kim and LB_Keogh for each dimension, summed over the dimensions of the pair.
    """
    squared = spec.cost == "squared" or (spec.cost == "euclidean" and spec.mode == "dependent")
    dtype, width = queries.values.dtype, queries.values.shape[2]
    q_values, e_values = (weighted(batch.values, spec).astype(np.float64) for batch in (queries, examples))
    count, every = len(examples), np.arange(len(examples))
    ends = np.stack([e_values[:, 0], e_values[every, examples.lengths - 1]])
    out = np.empty((len(queries), count))
    for n in np.unique(queries.lengths).tolist():
        lower, upper = envelope(e_values, examples.lengths, n, spec)
        single = (examples.lengths == 1) & (n == 1)
        # A path has fewer cells than both have frames; a cell sums its dimensions.
        kept = 1 - margin(dtype, n + examples.lengths + width)[:, None]
        # Squares and shares of squares that lie below the dtype's range.
        lost = 2 * float(np.finfo(dtype).tiny) * (n + examples.lengths)[:, None]
        for index in np.flatnonzero(queries.lengths == n):
            use = used_dimensions(queries, examples, np.full(count, index), every)
            x = q_values[index, :n]
            outside = keogh(np.ascontiguousarray(x.T), lower, upper, squared)
            bound = np.maximum(kim(x, ends, single, squared), outside)
            bound = np.maximum(bound * kept - lost, 0)
            out[index] = _combine(bound, use, n + examples.lengths, spec)
    return out


def _combine(bound: np.ndarray, use: np.ndarray, frames: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """(N,) bound of the distance from (N, D) bounds of the dimensions."""
    bound = np.where(use, bound, 0)
    count = use.sum(axis=1)
    if spec.mode == "independent":
        if spec.length_norm:
            bound = bound / frames[:, None]
        total = (np.sqrt(bound) if spec.root else bound).sum(axis=1)
        total = total / np.maximum(count, 1) if spec.reduce == "mean" else total
    else:
        total = bound.sum(axis=1)
        if spec.reduce == "mean":
            total = total / np.maximum(count, 1)
        if spec.cost == "euclidean":
            # The sum of square roots is at least the square root of the sum.
            total = np.sqrt(total)
        if spec.length_norm:
            total = total / frames
        if spec.root:
            total = np.sqrt(total)
    return np.where(count == 0, np.inf, total)
