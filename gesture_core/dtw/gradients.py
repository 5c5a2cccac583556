"""Soft warpings of many lanes and their gradients, in NumPy."""

from __future__ import annotations

import numpy as np


def lane_gradients(
    x: np.ndarray,
    y: np.ndarray,
    n: np.ndarray,
    m: np.ndarray,
    cells: np.ndarray,
    gamma: np.ndarray,
    cost: str,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values and gradients of P soft warpings: Cuturi and Blondel's recursions, cell by cell.

    The second one in the shares that each cell's soft minimum gives to its three predecessors: unlike
    the exponential of a difference of accumulated costs, they do not lose what cancels.

    Parameters
    ----------
    x, y : (n_max, C, P) and (m_max, C, P) float
    n, m : (P,) int
    cells : (n_max, m_max, P) bool
        Cells inside each lane's band and lengths.
    gamma : (P,) float
    cost : str

    Returns
    -------
    (P,), (n_max, C, P), (m_max, C, P)
    """
    rows, columns, lanes = len(x), len(y), x.shape[2]
    difference = x[:, None] - y[None, :]
    local = (np.abs(difference) if cost == "absolute" else difference**2).sum(axis=2)
    local = np.sqrt(local) if cost == "euclidean" else local
    table = np.full((rows + 1, columns + 1, lanes), np.inf)
    table[0, 0] = 0
    shares = np.zeros((rows, columns, 3, lanes))
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
    moved[n, m, np.arange(lanes)] = 1
    for i in reversed(range(rows)):
        for j in reversed(range(columns)):
            given = moved[i + 1, j + 1] * shares[i, j]
            for (a, b), part in zip(((i, j + 1), (i + 1, j), (i, j)), given, strict=True):
                moved[a, b] += part
    slope = _slope(difference, local, cost) * moved[1:, 1:, None]
    return table[n, m, np.arange(lanes)], slope.sum(axis=1), -slope.sum(axis=0)


def _slope(difference: np.ndarray, local: np.ndarray, cost: str) -> np.ndarray:
    """(n, m, C, P) derivative of the local cost; zero where a cost has a kink."""
    if cost == "absolute":
        return np.sign(difference)
    if cost == "squared":
        return 2 * difference
    safe = np.where(local > 0, local, 1)
    return np.where(local[:, :, None] > 0, difference / safe[:, :, None], 0)
