"""Soft-DTW beyond its value: gradients and the divergence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gesture_core.dtw.distances import check_distances, choose_kernel, make_batches
from gesture_core.dtw.pairs import pair_distances
from gesture_core.dtw.spec import DtwSpec, as_spec
from gesture_core.errors import ConfigError
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
    """
    _need_gamma(spec)
    query_batch, example_batch = make_batches(queries, examples, spec)
    name, chosen = _choose(kernel, spec)
    if weights is None:
        weights = np.ones((len(query_batch), len(example_batch)))
    state = chosen.prepare(example_batch, spec)
    values, of_queries, of_examples = chosen.gradients(state, query_batch, np.asarray(weights, np.float64))
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

    The value of each pair less the mean of the values of its two series with themselves: zero for
    equal series, and for squared costs never negative.
    """
    _need_gamma(spec)
    query_batch, example_batch = make_batches(queries, examples, spec)
    name, chosen = choose_kernel(kernel, spec)
    values = np.asarray(chosen.distances(chosen.prepare(example_batch, spec), query_batch))
    check_distances(values, query_batch, example_batch, name)
    own = []
    for batch in (query_batch, example_batch):
        index = np.arange(len(batch))
        own.append(pair_distances(chosen, batch, batch, spec, index, index))
    return values - (own[0][:, None] + own[1][None, :]) / 2


def _need_gamma(spec: DtwSpec) -> None:
    if as_spec(spec).gamma is None:
        raise ConfigError("soft-DTW without dtw.gamma", remedy="gamma = 1.0", code="E_OPTION")
