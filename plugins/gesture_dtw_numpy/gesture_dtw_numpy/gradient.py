"""Soft warpings of many lanes and their gradients, in NumPy."""

from __future__ import annotations

import numpy as np

from gesture_core.dtw.lanes import Lanes


def lane_gradients(lanes: Lanes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values and gradients of P soft warpings: Cuturi and Blondel's recursions (2017), cell by cell.

    The second one in the shares that each cell's soft minimum gives to its three predecessors: unlike
    the exponential of a difference of accumulated costs, they do not lose what cancels.

    Returns
    -------
    (P,), (n_max, C, P), (m_max, C, P)
    """
    x, y, n, m, cost, gamma = lanes.x, lanes.y, lanes.n, lanes.m, lanes.cost, lanes.gamma
    assert gamma is not None
    cells = _inside(lanes)
    rows, columns, count = len(x), len(y), len(lanes)
    difference = x[:, None] - y[None, :]
    local = (np.abs(difference) if cost == "absolute" else difference**2).sum(axis=2)
    local = np.sqrt(local) if cost == "euclidean" else local
    table = np.full((rows + 1, columns + 1, count), np.inf)
    table[0, 0] = 0
    shares = np.zeros((rows, columns, 3, count))
    for i in range(rows):
        for j in range(columns):
            three = np.stack([table[i, j + 1], table[i + 1, j], table[i, j]])
            least = three.min(axis=0)
            open_ = cells[i, j] & np.isfinite(least)
            with np.errstate(over="ignore", invalid="ignore"):
                parts = np.exp(np.where(open_, (least - three) / gamma, 0))
            whole = parts.sum(axis=0)
            table[i + 1, j + 1] = np.where(open_, local[i, j] + least - gamma * np.log(whole), np.inf)
            shares[i, j] = np.where(open_, parts / whole, 0)
    # How much each cell's value moves the lane's: one at its end, else what its successors hand on.
    moved = np.zeros_like(table)
    moved[n, m, np.arange(count)] = 1
    for i in reversed(range(rows)):
        for j in reversed(range(columns)):
            given = moved[i + 1, j + 1] * shares[i, j]
            for (a, b), part in zip(((i, j + 1), (i + 1, j), (i, j)), given, strict=True):
                moved[a, b] += part
    slope = _slope(difference, local, cost) * moved[1:, 1:, None]
    return table[n, m, np.arange(count)], slope.sum(axis=1), -slope.sum(axis=0)


def _inside(lanes: Lanes) -> np.ndarray:
    """(n_max, m_max, P) bool: the cells inside each lane's lengths and band."""
    row, column = np.arange(len(lanes.x))[:, None, None], np.arange(len(lanes.y))[None, :, None]
    cells: np.ndarray = (row < lanes.n) & (column < lanes.m)
    if lanes.low is not None and lanes.high is not None:
        cells &= (column >= lanes.low[:, None]) & (column < lanes.high[:, None])
    if lanes.cells is not None:
        cells &= lanes.cells
    return cells


def _slope(difference: np.ndarray, local: np.ndarray, cost: str) -> np.ndarray:
    """(n, m, C, P) derivative of the local cost; zero where a cost has a kink."""
    if cost == "absolute":
        return np.asarray(np.sign(difference))
    if cost == "squared":
        return 2 * difference
    safe = np.where(local > 0, local, 1)
    return np.where(local[:, :, None] > 0, difference / safe[:, :, None], 0)
