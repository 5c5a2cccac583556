"""Distance kernel on Numba: lanes across pairs, the fastest path on a CPU."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gesture_core.dtw.bands import has_holes
from gesture_core.dtw.spec import DtwSpec
from gesture_core.files import usable_cores
from gesture_core.plugin.abilities import GradientKernel, PairKernel, SearchKernel, SubsequenceKernel
from gesture_core.types import SignalBatch
from gesture_dtw_numba.compiled import LANES, ROWS, compiled
from gesture_dtw_numba.layout import Batch, Costs, Rule, aligned, make_bands, make_batch, make_scratch
from gesture_dtw_numba.tile import groups

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import Subsequences

QUERIES, EXAMPLES = 16, 512
"""Size of a tile: the unit that a thread takes."""
GROUPS = 64
"""Queries whose chosen examples a thread takes at once."""

Task = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Groups as `tile.groups` takes them (queries, their cuts, examples, their cuts), and where
in the output each distance belongs."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What `NumbaKernel.prepare` keeps of the examples."""

    batch: SignalBatch
    examples: Batch
    spec: DtwSpec
    rule: Rule


@dataclass(frozen=True)
class NumbaKernel(PairKernel, SearchKernel, GradientKernel, SubsequenceKernel):
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
        return Prepared(examples, make_batch(examples, spec), spec, Rule.of(spec))

    def distances(self, state: Prepared, queries: SignalBatch) -> np.ndarray:
        """(Q, N) distances in the dtype of the batches; infinity where no dimension is shared."""
        count = len(state.batch)
        out = np.empty(len(queries) * count, queries.values.dtype)
        rows = np.argsort(queries.lengths, kind="stable")
        columns = np.argsort(state.batch.lengths, kind="stable")
        tasks: list[Task] = []
        for start in range(0, len(rows), QUERIES):
            for first in range(0, count, EXAMPLES):
                qs, es = rows[start : start + QUERIES], columns[first : first + EXAMPLES]
                place = (qs[:, None] * count + es).reshape(-1)
                tasks.append((qs, np.array([0, len(qs)]), es, np.array([0, len(es)]), place))
        self._run(state, queries, tasks, out)
        return out.reshape(-1, count)

    def pairs(
        self, state: Prepared, queries: SignalBatch, query_index: np.ndarray, example_index: np.ndarray
    ) -> np.ndarray:
        """(K,) distances of chosen pairs, bitwise those of `distances`."""
        return self.within(state, queries, query_index, example_index)

    def within(
        self,
        state: Prepared,
        queries: SignalBatch,
        query_index: np.ndarray,
        example_index: np.ndarray,
        limits: np.ndarray | None = None,
    ) -> np.ndarray:
        """(K,) distances of chosen pairs; infinity for those that are certain to exceed their limit.

        Pairs are abandoned between dimensions, and between bands of rows.
        """
        out = np.empty(len(query_index), queries.values.dtype)
        order = np.lexsort((state.batch.lengths[example_index], query_index))
        starts = np.flatnonzero(np.diff(query_index[order], prepend=-1))
        ends = np.append(starts, len(order))
        tasks: list[Task] = []
        for start in range(0, len(starts), GROUPS):
            cuts = ends[start : start + GROUPS + 1]
            place = order[cuts[0] : cuts[-1]]
            qs = query_index[order[cuts[:-1]]]
            tasks.append((qs, np.arange(len(cuts)), example_index[place], cuts - cuts[0], place))
        self._run(state, queries, tasks, out, limits)
        return out

    def keogh(self, query: np.ndarray, lower: np.ndarray, upper: np.ndarray, squared: bool) -> np.ndarray:
        """(N, D) LB_Keogh of one query (D, n) against envelopes (N, D, n)."""
        out = np.empty(lower.shape[:2])
        keogh(query, lower, upper, squared, out)
        return out

    def gradients(
        self, state: Prepared, queries: SignalBatch, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Soft distances, and the gradients of their weighted sum; see `GradientLaneKernel.gradients`."""
        from gesture_dtw_numba.gradient import GradientLanes

        lanes = GradientLanes()
        return lanes.gradients(lanes.prepare(state.batch, state.spec), queries, weights)

    def subsequences(self, examples: Sequence[np.ndarray], floor: float) -> Subsequences:
        """A stream in which ``examples`` are looked for, in float32."""
        from gesture_dtw_numba.subsequences import NumbaSubsequences

        return NumbaSubsequences(examples, floor, self.threads)

    def _run(
        self,
        state: Prepared,
        queries: SignalBatch,
        tasks: Sequence[Task],
        out: np.ndarray,
        limits: np.ndarray | None = None,
    ) -> None:
        """Compute tasks, in threads where there are several; ``limits`` as in `within`."""
        spec, examples, rule = state.spec, state.examples, state.rule
        batch = make_batch(queries, spec)
        dtype = batch.values.dtype
        width = batch.values.shape[1] if rule.dependent else 1
        square = True if rule.squared else None
        gamma = None if spec.gamma is None else dtype.type(spec.gamma)
        if limits is None or gamma is not None:
            limits = np.empty(0)

        def compute(task: Task) -> None:
            qs, q_cuts, es, e_cuts, place = task
            n, m = batch.lengths[qs], examples.lengths[es]
            costs = None
            if gamma is not None or rule.banded or rule.dependent:
                costs = Costs(aligned((width, LANES), dtype), aligned((ROWS, LANES), dtype))
                costs.share[:] = 1
            scratch = make_scratch(int(n.max()), int(m.max()), width, rule.banded, dtype)
            bands = make_bands(n, m, spec)
            found = np.empty(len(place))
            of_queries, of_examples = (batch, qs, q_cuts), (examples, es, e_cuts)
            groups(*of_queries, *of_examples, rule, bands, square, gamma, costs, limits, scratch, found)
            out[place] = found

        threads = min(self.threads or usable_cores(), len(tasks))
        if threads <= 1:
            for task in tasks:
                compute(task)
            return
        with ThreadPoolExecutor(threads) as pool:
            for done in [pool.submit(compute, task) for task in tasks]:
                done.result()


def _keogh(query: Any, lower: Any, upper: Any, squared: Any, out: Any) -> None:
    count, width, frames = lower.shape
    for example in range(count):
        for d in range(width):
            low, high, x = lower[example, d], upper[example, d], query[d]
            total = 0.0
            if squared:
                for i in range(frames):
                    outside = max(max(x[i] - high[i], low[i] - x[i]), 0.0)
                    total += outside * outside
            else:
                for i in range(frames):
                    total += max(max(x[i] - high[i], low[i] - x[i]), 0.0)
            out[example, d] = total


keogh = compiled(_keogh, fastmath={"reassoc", "nnan", "nsz"})
"""``keogh(query, lower, upper, squared, out)`` sets ``out`` (N, D) to the sums over frames of how far
``query`` (D, n) lies outside ``lower`` and ``upper`` (N, D, n), squared where asked. All float64. The
order of a sum is the compiler's choice: bounds have a margin for it."""
