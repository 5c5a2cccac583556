"""Distances of chosen pairs, by kernels that know how and by those that only know whole tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from gesture_core.dtw.spec import DtwSpec
from gesture_core.plugin.kinds import DistanceKernel
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
