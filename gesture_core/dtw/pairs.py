"""Distances of chosen pairs, by kernels that know how and by those that only know whole tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from gesture_core.dtw.bounds import MARGIN
from gesture_core.dtw.spec import DtwSpec
from gesture_core.plugin.interfaces import DistanceKernel
from gesture_core.types import SignalBatch


def subset(batch: SignalBatch, index: np.ndarray) -> SignalBatch:
    """The chosen series of ``batch``, in that order."""
    lengths = batch.lengths[index]
    values = batch.values[index, : int(lengths.max())]
    return SignalBatch(values, lengths, batch.masks[index], batch.present[index])


def pair_distances(
    kernel: DistanceKernel,
    queries: SignalBatch,
    examples: SignalBatch,
    spec: DtwSpec,
    query_index: np.ndarray,
    example_index: np.ndarray,
    state: Any = None,
) -> np.ndarray:
    """(K,) distances of the pairs ``(query_index[k], example_index[k])``.

    A kernel may have a method ``pairs(state, queries, query_index, example_index)``; for one that
    has not, each query's examples are a table of one row. ``state`` is what the kernel prepared
    for ``examples``, where the caller has it.
    """
    compute = getattr(kernel, "pairs", None)
    if compute is not None:
        if state is None:
            state = kernel.prepare(examples, spec)
        return np.asarray(compute(state, queries, query_index, example_index))
    out = np.empty(len(query_index), queries.values.dtype)
    order = np.argsort(query_index, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(query_index[order])) + 1):
        chosen = kernel.prepare(subset(examples, example_index[group]), spec)
        out[group] = kernel.distances(chosen, subset(queries, query_index[group[:1]]))[0]
    return out


def distances_within(
    kernel: DistanceKernel,
    queries: SignalBatch,
    examples: SignalBatch,
    spec: DtwSpec,
    query_index: np.ndarray,
    example_index: np.ndarray,
    limits: np.ndarray,
    cells: np.ndarray,
    state: Any = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Hard distances of chosen pairs as far as they matter, and what they cost.

    A kernel may have a method ``within(state, queries, query_index, example_index, limits)`` that
    abandons pairs, between dimensions and between bands of rows, which are certain to exceed their
    query's limit; any other computes them all.

    Parameters
    ----------
    limits : (Q,) float64
        What a distance of each query may be at most.
    cells : (Q, N) int64
        The cells of each pair's tables.

    Returns
    -------
    (K,) float, (K,) int64
        Distances, bitwise those of `pair_distances`, or infinity for pairs that exceed their limit;
        and the cells that were computed.
    """
    compute = getattr(kernel, "within", None)
    if compute is not None:
        state = kernel.prepare(examples, spec) if state is None else state
        # Above the rounding of sums: what equals the limit must not be abandoned.
        roomy = limits * (1 + MARGIN[queries.values.dtype])
        return compute(state, queries, query_index, example_index, roomy)
    found = pair_distances(kernel, queries, examples, spec, query_index, example_index, state)
    return found, cells[query_index, example_index]
