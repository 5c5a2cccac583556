"""Batches as lanes: many warpings side by side, one in each lane of the last axis.

Nothing shifts between lanes, so that a warping's bits do not depend on its neighbours. A kernel
that derives from `LaneKernel` writes one method, `warp`; pairing, masks, weights, bands, padding,
tiling, norms and the reduction over dimensions are done here. One that derives from
`GradientLaneKernel` also writes `warp_gradients`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gesture_core.dtw.bands import allowed_cells, has_holes, is_banded, row_spans
from gesture_core.dtw.batches import FAR, lane_cost, used_dimensions, warping_dtype, weighted
from gesture_core.dtw.spec import DtwSpec
from gesture_core.plugin.abilities import GradientKernel, PairKernel
from gesture_core.types import SignalBatch

__all__ = ["UNBOUNDED", "GradientLaneKernel", "LaneKernel", "Lanes", "Prepared"]

UNBOUNDED = 1 << 30
"""A column past the last of any row."""

_PAIRS_AT_ONCE = 1 << 17
"""Upper limit of lanes (independent) or of pairs times dimensions (dependent) planned at once."""
_GRADIENT_PAIRS = 1 << 12
"""Pairs whose gradients are planned at once."""


@dataclass(frozen=True, eq=False)
class Lanes:
    """P warpings: lane p warps ``x[:n[p], :, p]`` with ``y[:m[p], :, p]``.

    Attributes
    ----------
    x, y : (n_max, C, P) and (m_max, C, P) float
        C dimensions that are warped together; `FAR` beyond each lane's length.
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
class Prepared:
    """A batch in the order in which lanes are gathered from it.

    Attributes
    ----------
    frames : (T, D, B) float
        Weighted values; `FAR` beyond each length.
    batch : SignalBatch
    spec : DtwSpec
    """

    frames: np.ndarray
    batch: SignalBatch
    spec: DtwSpec


class LaneKernel(PairKernel):
    """A distance kernel that computes lanes; it gives whole tables and chosen pairs."""

    lane_cells = 1 << 22
    """Upper limit of frames times dimensions times lanes of one side of a tile."""
    lane_count = 4096
    """Upper limit of lanes in a tile."""
    rows_step = 16
    """Lanes whose lengths fall into the same multiple of this share tiles."""

    def __init__(self) -> None:
        """Without options; a kernel that has some is a frozen dataclass."""

    @abstractmethod
    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) accumulated cost of each lane at its own last cell, before any norm or root."""

    def tile_size(self, frames: int, width: int) -> int:
        """Most lanes of ``frames`` frames and ``width`` dimensions that travel together."""
        return min(self.lane_count, max(1, self.lane_cells // (frames * width)))

    def supports(self, spec: DtwSpec) -> bool:
        """Everything but masks with holes."""
        return not has_holes(spec)

    def prepare(self, examples: SignalBatch, spec: DtwSpec) -> Prepared:
        """Weight and turn a batch once."""
        values = weighted(examples.values, spec)
        beyond = np.arange(values.shape[1])[None, :] >= examples.lengths[:, None]
        values = np.where(beyond[:, :, None], np.asarray(FAR[values.dtype], values.dtype), values)
        return Prepared(np.ascontiguousarray(values.transpose(1, 2, 0)), examples, spec)

    def distances(self, state: Prepared, queries: SignalBatch) -> np.ndarray:
        """(Q, N) distances in the dtype of the batches; infinity where no dimension is shared."""
        own, count = self.prepare(queries, state.spec), len(state.batch)
        out = np.empty(len(queries) * count, state.frames.dtype)
        order = np.argsort(queries.lengths, kind="stable")
        step = max(1, _PAIRS_AT_ONCE // own.frames.shape[1])
        for start in range(0, len(out), step):
            flat = np.arange(start, min(start + step, len(out)))
            qi, ei = order[flat // count], flat % count
            out[qi * count + ei] = self._warp_pairs(own, state, qi, ei)
        return out.reshape(-1, count)

    def pairs(
        self, state: Prepared, queries: SignalBatch, query_index: np.ndarray, example_index: np.ndarray
    ) -> np.ndarray:
        """(K,) distances of chosen pairs, bitwise those of `distances`."""
        own = self.prepare(queries, state.spec)
        out = np.empty(len(query_index), state.frames.dtype)
        step = max(1, _PAIRS_AT_ONCE // own.frames.shape[1])
        for start in range(0, len(out), step):
            part = slice(start, start + step)
            out[part] = self._warp_pairs(own, state, query_index[part], example_index[part])
        return out

    def _warp_pairs(
        self, queries: Prepared, examples: Prepared, qi: np.ndarray, ei: np.ndarray
    ) -> np.ndarray:
        """(K,) float64 distances of the pairs ``(qi[k], ei[k])``."""
        spec = examples.spec
        use = used_dimensions(queries.batch, examples.batch, qi, ei)
        count = use.sum(axis=1)
        total = np.zeros(len(qi))
        for rows, lanes, _ in self._tiles(queries, examples, qi, ei, use):
            values = self.warp(lanes).astype(np.float64)
            if spec.mode == "dependent" and spec.reduce == "mean":
                values *= _mean_factor(count[rows], spec)
            if spec.length_norm:
                values = values / (lanes.n + lanes.m)
            if spec.root:
                values = np.sqrt(values)
            # In the order of the dimensions, one addition at a time: no tile's border shows in the sum.
            np.add.at(total, rows, values)
        if spec.mode == "independent" and spec.reduce == "mean":
            total /= np.maximum(count, 1)
        total[count == 0] = np.inf
        return total

    def _tiles(
        self, queries: Prepared, examples: Prepared, qi: np.ndarray, ei: np.ndarray, use: np.ndarray
    ) -> Iterator[tuple[np.ndarray, Lanes, np.ndarray | None]]:
        """Lanes of similar lengths, at most a tile's size; the pair and the dimension of each lane.

        The dimension is None where a pair is one lane of all its dimensions.
        """
        dimension: np.ndarray | None = None
        if examples.spec.mode == "dependent":
            pair = np.flatnonzero(use.any(axis=1))
            width = queries.frames.shape[1]
        else:
            pair, dimension = np.nonzero(use)
            width = 1
        n, m = queries.batch.lengths[qi[pair]], examples.batch.lengths[ei[pair]]
        key_n, key_m = (n - 1) // self.rows_step, (m - 1) // self.rows_step
        order = np.lexsort((key_m, key_n))
        key_n, key_m = key_n[order], key_m[order]
        borders = np.flatnonzero((np.diff(key_n) != 0) | (np.diff(key_m) != 0)) + 1
        for group in np.split(order, borders):
            if len(group) == 0:
                continue
            size = self.tile_size(int(max(n[group].max(), m[group].max())), width)
            for start in range(0, len(group), size):
                tile = group[start : start + size]
                rows = pair[tile]
                chosen = None if dimension is None else dimension[tile]
                yield rows, _gather(queries, examples, qi[rows], ei[rows], chosen, use[rows]), chosen


class GradientLaneKernel(LaneKernel, GradientKernel):
    """A distance kernel that computes lanes and the gradients of soft ones."""

    @abstractmethod
    def warp_gradients(self, lanes: Lanes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(P,), (n_max, C, P), (m_max, C, P): soft accumulated costs and their gradients."""

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
        spec, own = state.spec, self.prepare(queries, state.spec)
        values = np.zeros((len(queries), len(state.batch)))
        slopes = [np.zeros(part.frames.shape) for part in (own, state)]
        for start in range(0, values.size, _GRADIENT_PAIRS):
            flat = np.arange(start, min(start + _GRADIENT_PAIRS, values.size))
            qi, ei = flat // values.shape[1], flat % values.shape[1]
            use = used_dimensions(queries, state.batch, qi, ei)
            count = use.sum(axis=1)
            # What a lane's accumulated cost is multiplied by in its pair's distance.
            factor = np.ones(len(flat))
            if spec.reduce == "mean":
                mean = _mean_factor(count, spec) if spec.mode == "dependent" else 1 / np.maximum(count, 1)
                factor = factor * mean
            if spec.length_norm:
                factor = factor / (queries.lengths[qi] + state.batch.lengths[ei])
            for rows, lanes, chosen in self._tiles(own, state, qi, ei, use):
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
        dtype = state.frames.dtype
        scale = weighted(np.ones(state.frames.shape[1]), spec)
        of_queries, of_examples = ((side.transpose(2, 0, 1) * scale).astype(dtype) for side in slopes)
        return values.astype(dtype), of_queries, of_examples


def _mean_factor(count: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """What dividing a dependent lane's cost sums by ``count`` dimensions does to its accumulated cost."""
    count = np.maximum(count, 1)
    return np.asarray(1 / np.sqrt(count) if spec.cost == "euclidean" else 1 / count)


def _gather(
    queries: Prepared,
    examples: Prepared,
    qi: np.ndarray,
    ei: np.ndarray,
    dimension: np.ndarray | None,
    use: np.ndarray,
) -> Lanes:
    """The lanes of pairs ``qi``, ``ei``: one dimension each, or all used ones together."""
    spec, dtype = examples.spec, warping_dtype(examples.frames.dtype, examples.spec)
    lengths, sides = [], []
    for part, index in ((queries, qi), (examples, ei)):
        length = part.batch.lengths[index]
        frames = part.frames[: int(length.max())]
        if dimension is None:
            side = frames.take(index, axis=2)
        else:
            count = frames.shape[2]
            flat = frames.reshape(len(frames), -1)
            side = flat.take(dimension * count + index, axis=1)[:, None, :]
        side = side.astype(dtype, copy=False)
        if dimension is None and not use.all():
            # Zero in the dimensions that a lane does not use, but for its padding.
            beyond = np.arange(len(side))[:, None] >= length
            side = np.where(use.T | beyond[:, None, :], side, 0)
        lengths.append(length)
        sides.append(side)
    n, m = lengths
    gamma = None
    if spec.gamma is not None:
        gamma = np.full(len(qi), spec.gamma)
        if dimension is None and spec.reduce == "mean":
            gamma = gamma / _mean_factor(use.sum(axis=1), spec)
        gamma = gamma.astype(dtype)
    low = high = cells = None
    if has_holes(spec):
        cells = _cells(n, m, spec)
    elif is_banded(spec):
        low, high = _spans(n, m, spec)
    return Lanes(sides[0], sides[1], n, m, low, high, cells, gamma, lane_cost(spec))


def _spans(n: np.ndarray, m: np.ndarray, spec: DtwSpec) -> tuple[np.ndarray, np.ndarray]:
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
