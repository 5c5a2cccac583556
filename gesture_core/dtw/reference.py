"""The float64 reference: plain loops over one pair, what every kernel is tested against.

Written to be read against the definitions, not to be fast. `accumulate` is plain enough for a
compiler of Python loops, which is how the tests run it over long series.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from gesture_core.dtw.bands import allowed_cells
from gesture_core.dtw.spec import DtwSpec


def reference_distance(
    query: np.ndarray,
    example: np.ndarray,
    spec: DtwSpec,
    use: np.ndarray | None = None,
    recursion: Callable[[np.ndarray, np.ndarray, float], np.ndarray] | None = None,
) -> float:
    """The warping distance of one pair.

    Parameters
    ----------
    query, example : (n, D) and (m, D) arrays
    spec : DtwSpec
    use : (D,) bool, optional
        Dimensions to compare; all by default.
    recursion : callable, optional
        A compiled form of `accumulate`.

    Returns
    -------
    float
        Infinity where no dimension is used.
    """
    x, y = np.asarray(query, np.float64), np.asarray(example, np.float64)
    used = np.flatnonzero(np.ones(x.shape[1], bool) if use is None else use)
    if len(used) == 0:
        return math.inf
    cells = allowed_cells(len(x), len(y), spec)
    values = []
    for group in [used] if spec.mode == "dependent" else used[:, None]:
        cost = local_costs(x, y, spec, group)
        value = float((recursion or accumulate)(cost, cells, spec.gamma or 0.0)[-1, -1])
        if spec.length_norm:
            value /= len(x) + len(y)
        values.append(math.sqrt(value) if spec.root else value)
    total = math.fsum(values)
    return total / len(values) if spec.reduce == "mean" else total


def local_costs(x: np.ndarray, y: np.ndarray, spec: DtwSpec, dimensions: np.ndarray) -> np.ndarray:
    """(n, m) float64: the cost of matching each frame of ``x`` with each of ``y`` over ``dimensions``."""
    cost = np.zeros((len(x), len(y)))
    euclidean = spec.cost == "euclidean" and spec.mode == "dependent"
    for d in dimensions:
        weight = 1.0 if spec.weights is None else spec.weights[d]
        difference = np.abs(x[:, d][:, None] - y[:, d][None, :])
        power = 2 if spec.cost == "squared" or euclidean else 1
        cost += weight * difference**power
    if spec.mode == "dependent" and spec.reduce == "mean":
        cost /= len(dimensions)
    return np.sqrt(cost) if euclidean else cost


def accumulate(cost: np.ndarray, cells: np.ndarray, gamma: float) -> np.ndarray:
    """(n, m) float64 table of least accumulated costs; infinity outside ``cells``.

    With ``gamma`` above zero the minimum is soft: ``-gamma * log(sum(exp(-v / gamma)))``
    (Cuturi and Blondel 2017).
    """
    n, m = cost.shape
    table = np.full((n, m), np.inf)
    for i in range(n):
        for j in range(m):
            if not cells[i, j]:
                continue
            if i == 0 and j == 0:
                table[0, 0] = cost[0, 0]
                continue
            up = table[i - 1, j] if i > 0 else np.inf
            left = table[i, j - 1] if j > 0 else np.inf
            diagonal = table[i - 1, j - 1] if i > 0 and j > 0 else np.inf
            least = min(up, left, diagonal)
            if least == np.inf:
                continue
            if gamma > 0:
                total = (
                    math.exp((least - up) / gamma)
                    + math.exp((least - left) / gamma)
                    + math.exp((least - diagonal) / gamma)
                )
                least -= gamma * math.log(total)
            table[i, j] = cost[i, j] + least
    return table
