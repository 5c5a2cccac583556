"""FastDTW (Salvador and Chan 2007): an approximation, for fidelity to work that used it.

Every other kernel is exact and faster; this one reproduces the numbers of the `fastdtw`
package, with its windows.
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral

import numpy as np

from gesture_core.dtw.lanes import LaneKernel, Lanes
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError
from gesture_core.plugin.abilities import ApproximateKernel


@dataclass(frozen=True)
class FastDtwKernel(LaneKernel, ApproximateKernel):
    """FastDTW of each lane in plain loops.

    Attributes
    ----------
    radius : int
        Cells around the path of the next coarser resolution that are searched.
    """

    radius: int = 1

    approximation = "FastDTW (Salvador and Chan 2007)"

    def __post_init__(self) -> None:
        if not isinstance(self.radius, Integral) or self.radius < 1:
            raise ConfigError(f"radius = {self.radius!r}", remedy="1, 2, 3 …", code="E_OPTION")

    def supports(self, spec: DtwSpec) -> bool:
        """Hard warping without a band of its own."""
        return spec.gamma is None and spec.window is None and spec.mask is None and spec.shape != "itakura"

    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) accumulated costs."""
        out = np.empty(len(lanes), lanes.x.dtype)
        for p, (n, m) in enumerate(zip(lanes.n.tolist(), lanes.m.tolist(), strict=True)):
            x, y = (side.astype(np.float64) for side in (lanes.x[:n, :, p], lanes.y[:m, :, p]))
            out[p] = fastdtw(x, y, self.radius, lanes.cost)[0]
        return out


def fastdtw(x: np.ndarray, y: np.ndarray, radius: int, cost: str) -> tuple[float, list[tuple[int, int]]]:
    """Approximate warping cost and path of (n, C) and (m, C) series."""
    if len(x) < radius + 2 or len(y) < radius + 2:
        return _windowed(x, y, None, cost)
    _, coarse = fastdtw(_halve(x), _halve(y), radius, cost)
    return _windowed(x, y, _expand(coarse, len(x), len(y), radius), cost)


def _halve(x: np.ndarray) -> np.ndarray:
    """Means of neighbouring frames; an odd last frame is dropped."""
    means: np.ndarray = (x[0 : len(x) - len(x) % 2 : 2] + x[1::2]) / 2
    return means


def _expand(path: list[tuple[int, int]], n: int, m: int, radius: int) -> list[range]:
    """The columns of each row that lie within ``radius`` of the coarse path, in fine cells."""
    around = {
        (i + a, j + b)
        for i, j in path
        for a in range(-radius, radius + 1)
        for b in range(-radius, radius + 1)
    }
    fine = {(2 * i + a, 2 * j + b) for i, j in around for a in (0, 1) for b in (0, 1)}
    rows: list[range] = []
    start = 0
    for i in range(n):
        # The package scans on from the row before's first column and stops at the first gap.
        first = next((j for j in range(start, m) if (i, j) in fine), None)
        if first is None:
            rows.append(range(0))
            continue
        stop = first
        while stop < m and (i, stop) in fine:
            stop += 1
        rows.append(range(first, stop))
        start = first
    return rows


def _windowed(
    x: np.ndarray, y: np.ndarray, rows: list[range] | None, cost: str
) -> tuple[float, list[tuple[int, int]]]:
    """Exact warping inside a window; of equal steps the row's, then the column's, then the diagonal."""
    n, m = len(x), len(y)
    rows = [range(m)] * n if rows is None else rows
    difference = x[:, None] - y[None, :]
    local = (np.abs(difference) if cost == "absolute" else difference**2).sum(axis=2)
    local = np.sqrt(local) if cost == "euclidean" else local
    table: dict[tuple[int, int], tuple[float, tuple[int, int]]] = {(-1, -1): (0.0, (-1, -1))}
    none = (np.inf, (-1, -1))
    for i, columns in enumerate(rows):
        for j in columns:
            steps = ((i - 1, j), (i, j - 1), (i - 1, j - 1))
            before = min(steps, key=lambda step: table.get(step, none)[0])
            table[i, j] = (float(local[i, j]) + table.get(before, none)[0], before)
    path, cell = [], (n - 1, m - 1)
    while cell != (-1, -1):
        path.append(cell)
        cell = table[cell][1]
    return table[n - 1, m - 1][0], path[::-1]
