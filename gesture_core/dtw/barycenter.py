"""Barycenters: one prototype from several examples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.dtw.distances import warping_distances
from gesture_core.dtw.paths import warping_path
from gesture_core.dtw.soft import soft_gradients
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError
from gesture_core.types import SignalBatch

DBA = DtwSpec(mode="dependent", cost="squared", reduce="sum")
SOFT = DBA.replace(gamma=1.0)


def dba(
    series: Sequence[np.ndarray],
    spec: DtwSpec = DBA,
    start: np.ndarray | None = None,
    iterations: int = 30,
    tolerance: float = 1e-6,
) -> np.ndarray:
    """DTW barycenter averaging (Petitjean, Ketterlin and Gançarski 2011).

    Parameters
    ----------
    series : sequence of (T,) or (T, D) arrays
    spec : DtwSpec
        Dependent, squared and hard: what averaging minimises.
    start : (L,) or (L, D) array, optional
        First barycenter, whose length the result has; the medoid of the series by default.
    iterations : int
    tolerance : float
        Stop when the summed cost falls by less than this share.

    Returns
    -------
    (L, D) float64
    """
    if spec.mode != "dependent" or spec.cost != "squared" or spec.gamma is not None:
        raise ConfigError("averaging minimises dependent, squared, hard costs only", code="E_OPTION")
    arrays = _matrices(series)
    center = _medoid(arrays, spec) if start is None else _matrices([start])[0]
    weights = 1.0 if spec.weights is None else np.array(spec.weights)
    last = np.inf
    for _ in range(iterations):
        total, count, cost = np.zeros_like(center), np.zeros(len(center)), 0.0
        for array in arrays:
            path = warping_path(center, array, spec)
            matched = array[path[:, 1]]
            cost += float((weights * (center[path[:, 0]] - matched) ** 2).sum())
            np.add.at(total, path[:, 0], matched)
            np.add.at(count, path[:, 0], 1)
        if cost >= last * (1 - tolerance):
            break
        center, last = total / count[:, None], cost
    return center


def soft_barycenter(
    series: Sequence[np.ndarray],
    spec: DtwSpec = SOFT,
    weights: np.ndarray | None = None,
    start: np.ndarray | None = None,
    iterations: int = 100,
    kernel: str = "auto",
) -> np.ndarray:
    """Soft-DTW barycenter by gradient descent, L-BFGS (Cuturi and Blondel 2017).

    Parameters
    ----------
    series : sequence of (T,) or (T, D) arrays
    spec : DtwSpec
        With a ``gamma``.
    weights : (N,) float, optional
        What each series counts for; equal by default.
    start : (L,) or (L, D) array, optional
        As in `dba`; the medoid by default.

    Returns
    -------
    (L, D) float64
    """
    from scipy.optimize import minimize

    arrays = _matrices(series)
    center = _medoid(arrays, spec.replace(gamma=None)) if start is None else _matrices([start])[0]
    share = np.full(len(arrays), 1 / len(arrays)) if weights is None else np.asarray(weights, np.float64)

    def objective(flat: np.ndarray) -> tuple[float, np.ndarray]:
        found = soft_gradients([flat.reshape(center.shape)], arrays, spec, share[None, :], kernel)
        return float(found.values[0] @ share), found.queries[0].ravel().astype(np.float64)

    best = minimize(objective, center.ravel(), jac=True, method="L-BFGS-B", options={"maxiter": iterations})
    return best.x.reshape(center.shape)


def _matrices(series: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Each as (T, D) float64; an InputError for what cannot be averaged."""
    batch = SignalBatch.of(series, np.float64)
    return [values[:length] for values, length in zip(batch.values, batch.lengths, strict=True)]


def _medoid(arrays: list[np.ndarray], spec: DtwSpec) -> np.ndarray:
    """A copy of the series with the least summed distance to all others; the first of equals."""
    return arrays[int(warping_distances(arrays, arrays, spec).sum(axis=1).argmin())].copy()
