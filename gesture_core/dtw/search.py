"""Exact nearest neighbours with as few cells as possible: bounds first, warpings in their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesture_core.dtw.bands import is_banded, row_bounds
from gesture_core.dtw.bounds import MARGIN, envelope, keogh, kim
from gesture_core.dtw.distances import choose_kernel, make_batches
from gesture_core.dtw.lanes import used_dimensions, weighted
from gesture_core.dtw.pairs import pair_distances
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError
from gesture_core.types import Neighbors, SignalBatch, Signals

ROUND = 32
"""Examples of a query that are warped between two looks at its k-th best distance."""
QUERIES = 256
"""Queries that are searched side by side."""


@dataclass(frozen=True, eq=False)
class Search:
    """The neighbours, and what finding them cost.

    Attributes
    ----------
    neighbors : Neighbors
    kernel : str
        The kernel that computed the distances.
    cells_computed, cells_total : int
        Cells of warping tables inside the band, of the pairs warped and of all pairs.
    """

    neighbors: Neighbors
    kernel: str
    cells_computed: int
    cells_total: int

    @property
    def share(self) -> float:
        """Cells computed, of those that brute force computes."""
        return self.cells_computed / max(1, self.cells_total)


def nearest(
    queries: Sequence[Signals | np.ndarray],
    examples: Sequence[Signals | np.ndarray],
    spec: DtwSpec | None = None,
    k: int = 1,
    kernel: str = "auto",
) -> Neighbors:
    """The k nearest examples of each query: the same as brute force, ties to the lower index."""
    return search(queries, examples, spec, k, kernel).neighbors


def search(
    queries: Sequence[Signals | np.ndarray],
    examples: Sequence[Signals | np.ndarray],
    spec: DtwSpec | None = None,
    k: int = 1,
    kernel: str = "auto",
) -> Search:
    """As `nearest`, with an account of the cells that were computed.

    Soft-DTW has no such bounds; its search is brute force.

    Raises
    ------
    ConfigError
        Where ``k`` is not between 1 and the number of examples.
    """
    spec = DtwSpec() if spec is None else spec
    query_batch, example_batch = make_batches(queries, examples, spec)
    if not 1 <= k <= len(example_batch):
        raise ConfigError(f"k = {k} of {len(example_batch)} examples", code="E_OPTION")
    name, chosen = choose_kernel(kernel, spec)
    state = chosen.prepare(example_batch, spec)
    cells = _cells(query_batch, example_batch, spec)
    if spec.gamma is not None:
        values = np.asarray(chosen.distances(state, query_batch))
        return Search(_rank(values, k), name, int(cells.sum()), int(cells.sum()))
    values = np.full((len(query_batch), len(example_batch)), np.inf, query_batch.values.dtype)
    warped = np.zeros(values.shape, bool)
    limits = lower_bounds(query_batch, example_batch, spec)
    order = np.argsort(limits, axis=1, kind="stable")
    ranked = np.take_along_axis(limits, order, axis=1)
    kth = np.full(len(values), np.inf)
    position = 0
    active = np.arange(len(values))
    while len(active):
        # The next few candidates of every query whose bound still allows a place among the k best.
        ahead = np.broadcast_to(position + np.arange(_step(position, k)), (len(active), _step(position, k)))
        valid = ahead < values.shape[1]
        ahead = np.minimum(ahead, values.shape[1] - 1)
        valid &= ranked[active[:, None], ahead] <= kth[active, None]
        row, column = np.nonzero(valid)
        if len(row) == 0:
            break
        qi, ei = active[row], order[active[row], ahead[row, column]]
        values[qi, ei] = pair_distances(chosen, query_batch, example_batch, spec, qi, ei, state)
        warped[qi, ei] = True
        kth[active] = np.partition(values[active], k - 1, axis=1)[:, k - 1]
        position += ahead.shape[1]
        active = active[valid.all(axis=1)]
    return Search(_rank(values, k), name, int(cells[warped].sum()), int(cells.sum()))


def _step(position: int, k: int) -> int:
    """Few candidates first, to learn the k-th best distance cheaply; then more at a time."""
    return max(k, 1) if position == 0 else max(ROUND, k)


def _rank(values: np.ndarray, k: int) -> Neighbors:
    order = np.argsort(values, axis=1, kind="stable")[:, :k]
    return Neighbors(np.take_along_axis(values, order, axis=1), order.astype(np.int64))


def _cells(queries: SignalBatch, examples: SignalBatch, spec: DtwSpec) -> np.ndarray:
    """(Q, N) cells of each pair's tables inside the band."""
    n, rows = np.unique(queries.lengths, return_inverse=True)
    m, columns = np.unique(examples.lengths, return_inverse=True)
    sizes = np.multiply.outer(n, m)
    if is_banded(spec) and spec.mask is None:
        for i, length in enumerate(n.tolist()):
            for j, other in enumerate(m.tolist()):
                low, high = row_bounds(length, other, spec)
                sizes[i, j] = (high - low).sum()
    cells = sizes[rows[:, None], columns[None, :]]
    if spec.mode == "dependent":
        return cells
    count = np.empty(cells.shape, np.int64)
    every = np.arange(len(examples))
    for query in range(len(queries)):
        count[query] = used_dimensions(queries, examples, np.full(len(every), query), every).sum(axis=1)
    return cells * count


def lower_bounds(queries: SignalBatch, examples: SignalBatch, spec: DtwSpec) -> np.ndarray:
    """(Q, N) float64 numbers that no hard warping distance is below; infinity where it is infinite."""
    squared = spec.cost == "squared" or (spec.cost == "euclidean" and spec.mode == "dependent")
    margin = MARGIN[queries.values.dtype]
    q_values, e_values = (weighted(batch.values, spec).astype(np.float64) for batch in (queries, examples))
    count, every = len(examples), np.arange(len(examples))
    ends = np.stack([e_values[:, 0], e_values[every, examples.lengths - 1]])
    out = np.empty((len(queries), count))
    for n in np.unique(queries.lengths).tolist():
        lower, upper = envelope(e_values, examples.lengths, n, spec)
        single = (examples.lengths == 1) & (n == 1)
        for index in np.flatnonzero(queries.lengths == n):
            use = used_dimensions(queries, examples, np.full(count, index), every)
            x = q_values[index, :n]
            bound = np.maximum(
                kim(x, ends, single, squared, margin), keogh(x, lower, upper, squared, margin)
            )  # fmt: skip
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
