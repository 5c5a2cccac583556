"""Soft-DTW: values, gradients and the divergence; and barycenters, of soft or hard distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.dtw.batches import Series, make_batches, refuse_one, used_dimensions
from gesture_core.dtw.distances import (
    Options,
    cells_of,
    check_distances,
    choose_kernel,
    pair_distances,
    warping_distances,
)
from gesture_core.dtw.paths import warping_path
from gesture_core.dtw.spec import DtwSpec, as_spec
from gesture_core.errors import ConfigError, InputError
from gesture_core.plugin.abilities import GradientKernel
from gesture_core.types import SignalBatch

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import DistanceKernel

SOFT = DtwSpec(mode="dependent", cost="squared", reduce="sum", gamma=1.0)
"""The specification of Cuturi and Blondel, and of tslearn."""
AVERAGING = DtwSpec(mode="dependent", cost="squared", reduce="sum")


def soft_warping(
    queries: Series,
    examples: Series,
    spec: DtwSpec = SOFT,
    kernel: str = "auto",
    options: Options | None = None,
) -> np.ndarray:
    """Soft-DTW between every query and every example (Cuturi and Blondel 2017).

    Parameters
    ----------
    queries, examples : sequences of Signals or (T,) or (T, D) arrays
    spec : DtwSpec
        With a ``gamma``; by default dependent, squared costs, their sum, and a softness of 1.
    kernel, options
        As in `warping_distances`, and so are the errors.

    Returns
    -------
    (Q, N) float array
        In the unit of the costs; may be negative. Infinity where a pair has no dimension in common.

    Raises
    ------
    ConfigError
        Where ``spec`` has no ``gamma``.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import soft_warping
    >>> soft_warping([np.array([0.0, 1.0])], [np.array([0.0, 2.0])], kernel="numpy").round(3).tolist()
    [[0.673]]
    """
    return warping_distances(queries, examples, _soft(spec), kernel, options)


@dataclass(frozen=True, eq=False)
class SoftGradient:
    """Soft-DTW values, and the gradient of their weighted sum.

    Attributes
    ----------
    values : (Q, N) float
    queries, examples : lists of (T, D) float
        The gradient with respect to each series.
    """

    values: np.ndarray
    queries: list[np.ndarray]
    examples: list[np.ndarray]


def soft_warping_gradient(
    queries: Series,
    examples: Series,
    spec: DtwSpec = SOFT,
    weights: np.ndarray | None = None,
    kernel: str = "auto",
    options: Options | None = None,
) -> SoftGradient:
    """Values and gradients of soft-DTW (Cuturi and Blondel 2017).

    Parameters
    ----------
    queries, examples, spec, kernel, options
        As in `soft_warping`, and so are the errors.
    weights : (Q, N) float, optional
        What each pair counts for in the sum whose gradient is taken; 1 by default.

    Returns
    -------
    SoftGradient
        Zero in dimensions that no pair of a series is compared on.

    Raises
    ------
    ConfigError
        Where ``spec`` has no ``gamma``, or ``kernel`` computes no gradients.
    InputError
        Where ``weights`` have another shape, or are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import soft_warping_gradient
    >>> found = soft_warping_gradient([np.array([0.0, 1.0])], [np.array([0.0, 2.0])], kernel="numpy")
    >>> found.queries[0].round(3).tolist()
    [[-0.053], [-1.469]]
    """
    spec = _soft(spec)
    query_batch, example_batch = make_batches(queries, examples, spec)
    name, chosen = choose_kernel(kernel, spec, options, cells_of(query_batch, example_batch))
    if not isinstance(chosen, GradientKernel):
        raise ConfigError(f"kernel {name!r} computes no gradients", remedy="--kernel auto", code="E_OPTION")
    shape = (len(query_batch), len(example_batch))
    shares = np.ones(shape) if weights is None else np.asarray(weights, np.float64)
    if shares.shape != shape or not np.isfinite(shares).all():
        raise InputError(
            f"weights of shape {shares.shape}, expected {shape} finite numbers", code="E_DIMENSIONS"
        )
    values, *slopes = chosen.gradients(chosen.prepare(example_batch, spec), query_batch, shares)
    check_distances(values, query_batch, example_batch, name)
    of_queries, of_examples = (
        [series[:length] for series, length in zip(slope, batch.lengths, strict=True)]
        for slope, batch in zip(slopes, (query_batch, example_batch), strict=True)
    )
    return SoftGradient(values, of_queries, of_examples)


def soft_divergence(
    queries: Series,
    examples: Series,
    spec: DtwSpec = SOFT,
    kernel: str = "auto",
    options: Options | None = None,
) -> np.ndarray:
    """The soft-DTW divergence (Blondel, Mensch and Vert 2021).

    The value of each pair less the mean of the values of its two series with themselves, on the
    dimensions that the pair is compared on: zero for equal series, and for squared costs never negative.

    Parameters
    ----------
    queries, examples, spec, kernel, options
        As in `soft_warping`, and so are the errors.

    Returns
    -------
    (Q, N) float array
        Infinity where a pair has no dimension in common.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import soft_divergence
    >>> rise = np.array([0.0, 1.0, 2.0])
    >>> soft_divergence([rise], [rise, rise + 1], kernel="numpy").round(3).tolist()
    [[0.0, 2.137]]
    """
    spec = _soft(spec)
    query_batch, example_batch = make_batches(queries, examples, spec)
    name, chosen = choose_kernel(kernel, spec, options, cells_of(query_batch, example_batch))
    values = np.asarray(chosen.distances(chosen.prepare(example_batch, spec), query_batch))
    check_distances(values, query_batch, example_batch, name)
    qi, ei = (index.reshape(-1) for index in np.indices(values.shape))
    use = used_dimensions(query_batch, example_batch, qi, ei)
    own = _with_itself(chosen, query_batch, qi, use, spec)
    own += _with_itself(chosen, example_batch, ei, use, spec)
    divergence: np.ndarray = values - np.where(use.any(axis=1), own / 2, 0).reshape(values.shape)
    return divergence


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


def _soft(spec: DtwSpec) -> DtwSpec:
    """``spec``, which must have a softness."""
    if as_spec(spec).gamma is None:
        raise ConfigError("soft-DTW without dtw.gamma", remedy="gamma = 1.0", code="E_OPTION")
    return spec


def barycenter(
    series: Sequence[np.ndarray],
    spec: DtwSpec = AVERAGING,
    weights: Sequence[float] | np.ndarray | None = None,
    start: np.ndarray | None = None,
    iterations: int = 100,
    tolerance: float = 1e-6,
    kernel: str = "auto",
    options: Options | None = None,
) -> np.ndarray:
    """The series with the least weighted sum of distances to all of ``series``, locally.

    For a hard specification by DTW barycenter averaging (Petitjean, Ketterlin and Gançarski 2011),
    for one with a ``gamma`` by L-BFGS on soft-DTW (Cuturi and Blondel 2017).

    Parameters
    ----------
    series : sequence of N (T,) or (T, D) arrays
    spec : DtwSpec
        Averaging minimises dependent squared costs only; a soft specification may be any.
    weights : (N,) float, optional
        What each series counts for, not negative; equal by default.
    start : (L,) or (L, D) array, optional
        First barycenter, whose length the result has; the medoid of the series by default.
    iterations : int
    tolerance : float
        Stop when the sum falls by less than this share.
    kernel, options
        As in `warping_distances`, and so are the errors.

    Returns
    -------
    (L, D) float64
        In the unit of the series.

    Raises
    ------
    ConfigError
        Where ``spec`` is hard, and not dependent with squared costs.
    InputError
        Where a series cannot be averaged, or ``weights`` do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import barycenter
    >>> early, late = np.array([0.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.2, 0.0])
    >>> barycenter([early, late], kernel="numpy")[:, 0].round(3).tolist()
    [0.0, 1.1, 0.0, 0.0]
    """
    spec = as_spec(spec)
    if spec.gamma is None and (spec.mode != "dependent" or spec.cost != "squared"):
        raise ConfigError(
            "averaging minimises dependent, squared costs only",
            remedy="mode='dependent' and cost='squared', or a gamma",
            code="E_OPTION",
        )
    arrays = _matrices(series)
    share = np.full(len(arrays), 1 / len(arrays)) if weights is None else np.asarray(weights, np.float64)
    if share.shape != (len(arrays),) or not (np.isfinite(share).all() and share.min() >= 0 < share.max()):
        raise InputError(
            f"weights {share.tolist()}, expected {len(arrays)} numbers, none negative and one above zero",
            code="E_DIMENSIONS",
        )
    if start is None:
        among = warping_distances(arrays, arrays, spec.replace(gamma=None), kernel, options)
        center = arrays[int((among * share).sum(axis=1).argmin())].copy()
    else:
        (center,) = _matrices([start])
    if spec.gamma is not None:
        from scipy.optimize import minimize

        def objective(flat: np.ndarray) -> tuple[float, np.ndarray]:
            one = [flat.reshape(center.shape)]
            found = soft_warping_gradient(one, arrays, spec, share[None, :], kernel, options)
            return float(found.values[0] @ share), found.queries[0].ravel()

        limits = {"maxiter": iterations, "ftol": tolerance}
        best = minimize(objective, center.ravel(), jac=True, method="L-BFGS-B", options=limits)
        return np.asarray(best.x).reshape(center.shape)
    factors = 1.0 if spec.weights is None else np.array(spec.weights)
    last = np.inf
    for _ in range(iterations):
        total, count, cost = np.zeros_like(center), np.zeros(len(center)), 0.0
        for array, part in zip(arrays, share, strict=True):
            path = warping_path(center, array, spec)
            matched = array[path[:, 1]]
            cost += part * float((factors * (center[path[:, 0]] - matched) ** 2).sum())
            np.add.at(total, path[:, 0], part * matched)
            np.add.at(count, path[:, 0], part)
        if cost >= last * (1 - tolerance):
            break
        center, last = total / count[:, None], cost
    return center


def _matrices(series: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Each as (T, D) float64; an InputError for what cannot be averaged."""
    refuse_one(series)
    batch = SignalBatch.of(series, np.float64)
    return [values[:length] for values, length in zip(batch.values, batch.lengths, strict=True)]
