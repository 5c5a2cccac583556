"""The forms in which compiled code takes its data: named tuples of arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gesture_core.dtw.bands import is_banded, row_spans
from gesture_core.dtw.batches import FAR, UNREACHED, lane_cost, warping_dtype, weighted
from gesture_core.dtw.spec import DtwSpec
from gesture_core.types import SignalBatch
from gesture_dtw_numba.compiled import LANES, ROWS


class Batch(NamedTuple):
    """Weighted series with frames last.

    Attributes
    ----------
    values : (B, D, T) float
    lengths : (B,) int64
    masks, present : (B, D) bool
        Masks hold only where present.
    """

    values: np.ndarray
    lengths: np.ndarray
    masks: np.ndarray
    present: np.ndarray


class Rule(NamedTuple):
    """What is done with the differences of frames, and with accumulated costs."""

    dependent: bool
    banded: bool
    squared: bool
    euclidean: bool
    mean: bool
    length_norm: bool
    root: bool

    @classmethod
    def of(cls, spec: DtwSpec) -> Rule:
        """That of a specification."""
        cost = lane_cost(spec)
        return cls(
            spec.mode == "dependent",
            is_banded(spec),
            cost != "absolute",
            cost == "euclidean",
            spec.reduce == "mean",
            spec.length_norm,
            spec.root,
        )


class Bands(NamedTuple):
    """The band of every combination of lengths, end to end.

    ``low[offset[query_index[n], example_index[m]] + i]`` is the first column of row i of lengths
    n and m; ``high`` likewise holds the column past its last.
    """

    query_index: np.ndarray
    example_index: np.ndarray
    offset: np.ndarray
    low: np.ndarray
    high: np.ndarray


class Costs(NamedTuple):
    """Local costs that are computed ahead of the recurrence, a column of four rows at a time.

    Attributes
    ----------
    share : (C, LANES) float
        What each dimension counts for in each lane.
    local : (ROWS, LANES) float
        Working array.
    """

    share: np.ndarray
    local: np.ndarray


class Scratch(NamedTuple):
    """Working arrays of a tile.

    Attributes
    ----------
    x : (rows, C) float
        The query after its padding, whose value is ``far``.
    block : (columns, C, LANES) float
        The examples.
    lengths : (LANES,) int64
        Of the examples in the block; 0 in lanes that stay empty.
    above : (columns, LANES) float
        The last complete row of the table.
    left : (ROWS, LANES) float
        The last complete column of the rows in work.
    corner : (LANES,) float
        The cell above that column.
    low, high : (rows, LANES) int32
        The band.
    limit : (LANES,) float
        What each lane may accumulate at most; below zero in lanes that are empty.
    far, border : float
        `FAR` and `UNREACHED`.
    """

    x: np.ndarray
    block: np.ndarray
    lengths: np.ndarray
    above: np.ndarray
    left: np.ndarray
    corner: np.ndarray
    low: np.ndarray
    high: np.ndarray
    limit: np.ndarray
    far: float
    border: float


def make_batch(batch: SignalBatch, spec: DtwSpec) -> Batch:
    """Weight and turn a batch; `warping_dtype` says in which precision.

    The arrays are copies, since compiled code tells one memory order, and what may be written, from another:
    it would be compiled again for each.
    """
    weighed = weighted(batch.values, spec).astype(warping_dtype(batch.values.dtype, spec), copy=False)
    values = np.array(weighed.transpose(0, 2, 1), order="C")
    masks = np.array(batch.masks & batch.present, order="C")
    return Batch(values, np.array(batch.lengths), masks, np.array(batch.present, order="C"))


def make_bands(n: np.ndarray, m: np.ndarray, spec: DtwSpec) -> Bands:
    """The bands between series of lengths ``n`` and of lengths ``m``; empty where ``spec`` has none."""
    if not is_banded(spec):
        nothing, none = np.zeros(0, np.int64), np.zeros(0, np.int32)
        return Bands(nothing, nothing, nothing.reshape(0, 0), none, none)
    rows, query_index = _index(n)
    columns, example_index = _index(m)
    sizes = np.repeat(rows, len(columns)).reshape(len(rows), len(columns))
    offset = np.cumsum(sizes).reshape(sizes.shape) - sizes
    low, high = (np.empty(int(sizes.sum()), np.int32) for _ in range(2))
    for row, start in zip(rows.tolist(), offset[:, 0].tolist(), strict=True):
        part = slice(start, start + row * len(columns))
        low[part], high[part] = (side.reshape(-1) for side in row_spans(row, columns, spec))
    return Bands(query_index, example_index, offset, low, high)


def _index(lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct lengths, and the number of each among them."""
    distinct = np.unique(lengths)
    index = np.zeros(distinct[-1] + 1, np.int64)
    index[distinct] = np.arange(len(distinct))
    return distinct, index


def make_scratch(rows: int, columns: int, width: int, banded: bool, dtype: np.dtype) -> Scratch:
    """Working arrays for queries of ``rows`` frames and examples of ``columns``."""
    rows = -(-rows // ROWS) * ROWS
    band = (rows if banded else 0, LANES)
    return Scratch(
        aligned((rows, width), dtype),
        aligned((columns, width, LANES), dtype),
        np.zeros(LANES, np.int64),
        aligned((columns, LANES), dtype),
        aligned((ROWS, LANES), dtype),
        aligned((LANES,), dtype),
        aligned(band, np.dtype(np.int32)),
        aligned(band, np.dtype(np.int32)),
        aligned((LANES,), dtype),
        dtype.type(FAR[dtype]),
        dtype.type(UNREACHED[dtype]),
    )


def aligned(shape: tuple[int, ...], dtype: np.dtype, border: int = 64) -> np.ndarray:
    """Zeros whose first byte lies on a cache line, so that no vector load straddles two."""
    size = int(np.prod(shape)) * dtype.itemsize
    raw = np.zeros(size + border, np.uint8)
    offset = -raw.ctypes.data % border
    return raw[offset : offset + size].view(dtype).reshape(shape)
