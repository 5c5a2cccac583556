"""The alignment path of one pair."""

from __future__ import annotations

import numpy as np

from gesture_core.dtw.bands import allowed_cells
from gesture_core.dtw.batches import make_batches, used_dimensions
from gesture_core.dtw.reference import local_costs
from gesture_core.dtw.spec import DtwSpec, as_spec
from gesture_core.errors import ConfigError, InputError
from gesture_core.types import Signals


def warping_path(
    query: np.ndarray | Signals,
    example: np.ndarray | Signals,
    spec: DtwSpec | None = None,
    dimension: int | None = None,
) -> np.ndarray:
    """The path of least cost between two series (Sakoe and Chiba 1978).

    Parameters
    ----------
    query, example : Signals or (n,) or (n, D), (m,) or (m, D) arrays
    spec : DtwSpec, optional
        Dependent mode warps all dimensions together; independent mode, the default as in
        `warping_distances`, has one path for each.
    dimension : int, optional
        Which path, in independent mode; may be left out where D is 1.

    Returns
    -------
    (K, 2) int64
        Pairs of frames (query, example) from (0, 0) to (n - 1, m - 1). Of equal steps the diagonal
        is taken first, then the query's.

    Raises
    ------
    ConfigError
        For soft warping, and where ``dimension`` is missing, too many, or not compared.
    InputError
        As `warping_distances`; in dependent mode also where the two have no dimension in common.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import warping_path
    >>> warping_path(np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 1.0])).tolist()
    [[0, 0], [1, 0], [2, 1], [2, 2]]
    """
    spec = as_spec(spec)
    if spec.gamma is not None:
        raise ConfigError("soft-DTW has no single path", remedy="gamma = none", code="E_OPTION")
    queries, examples = make_batches([query], [example], spec)
    every = np.flatnonzero(used_dimensions(queries, examples, np.array([0]), np.array([0]))[0])
    chosen = _chosen(every, queries.values.shape[2], spec, dimension)
    x, y = (batch.values[0].astype(np.float64) for batch in (queries, examples))
    cost = local_costs(x, y, spec, chosen)
    return backtrack(least_costs(cost, allowed_cells(len(x), len(y), spec)))


def _chosen(every: np.ndarray, width: int, spec: DtwSpec, dimension: int | None) -> np.ndarray:
    """The dimensions that are warped together, of ``every`` one that the two are compared on."""
    if spec.mode == "dependent":
        if dimension is not None:
            raise ConfigError("dependent warping has one path for all dimensions", code="E_OPTION")
        if len(every) == 0:
            raise InputError("the two have no dimension in common", code="E_NO_COMMON")
        return every
    if dimension is None and width > 1:
        raise ConfigError(
            f"which of {width} dimensions?", remedy="dimension=, or mode='dependent'", code="E_OPTION"
        )
    if (dimension or 0) not in every.tolist():
        raise ConfigError(f"dimension = {dimension}", remedy=f"one of {every.tolist()}", code="E_OPTION")
    return np.array([dimension or 0])


def least_costs(cost: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(..., n, m) accumulated costs of local costs of that shape inside (n, m) ``cells``, by diagonals."""
    *many, n, m = cost.shape
    table = np.full((*many, n + 1, m + 1), np.inf)
    table[..., 0, 0] = 0
    cost = np.where(cells, cost, np.inf)
    for k in range(n + m - 1):
        i = np.arange(max(0, k - m + 1), min(n, k + 1))
        j = k - i
        before = np.minimum(np.minimum(table[..., i, j + 1], table[..., i + 1, j]), table[..., i, j])
        table[..., i + 1, j + 1] = cost[..., i, j] + before
    return table[..., 1:, 1:]


def backtrack(table: np.ndarray) -> np.ndarray:
    """(K, 2) int64: the path that a table of accumulated costs holds."""
    costs = table.tolist()
    i, j = table.shape[0] - 1, table.shape[1] - 1
    path = [(i, j)]
    while i or j:
        if not i:
            j -= 1
        elif not j:
            i -= 1
        else:  # of equal steps the diagonal, then the query's
            diagonal, up, left = costs[i - 1][j - 1], costs[i - 1][j], costs[i][j - 1]
            if diagonal <= up and diagonal <= left:
                i, j = i - 1, j - 1
            elif up <= left:
                i -= 1
            else:
                j -= 1
        path.append((i, j))
    return np.array(path[::-1], np.int64)
