"""Soft-DTW beyond its value: gradients and the divergence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gesture_core.dtw.distances import check_distances, choose_kernel, make_batches
from gesture_core.dtw.lanes import used_dimensions
from gesture_core.dtw.pairs import pair_distances
from gesture_core.dtw.spec import DtwSpec, as_spec
from gesture_core.errors import ConfigError, InputError
from gesture_core.plugin.interfaces import DistanceKernel
from gesture_core.types import SignalBatch, Signals


@dataclass(frozen=True, eq=False)
class SoftGradients:
    """Soft-DTW values, and the gradients of their weighted sum.

    Attributes
    ----------
    values : (Q, N) float
    queries, examples : lists of (T, D) float
        The gradient with respect to each series.
    """

    values: np.ndarray
    queries: list[np.ndarray]
    examples: list[np.ndarray]


def soft_gradients(
    queries: Sequence[Signals | np.ndarray],
    examples: Sequence[Signals | np.ndarray],
    spec: DtwSpec,
    weights: np.ndarray | None = None,
    kernel: str = "auto",
) -> SoftGradients:
    """Values and gradients of soft-DTW (Cuturi and Blondel 2017).

    Parameters
    ----------
    spec : DtwSpec
        With a ``gamma``.
    weights : (Q, N) float, optional
        What each pair counts for in the sum whose gradient is taken; 1 by default.

    Raises
    ------
    ConfigError
        Where ``spec`` has no ``gamma``.
    InputError
        Where ``weights`` have another shape, or are not finite.
    """
    _need_gamma(spec)
    query_batch, example_batch = make_batches(queries, examples, spec)
    name, chosen = _choose(kernel, spec)
    shape = (len(query_batch), len(example_batch))
    shares = np.ones(shape) if weights is None else np.asarray(weights, np.float64)
    if shares.shape != shape or not np.isfinite(shares).all():
        raise InputError(
            f"weights of shape {shares.shape}, expected {shape} finite numbers", code="E_DIMENSIONS"
        )
    state = chosen.prepare(example_batch, spec)
    values, of_queries, of_examples = chosen.gradients(state, query_batch, shares)
    check_distances(values, query_batch, example_batch, name)
    return SoftGradients(values, _split(of_queries, query_batch), _split(of_examples, example_batch))


def _choose(kernel: str, spec: DtwSpec) -> tuple[str, Any]:
    name, chosen = choose_kernel(kernel, spec)
    if hasattr(chosen, "gradients"):
        return name, chosen
    if kernel == "auto":
        return choose_kernel("numpy", spec)
    raise ConfigError(f"kernel {name!r} computes no gradients", remedy="--kernel auto", code="E_OPTION")


def _split(gradient: np.ndarray, batch: SignalBatch) -> list[np.ndarray]:
    return [gradient[index, :length] for index, length in enumerate(batch.lengths)]


def soft_divergence(
    queries: Sequence[Signals | np.ndarray],
    examples: Sequence[Signals | np.ndarray],
    spec: DtwSpec,
    kernel: str = "auto",
) -> np.ndarray:
    """(Q, N) soft-DTW divergence (Blondel, Mensch and Vert 2021).

    The value of each pair less the mean of the values of its two series with themselves, on the
    dimensions that the pair is compared on: zero for equal series, and for squared costs never negative.
    Infinity where a pair has no dimension in common.
    """
    _need_gamma(spec)
    query_batch, example_batch = make_batches(queries, examples, spec)
    name, chosen = choose_kernel(kernel, spec)
    values = np.asarray(chosen.distances(chosen.prepare(example_batch, spec), query_batch))
    check_distances(values, query_batch, example_batch, name)
    qi, ei = (index.reshape(-1) for index in np.indices(values.shape))
    use = used_dimensions(query_batch, example_batch, qi, ei)
    own = _with_itself(chosen, query_batch, qi, use, spec) + _with_itself(
        chosen, example_batch, ei, use, spec
    )
    return values - np.where(use.any(axis=1), own / 2, 0).reshape(values.shape)


def _with_itself(
    kernel: DistanceKernel, batch: SignalBatch, index: np.ndarray, use: np.ndarray, spec: DtwSpec
) -> np.ndarray:
    """(K,) value of series ``index[k]`` with itself on the dimensions ``use[k]``, each computed once."""
    wanted = np.column_stack([index, np.packbits(use, axis=1)])
    _, first, place = np.unique(wanted, axis=0, return_index=True, return_inverse=True)
    which, dimensions = index[first], use[first]
    alone = SignalBatch(batch.values[which], batch.lengths[which], dimensions, dimensions)
    every = np.arange(len(first))
    return pair_distances(kernel, alone, alone, spec, every, every)[place.reshape(-1)]


def _need_gamma(spec: DtwSpec) -> None:
    if as_spec(spec).gamma is None:
        raise ConfigError("soft-DTW without dtw.gamma", remedy="gamma = 1.0", code="E_OPTION")
