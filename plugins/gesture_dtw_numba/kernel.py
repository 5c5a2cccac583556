"""Distance kernel on Numba: lanes across pairs, the fastest path on a CPU."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from gesture_core.dtw.bands import has_holes
from gesture_core.dtw.lanes import LaneKernel, Lanes
from gesture_core.dtw.spec import DtwSpec
from gesture_core.types import SignalBatch
from gesture_dtw_numba.compiled import LANES
from gesture_dtw_numba.gradient import compiled_gradients
from gesture_dtw_numba.layout import (
    Batch,
    make_bands,
    make_batch,
    make_costs,
    make_gradient_room,
    make_room,
    make_rule,
)
from gesture_dtw_numba.tile import compiled_tile

QUERIES, EXAMPLES = 16, 512
"""Size of a tile: the unit that a thread takes."""


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
            out[np.ix_(qs, es)] = run_tile(batch, qs, state, es)

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
        batch = make_batch(queries, state.spec)
        out = np.empty(len(query_index), queries.values.dtype)
        order = np.lexsort((state.examples.lengths[example_index], query_index))
        borders = np.flatnonzero(np.diff(query_index[order])) + 1

        def compute(chosen: np.ndarray) -> None:
            out[chosen] = run_tile(batch, query_index[chosen[:1]], state, example_index[chosen])[0]

        self._each(compute, [(part,) for group in np.split(order, borders) for part in _cut(group, EXAMPLES)])
        return out

    def gradients(
        self, state: Prepared, queries: SignalBatch, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Soft distances, and the gradients of their weighted sum; see `LaneKernel.gradients`."""
        lanes = GradientLanes()
        return lanes.gradients(lanes.prepare(state.batch, state.spec), queries, weights)

    def _each(self, compute: Callable[..., None], tasks: Sequence[tuple[Any, ...]]) -> None:
        threads = min(self.threads or len(os.sched_getaffinity(0)), len(tasks))
        if threads <= 1:
            for task in tasks:
                compute(*task)
            return
        with ThreadPoolExecutor(threads) as pool:
            for done in [pool.submit(compute, *task) for task in tasks]:
                done.result()


def _cut(order: np.ndarray, size: int) -> list[np.ndarray]:
    return [order[start : start + size] for start in range(0, len(order), size)]


def run_tile(queries: Batch, qs: np.ndarray, state: Prepared, es: np.ndarray) -> np.ndarray:
    """(len(qs), len(es)) float64 distances; ``es`` ascends in length."""
    examples, spec = state.examples, state.spec
    n, m = queries.lengths[qs], examples.lengths[es]
    dtype, rule = queries.values.dtype, make_rule(spec)
    width = queries.values.shape[1] if rule.dependent else 1
    gamma = None if spec.gamma is None else dtype.type(spec.gamma)
    plain = gamma is None and not rule.banded and not rule.dependent
    costs = None if plain else make_costs(width, dtype)
    room = make_room(int(n.max()), int(m[-1]), width, rule.banded, dtype)
    out = np.empty((len(qs), len(es)))
    compiled_tile()(queries, qs, examples, es, rule, make_bands(n, m, spec), gamma, costs, room, out)
    return out


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
        low = high = None
        if lanes.low is not None and lanes.high is not None:
            low, high = _widen(lanes.low, 0), _widen(lanes.high, 0)
        room = make_gradient_room(x, y)
        rule = (lanes.cost != "absolute", lanes.cost == "euclidean")
        compiled_gradients()(x, y, n, m, low, high, gamma, *rule, room)
        return tuple(part[..., : len(lanes)] for part in room[:3])


def _widen(array: np.ndarray, fill: int) -> np.ndarray:
    """The last axis filled up to `LANES`."""
    out = np.full((*array.shape[:-1], LANES), fill, array.dtype)
    out[..., : array.shape[-1]] = array
    return out
