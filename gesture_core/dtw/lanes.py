"""Batches as lanes: many warpings side by side, one in each lane of the last axis.

Nothing shifts between lanes, so that a warping's bits do not depend on its neighbours. A kernel
that derives from `LaneKernel` writes one method, `warp`; pairing, masks, weights, bands, padding,
tiling, norms and the reduction over dimensions are done here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gesture_core.dtw.bands import allowed_cells, has_holes, is_banded, row_spans
from gesture_core.dtw.gradients import lane_gradients
from gesture_core.dtw.spec import DtwSpec
from gesture_core.types import SignalBatch

PAIRS_IN_FLIGHT = 1 << 17
"""Upper limit of lanes (independent) or of pairs times dimensions (dependent) planned at once."""

GRADIENT_PAIRS = 1 << 12
"""Pairs whose gradients are planned at once."""
UNBOUNDED = 1 << 30
"""A column past the last of any row."""


def far(dtype: np.dtype) -> float:
    """The value of padded frames: matching one with a real frame costs more than any path of those."""
    return 1e15 if dtype == np.float32 else 1e120


def unreached(dtype: np.dtype) -> float:
    """The value of cells that no path reaches: above any cost, finite so that soft minima stay numbers."""
    return 1e32 if dtype == np.float32 else 1e250


@dataclass(frozen=True, eq=False)
class Lanes:
    """P warpings: lane p warps ``x[:n[p], :, p]`` with ``y[:m[p], :, p]``.

    Attributes
    ----------
    x, y : (n_max, C, P) and (m_max, C, P) float
        C dimensions that are warped together; `far` beyond each lane's length.
    n, m : (P,) int64
    low, high : (n_max, P) int32 or None
        The band: first column and column past the last of each row.
    cells : (n_max, m_max, P) bool or None
        The band as cells, only where it has holes.
    gamma : (P,) float or None
        Softness; None is hard.
    cost : str
        ``"absolute"``, ``"squared"`` or ``"euclidean"``, over the C dimensions.
    """

    x: np.ndarray
    y: np.ndarray
    n: np.ndarray
    m: np.ndarray
    low: np.ndarray | None
    high: np.ndarray | None
    cells: np.ndarray | None
    gamma: np.ndarray | None
    cost: str

    def __len__(self) -> int:
        return len(self.n)


@dataclass(frozen=True, eq=False)
class Series:
    """A batch, weighted and turned so that frames come first.

    Attributes
    ----------
    frames : (T, D, B) float
        `far` beyond each length.
    lengths : (B,) int64
    masks, present : (B, D) bool
    """

    frames: np.ndarray
    lengths: np.ndarray
    masks: np.ndarray
    present: np.ndarray

    @classmethod
    def of(cls, batch: SignalBatch, spec: DtwSpec) -> Series:
        """Turn ``batch``; a dimension's weight becomes a factor of its values."""
        values = weighted(batch.values, spec)
        beyond = np.arange(values.shape[1])[None, :] >= batch.lengths[:, None]
        values = np.where(beyond[:, :, None], np.asarray(far(values.dtype), values.dtype), values)
        frames = np.ascontiguousarray(values.transpose(1, 2, 0))
        return cls(frames, batch.lengths, batch.masks, batch.present)


@dataclass(frozen=True, eq=False)
class Prepared:
    """What `LaneKernel.prepare` keeps of the examples."""

    examples: Series
    spec: DtwSpec


def warping_dtype(dtype: np.dtype, spec: DtwSpec) -> np.dtype:
    """In which precision distances of a batch are accumulated: soft ones and their gradients in float64.

    A soft distance is a sum of costs less ``gamma`` times the logarithm of a number of paths. Both
    grow with the length and may cancel: the condition number, their sum over the distance,
    has no bound, and float32 loses what cancels. Gradients weigh paths by differences of such
    sums, divided by ``gamma``.
    """
    return np.dtype(np.float64) if spec.gamma is not None else dtype


def weighted(values: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """``values`` scaled so that an unweighted cost of them is the weighted cost of the originals."""
    if spec.weights is None:
        return values
    factors = np.array(spec.weights)
    if lane_cost(spec) != "absolute":
        factors = np.sqrt(factors)
    return values * factors.astype(values.dtype)


def lane_cost(spec: DtwSpec) -> str:
    """The cost over the dimensions of one lane; over a single dimension Euclidean is absolute."""
    return "absolute" if spec.mode == "independent" and spec.cost == "euclidean" else spec.cost


def used_dimensions(
    queries: Series | SignalBatch, examples: Series | SignalBatch, qi: np.ndarray, ei: np.ndarray
) -> np.ndarray:
    """(K, D) bool: the dimensions that each of K pairs is compared on."""
    salient = queries.masks[qi] | examples.masks[ei]
    return salient & queries.present[qi] & examples.present[ei]


def mean_factor(count: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """What dividing a dependent lane's cost sums by ``count`` dimensions does to its accumulated cost."""
    count = np.maximum(count, 1)
    return 1 / np.sqrt(count) if spec.cost == "euclidean" else 1 / count


def finish(values: np.ndarray, n: np.ndarray, m: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """Norm and root of accumulated costs, in float64."""
    values = values.astype(np.float64)
    if spec.length_norm:
        values = values / (n + m)
    return np.sqrt(values) if spec.root else values


class LaneKernel(ABC):
    """A distance kernel that computes lanes."""

    lane_cells = 1 << 22
    """Upper limit of frames times dimensions times lanes of one side of a tile."""
    lane_count = 4096
    """Upper limit of lanes in a tile."""
    rows_step = 16
    """Lanes whose lengths fall into the same multiple of this share tiles."""

    @abstractmethod
    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) accumulated cost of each lane at its own last cell, before any norm or root."""

    def supports(self, spec: DtwSpec) -> bool:
        """Everything but masks with holes."""
        return not has_holes(spec)

    def prepare(self, examples: SignalBatch, spec: DtwSpec) -> Prepared:
        """Turn the examples once."""
        return Prepared(Series.of(examples, spec), spec)

    def distances(self, state: Prepared, queries: SignalBatch) -> np.ndarray:
        """(Q, N) distances in the dtype of the batches; infinity where no dimension is shared."""
        series = Series.of(queries, state.spec)
        count = len(state.examples.lengths)
        out = np.empty(len(queries) * count, state.examples.frames.dtype)
        order = np.argsort(series.lengths, kind="stable")
        step = max(1, PAIRS_IN_FLIGHT // series.frames.shape[1])
        for start in range(0, len(out), step):
            flat = np.arange(start, min(start + step, len(out)))
            qi, ei = order[flat // count], flat % count
            out[qi * count + ei] = self._pairs(state, series, qi, ei)
        return out.reshape(-1, count)

    def pairs(
        self, state: Prepared, queries: SignalBatch, query_index: np.ndarray, example_index: np.ndarray
    ) -> np.ndarray:
        """(K,) distances of chosen pairs, bitwise those of `distances`."""
        series = Series.of(queries, state.spec)
        out = np.empty(len(query_index), state.examples.frames.dtype)
        step = max(1, PAIRS_IN_FLIGHT // series.frames.shape[1])
        for start in range(0, len(out), step):
            part = slice(start, start + step)
            out[part] = self._pairs(state, series, query_index[part], example_index[part])
        return out

    def gradients(
        self, state: Prepared, queries: SignalBatch, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Soft distances, and the gradients of their sum weighted by ``weights`` (Q, N).

        Accumulated as `warping_dtype` says, then in the dtype of the batches.

        Returns
        -------
        (Q, N), (Q, T, D), (N, T, D)
            Zero beyond each length and in dimensions that are not used.
        """
        spec, examples = state.spec, state.examples
        series = Series.of(queries, spec)
        shape = (len(queries), len(examples.lengths))
        values = np.zeros(shape)
        slopes = [np.zeros(part.frames.shape) for part in (series, examples)]
        for start in range(0, values.size, GRADIENT_PAIRS):
            flat = np.arange(start, min(start + GRADIENT_PAIRS, values.size))
            qi, ei = flat // shape[1], flat % shape[1]
            pair, dimension, use, count = _pairing(series, examples, qi, ei, spec)
            factor = _pair_factor(count, series.lengths[qi] + examples.lengths[ei], spec)
            for tile in self._tiles(series.lengths[qi[pair]], examples.lengths[ei[pair]], spec, series):
                rows = pair[tile]
                chosen = None if dimension is None else dimension[tile]
                dtype = warping_dtype(examples.frames.dtype, spec)
                lanes = _gather(series, examples, qi[rows], ei[rows], chosen, use[rows], spec, dtype)
                value, *slope = self.warp_gradients(lanes)
                np.add.at(values, (qi[rows], ei[rows]), value * factor[rows])
                weight = factor[rows] * weights[qi[rows], ei[rows]]
                for side, index, part in zip(slopes, (qi[rows], ei[rows]), slope, strict=True):
                    part = part * weight if chosen is not None else part * weight * use[rows].T
                    if chosen is None:
                        np.add.at(side[: len(part)].transpose(2, 0, 1), index, part.transpose(2, 0, 1))
                    else:
                        turned = side[: len(part)].transpose(2, 1, 0)
                        np.add.at(turned, (index, chosen), part[:, 0].T)
            values[qi[count == 0], ei[count == 0]] = np.inf
        dtype = examples.frames.dtype
        scale = weighted(np.ones(examples.frames.shape[1]), spec)
        of_queries, of_examples = ((side.transpose(2, 0, 1) * scale).astype(dtype) for side in slopes)
        return values.astype(dtype), of_queries, of_examples

    def warp_gradients(self, lanes: Lanes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(P,), (n_max, C, P), (m_max, C, P): soft accumulated costs and their gradients."""
        assert lanes.gamma is not None
        return lane_gradients(lanes.x, lanes.y, lanes.n, lanes.m, inside(lanes), lanes.gamma, lanes.cost)

    def tile_size(self, frames: int, width: int) -> int:
        """Most lanes of ``frames`` frames and ``width`` dimensions that travel together."""
        return min(self.lane_count, max(1, self.lane_cells // (frames * width)))

    def _pairs(self, state: Prepared, queries: Series, qi: np.ndarray, ei: np.ndarray) -> np.ndarray:
        spec, examples = state.spec, state.examples
        pair, dimension, use, count = _pairing(queries, examples, qi, ei, spec)
        total = np.zeros(len(qi))
        for tile in self._tiles(queries.lengths[qi[pair]], examples.lengths[ei[pair]], spec, queries):
            rows = pair[tile]
            lanes = _gather(
                queries, examples, qi[rows], ei[rows], None if dimension is None else dimension[tile],
                use[rows], spec, warping_dtype(examples.frames.dtype, spec),
            )  # fmt: skip
            values = self.warp(lanes).astype(np.float64)
            if spec.mode == "dependent" and spec.reduce == "mean":
                values *= mean_factor(count[rows], spec)
            # In the order of the dimensions, one addition at a time: no tile's border shows in the sum.
            np.add.at(total, rows, finish(values, lanes.n, lanes.m, spec))
        if spec.mode == "independent" and spec.reduce == "mean":
            total /= np.maximum(count, 1)
        total[count == 0] = np.inf
        return total

    def _tiles(self, n: np.ndarray, m: np.ndarray, spec: DtwSpec, queries: Series) -> Iterator[np.ndarray]:
        """Index arrays of lanes that travel together: similar lengths, at most a tile's size."""
        width = 1 if spec.mode == "independent" else queries.frames.shape[1]
        key_n, key_m = (n - 1) // self.rows_step, (m - 1) // self.rows_step
        order = np.lexsort((key_m, key_n))
        key_n, key_m = key_n[order], key_m[order]
        borders = np.flatnonzero((np.diff(key_n) != 0) | (np.diff(key_m) != 0)) + 1
        for group in np.split(order, borders):
            if len(group) == 0:
                continue
            size = self.tile_size(int(max(n[group].max(), m[group].max())), width)
            for start in range(0, len(group), size):
                yield group[start : start + size]


def _pairing(
    queries: Series, examples: Series, qi: np.ndarray, ei: np.ndarray, spec: DtwSpec
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray, np.ndarray]:
    """Which pair and dimension each lane is (None: all together), and which and how many a pair uses."""
    use = used_dimensions(queries, examples, qi, ei)
    count = use.sum(axis=1)
    if spec.mode == "dependent":
        return np.flatnonzero(count), None, use, count
    pair, dimension = np.nonzero(use)
    return pair, dimension, use, count


def _pair_factor(count: np.ndarray, frames: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """What a soft lane's accumulated cost is multiplied by in its pair's distance."""
    factor = np.ones(len(count))
    if spec.reduce == "mean":
        mean = mean_factor(count, spec) if spec.mode == "dependent" else 1 / np.maximum(count, 1)
        factor = factor * mean
    return factor / frames if spec.length_norm else factor


def inside(lanes: Lanes) -> np.ndarray:
    """(n_max, m_max, P) bool: the cells inside each lane's lengths and band."""
    row, column = np.arange(len(lanes.x))[:, None, None], np.arange(len(lanes.y))[None, :, None]
    cells = (row < lanes.n) & (column < lanes.m)
    if lanes.low is not None and lanes.high is not None:
        cells &= (column >= lanes.low[:, None]) & (column < lanes.high[:, None])
    if lanes.cells is not None:
        cells &= lanes.cells
    return cells


def _gather(
    queries: Series,
    examples: Series,
    qi: np.ndarray,
    ei: np.ndarray,
    dimension: np.ndarray | None,
    use: np.ndarray,
    spec: DtwSpec,
    dtype: np.dtype,
) -> Lanes:
    """The lanes of pairs ``qi``, ``ei``: one dimension each, or all used ones together."""
    n, m = queries.lengths[qi], examples.lengths[ei]
    x, y = (
        _columns(series.frames[: int(length.max())], index, dimension).astype(dtype, copy=False)
        for series, index, length in ((queries, qi, n), (examples, ei, m))
    )
    gamma = None if spec.gamma is None else np.full(len(qi), spec.gamma)
    if dimension is None and not use.all():
        x, y = _only(use, x, n), _only(use, y, m)
    if dimension is None and gamma is not None and spec.reduce == "mean":
        gamma = gamma / mean_factor(use.sum(axis=1), spec)
    low = high = cells = None
    if has_holes(spec):
        cells = _cells(n, m, spec)
    elif is_banded(spec):
        low, high = _bounds(n, m, spec)
    softness = None if gamma is None else gamma.astype(dtype)
    return Lanes(x, y, n, m, low, high, cells, softness, lane_cost(spec))


def _only(use: np.ndarray, x: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Zero in the dimensions that a lane does not use, but for its padding."""
    beyond = np.arange(len(x))[:, None] >= lengths
    return np.where(use.T | beyond[:, None, :], x, 0)


def _columns(frames: np.ndarray, index: np.ndarray, dimension: np.ndarray | None) -> np.ndarray:
    """(T, C, P) from (T, D, B)."""
    if dimension is None:
        return frames.take(index, axis=2)
    length, _, count = frames.shape
    return frames.reshape(length, -1).take(dimension * count + index, axis=1)[:, None, :]


def _bounds(n: np.ndarray, m: np.ndarray, spec: DtwSpec) -> tuple[np.ndarray, np.ndarray]:
    """(n_max, P) first columns and columns past the last; rows beyond a lane's length hold padding alone."""
    lengths, lane = _distinct(n, m)
    low = np.broadcast_to(lengths[1].astype(np.int32), (int(n.max()), lengths.shape[1])).copy()
    high = np.full_like(low, UNBOUNDED)
    for rows in np.unique(n).tolist():
        which = np.flatnonzero(lengths[0] == rows)
        spans = row_spans(rows, lengths[1, which], spec)
        low[:rows, which], high[:rows, which] = (side.T for side in spans)
    return low.take(lane, axis=1), high.take(lane, axis=1)


def _cells(n: np.ndarray, m: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """(n_max, m_max, P) cells of a band with holes; all of them beyond a lane's lengths."""
    cells = np.ones((int(n.max()), int(m.max()), len(n)), bool)
    lengths, lane = _distinct(n, m)
    for pair, (rows, columns) in enumerate(lengths.T.tolist()):
        which = np.flatnonzero(lane == pair)
        cells[:rows, :columns, which] = allowed_cells(rows, columns, spec)[:, :, None]
    return cells


def _distinct(n: np.ndarray, m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(2, K) distinct combinations of lengths, and which of them each lane has."""
    lengths, lane = np.unique(np.stack([n, m]), axis=1, return_inverse=True)
    return lengths, lane.reshape(-1)
