"""Alignment paths of chosen pairs."""

from __future__ import annotations

import numpy as np

from gesture_core.dtw.bands import allowed_cells, check_feasible
from gesture_core.dtw.reference import local_costs
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError, WarpingError


def warping_path(
    query: np.ndarray, example: np.ndarray, spec: DtwSpec | None = None, dimension: int | None = None
) -> np.ndarray:
    """The path of least cost between two series.

    Parameters
    ----------
    query, example : (n,) or (n, D), (m,) or (m, D) arrays
    spec : DtwSpec, optional
        Dependent mode warps all dimensions together; independent mode has one path for each.
    dimension : int, optional
        Which path, in independent mode; may be left out where D is 1.

    Returns
    -------
    (K, 2) int64
        Pairs of frames (query, example) from (0, 0) to (n - 1, m - 1). Of equal steps the diagonal
        is taken first, then the query's.
    """
    spec = DtwSpec(mode="dependent") if spec is None else spec
    x, y = (np.asarray(series, np.float64) for series in (query, example))
    x, y = (series[:, None] if series.ndim == 1 else series for series in (x, y))
    if spec.gamma is not None:
        raise ConfigError("soft-DTW has no single path", remedy="gamma = none", code="E_OPTION")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise WarpingError("a series holds NaN or infinity", code="E_NOT_FINITE")
    if spec.mode == "dependent":
        dimensions = np.arange(x.shape[1])
    elif dimension is None and x.shape[1] > 1:
        raise ConfigError(f"which of {x.shape[1]} dimensions?", remedy="dimension=", code="E_OPTION")
    else:
        dimensions = np.array([dimension or 0])
    check_feasible(np.array([len(x)]), np.array([len(y)]), spec)
    cost = local_costs(x, y, spec, dimensions)
    return backtrack(least_costs(cost, allowed_cells(len(x), len(y), spec)))


def least_costs(cost: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(n, m) accumulated costs of (n, m) local costs, a diagonal at a time."""
    n, m = cost.shape
    cost = np.where(cells, cost, np.inf)
    table = np.full((n + 1, m + 1), np.inf)
    table[0, 0] = 0
    for k in range(n + m - 1):
        i = np.arange(max(0, k - m + 1), min(n, k + 1))
        j = k - i
        before = np.minimum(np.minimum(table[i, j + 1], table[i + 1, j]), table[i, j])
        table[i + 1, j + 1] = cost[i, j] + before
    return table[1:, 1:]


def backtrack(table: np.ndarray) -> np.ndarray:
    """(K, 2) int64: the path that a table of accumulated costs holds."""
    i, j = table.shape[0] - 1, table.shape[1] - 1
    path = [(i, j)]
    while i or j:
        steps = [(i - 1, j - 1), (i - 1, j), (i, j - 1)]
        i, j = min((step for step in steps if min(step) >= 0), key=lambda step: table[step])
        path.append((i, j))
    return np.array(path[::-1], np.int64)
