"""Exact nearest neighbours with as few cells as possible: bounds first, warpings in their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np

from gesture_core.dtw.bands import cell_counts, is_banded
from gesture_core.dtw.bounds import keogh, lower_bounds
from gesture_core.dtw.distances import choose_kernel, make_batches
from gesture_core.dtw.lanes import used_dimensions
from gesture_core.dtw.pairs import distances_within, subset
from gesture_core.dtw.spec import DtwSpec, as_spec
from gesture_core.errors import ConfigError
from gesture_core.plugin.interfaces import DistanceKernel
from gesture_core.types import Neighbors, SignalBatch, Signals

ROUND = 32
"""Examples of a query that are warped, at least, between two looks at its k-th best distance."""
PAIRS_AT_ONCE = 1 << 22
"""Pairs whose bounds are held at once; more queries follow in parts."""
REST = 0.5
"""Where the bounds allow more than this share of what is left, all of it is warped at once."""


@dataclass(frozen=True, eq=False)
class Search:
    """The neighbours, and what finding them cost.

    Attributes
    ----------
    neighbors : Neighbors
    kernel : str
        The kernel that computed the distances.
    cells_computed, cells_total : int
        Cells of warping tables inside the band: those computed, and those of all pairs.
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
        Where ``k`` is no whole number between 1 and the number of examples.
    """
    spec = as_spec(spec)
    query_batch, example_batch = make_batches(queries, examples, spec)
    if not isinstance(k, Integral) or not 1 <= k <= len(example_batch):
        raise ConfigError(f"k = {k} of {len(example_batch)} examples", code="E_OPTION")
    name, chosen = choose_kernel(kernel, spec)
    state = chosen.prepare(example_batch, spec)
    size = max(1, PAIRS_AT_ONCE // len(example_batch))
    parts = [
        _part(chosen, state, subset(query_batch, index), example_batch, spec, k)
        for index in np.split(np.arange(len(query_batch)), range(size, len(query_batch), size))
    ]
    distances, indices = (
        np.concatenate([getattr(part[0], side) for part in parts]) for side in ("distances", "indices")
    )
    spent, total = sum(part[1] for part in parts), sum(part[2] for part in parts)
    return Search(Neighbors(distances, indices), name, spent, total)


def _part(
    kernel: DistanceKernel, state: Any, queries: SignalBatch, examples: SignalBatch, spec: DtwSpec, k: int
) -> tuple[Neighbors, int, int]:
    """The neighbours of some queries, the cells computed for them, and all of their cells."""
    cells = _cells(queries, examples, spec)
    total = int(cells.sum())
    if spec.gamma is not None:
        return _rank(np.asarray(kernel.distances(state, queries)), k), total, total
    limits = lower_bounds(queries, examples, spec, getattr(kernel, "keogh", keogh))
    order = np.argsort(limits, axis=1, kind="stable")
    ranked = np.take_along_axis(limits, order, axis=1)
    values = np.full(limits.shape, np.inf, queries.values.dtype)
    best = np.full((len(values), k), np.inf)
    spent, position, step = 0, 0, k
    active = np.arange(len(values))
    while len(active) and position < values.shape[1]:
        # The next candidates of every query whose bound still allows a place among the k best.
        ahead = slice(position, position + step)
        row, column = np.nonzero(ranked[active, ahead] <= best[active, -1:])
        qi, ei = active[row], order[active, ahead][row, column]
        found, computed = distances_within(
            kernel, queries, examples, spec, qi, ei, best[:, -1], cells, state
        )  # fmt: skip
        values[qi, ei] = found
        spent += int(computed.sum())
        seen = np.full((len(active), k + step), np.inf)
        seen[:, :k] = best[active]
        seen[row, k + column] = found
        best[active] = np.sort(np.partition(seen, k - 1, axis=1)[:, :k], axis=1)
        position += step
        # Few candidates first, to learn the k-th best distance cheaply; then more at a time.
        step = max(ROUND, position // 4)
        if position < values.shape[1]:
            active = active[ranked[active, position] <= best[active, -1]]
            allowed = (ranked[active, position:] <= best[active, -1:]).mean() if len(active) else 0
            if position > ROUND and allowed > REST:
                step = values.shape[1]
    return _nearest(values, best[:, -1], k), spent, total


def _rank(values: np.ndarray, k: int) -> Neighbors:
    order = np.argsort(values, axis=1, kind="stable")[:, :k]
    return Neighbors(np.take_along_axis(values, order, axis=1), order.astype(np.int64))


def _nearest(values: np.ndarray, worst: np.ndarray, k: int) -> Neighbors:
    """The k least of each row, none of which is above ``worst``; ties go to the lower column."""
    rows, columns = np.nonzero(values <= worst[:, None])
    order = np.lexsort((columns, values[rows, columns], rows))
    starts = np.flatnonzero(np.diff(rows, prepend=-1))
    chosen = order[starts[:, None] + np.arange(k)]
    return Neighbors(values[rows[chosen], columns[chosen]], columns[chosen].astype(np.int64))


def _cells(queries: SignalBatch, examples: SignalBatch, spec: DtwSpec) -> np.ndarray:
    """(Q, N) cells of each pair's tables inside the band."""
    n, rows = np.unique(queries.lengths, return_inverse=True)
    m, columns = np.unique(examples.lengths, return_inverse=True)
    sizes = np.multiply.outer(n, m)
    if is_banded(spec):
        for i, length in enumerate(n.tolist()):
            sizes[i] = cell_counts(length, m, spec)
    cells = sizes[rows[:, None], columns[None, :]]
    if spec.mode == "dependent":
        return cells
    count = np.empty(cells.shape, np.int64)
    every = np.arange(len(examples))
    for query in range(len(queries)):
        count[query] = used_dimensions(queries, examples, np.full(len(every), query), every).sum(axis=1)
    return cells * count
