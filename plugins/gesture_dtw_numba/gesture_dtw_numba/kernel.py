"""Distance kernel on Numba: lanes across pairs, the fastest path on a CPU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from gesture_core.dtw.bands import has_holes
from gesture_core.dtw.cores import usable_cores
from gesture_core.dtw.lanes import LaneKernel, Lanes
from gesture_core.dtw.spec import DtwSpec
from gesture_core.types import SignalBatch
from gesture_dtw_numba.bounds import keogh
from gesture_dtw_numba.compiled import LANES
from gesture_dtw_numba.gradient import compiled_gradients
from gesture_dtw_numba.layout import (
    Batch,
    CostRule,
    make_bands,
    make_batch,
    make_costs,
    make_gradient_room,
    make_room,
    make_rule,
)
from gesture_dtw_numba.tile import compiled_groups

QUERIES, EXAMPLES = 16, 512
"""Size of a tile: the unit that a thread takes."""
GROUPS = 64
"""Queries whose chosen examples a thread takes at once."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What `NumbaKernel.prepare` keeps of the examples."""

    batch: SignalBatch
    examples: Batch
    spec: DtwSpec


@dataclass(frozen=True)
class NumbaKernel:
    """Warping distances in compiled loops, in the dtype of the batches.

    Attributes
    ----------
    threads : int
        Tiles computed at the same time; 0 is one for each core that the process may use.
    """

    threads: int = 0

    def supports(self, spec: DtwSpec) -> bool:
        """Everything but masks with holes."""
        return not has_holes(spec)

    def prepare(self, examples: SignalBatch, spec: DtwSpec) -> Prepared:
        """Turn the examples once."""
        return Prepared(examples, make_batch(examples, spec), spec)

    def distances(self, state: Prepared, queries: SignalBatch) -> np.ndarray:
        """(Q, N) distances in the dtype of the batches; infinity where no dimension is shared."""
        batch = make_batch(queries, state.spec)
        out = np.empty((len(queries), len(state.examples.lengths)), queries.values.dtype)

        def compute(qs: np.ndarray, es: np.ndarray) -> None:
            found, _ = run_groups(batch, qs, [0, len(qs)], state, es, [0, len(es)])
            out[np.ix_(qs, es)] = found.reshape(len(qs), len(es))

        tiles = [
            (qs, es)
            for qs in _cut(np.argsort(batch.lengths, kind="stable"), QUERIES)
            for es in _cut(np.argsort(state.examples.lengths, kind="stable"), EXAMPLES)
        ]
        self._each(compute, tiles)
        return out

    def pairs(
        self, state: Prepared, queries: SignalBatch, query_index: np.ndarray, example_index: np.ndarray
    ) -> np.ndarray:
        """(K,) distances of chosen pairs, bitwise those of `distances`."""
        return self.within(state, queries, query_index, example_index)[0]

    def within(
        self,
        state: Prepared,
        queries: SignalBatch,
        query_index: np.ndarray,
        example_index: np.ndarray,
        limits: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distances of chosen pairs as far as they matter; see `gesture_core.dtw.pairs.distances_within`."""
        batch = make_batch(queries, state.spec)
        out = np.empty(len(query_index), queries.values.dtype)
        cells = np.empty(len(query_index), np.int64)
        order = np.lexsort((state.examples.lengths[example_index], query_index))
        starts = np.flatnonzero(np.diff(query_index[order], prepend=-1))
        ends = np.append(starts, len(order))

        def compute(groups: np.ndarray) -> None:
            first, last = ends[groups[0]], ends[groups[-1] + 1]
            chosen = order[first:last]
            out[chosen], cells[chosen] = run_groups(
                batch,
                query_index[order[ends[groups]]],
                range(len(groups) + 1),
                state,
                example_index[chosen],
                ends[groups[0] : groups[-1] + 2] - first,
                limits,
            )

        self._each(compute, [(part,) for part in _cut(np.arange(len(starts)), GROUPS)])
        return out, cells

    def keogh(self, query: np.ndarray, lower: np.ndarray, upper: np.ndarray, squared: bool) -> np.ndarray:
        """(N, D) LB_Keogh sums; see `gesture_core.dtw.bounds.keogh`."""
        return keogh(query, lower, upper, squared)

    def gradients(
        self, state: Prepared, queries: SignalBatch, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Soft distances, and the gradients of their weighted sum; see `LaneKernel.gradients`."""
        lanes = GradientLanes()
        return lanes.gradients(lanes.prepare(state.batch, state.spec), queries, weights)

    def _each(self, compute: Callable[..., None], tasks: Sequence[tuple[Any, ...]]) -> None:
        threads = min(self.threads or usable_cores(), len(tasks))
        if threads <= 1:
            for task in tasks:
                compute(*task)
            return
        with ThreadPoolExecutor(threads) as pool:
            for done in [pool.submit(compute, *task) for task in tasks]:
                done.result()


def _cut(order: np.ndarray, size: int) -> list[np.ndarray]:
    return [order[start : start + size] for start in range(0, len(order), size)]


def run_groups(
    queries: Batch,
    qs: np.ndarray,
    q_ends: Sequence[int],
    state: Prepared,
    es: np.ndarray,
    e_ends: Sequence[int],
    limits: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (float64) and computed cells of groups, end to end; see `tile.compiled_groups`."""
    examples, spec = state.examples, state.spec
    n, m = queries.lengths[qs], examples.lengths[es]
    dtype, rule = queries.values.dtype, make_rule(spec)
    width = queries.values.shape[1] if rule.dependent else 1
    gamma = None if spec.gamma is None else dtype.type(spec.gamma)
    plain = gamma is None and not rule.banded and not rule.dependent
    costs = None if plain else make_costs(width, dtype)
    room = make_room(int(n.max()), int(m.max()), width, rule.banded, dtype)
    q_cuts, e_cuts = np.asarray(q_ends, np.int64), np.asarray(e_ends, np.int64)
    count = int((np.diff(q_cuts) * np.diff(e_cuts)).sum())
    out, cells = np.empty(count), np.empty(count, np.int64)
    if limits is None or gamma is not None:
        limits = np.empty(0)
    bands = make_bands(n, m, spec)
    compiled_groups()(
        queries, qs, q_cuts, examples, es, e_cuts, rule, bands, gamma, costs, limits, room, out, cells
    )
    return out, cells


class GradientLanes(LaneKernel):
    """Gradients by lanes: `LaneKernel` pairs and pads, compiled code computes."""

    lane_count = LANES

    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) soft accumulated costs."""
        return self.warp_gradients(lanes)[0]

    def warp_gradients(self, lanes: Lanes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(P,), (n_max, C, P), (m_max, C, P): soft accumulated costs and their gradients."""
        assert lanes.gamma is not None
        x, y, gamma = (_widen(part, 0 if part.ndim > 1 else 1) for part in (lanes.x, lanes.y, lanes.gamma))
        n, m = _widen(lanes.n, 1), _widen(lanes.m, 1)
        rule = CostRule(lanes.cost != "absolute", lanes.cost == "euclidean")
        low = high = None
        if lanes.low is not None and lanes.high is not None:
            low, high = _widen(lanes.low, 0), _widen(lanes.high, 0)
        room = make_gradient_room(x, y, gamma)
        compiled_gradients()(x, y, n, m, low, high, rule, room)
        count = len(lanes)
        return room.values[:count], room.of_x[..., :count], room.of_y[..., :count]


def _widen(array: np.ndarray, fill: int) -> np.ndarray:
    """The last axis filled up to `LANES`."""
    out = np.full((*array.shape[:-1], LANES), fill, array.dtype)
    out[..., : array.shape[-1]] = array
    return out
