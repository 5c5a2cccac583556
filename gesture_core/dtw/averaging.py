"""Averages under warping: one prototype from several series."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.dtw.batches import refuse_one
from gesture_core.dtw.distances import Options, warping_distances
from gesture_core.dtw.paths import warping_path
from gesture_core.dtw.soft import soft_warping_gradient
from gesture_core.dtw.spec import DtwSpec, as_spec
from gesture_core.errors import ConfigError, InputError
from gesture_core.types import SignalBatch

AVERAGING = DtwSpec(mode="dependent", cost="squared", reduce="sum")


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
