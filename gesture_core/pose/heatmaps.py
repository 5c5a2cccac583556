"""Peaks of heat maps, refined below the size of a cell."""

from __future__ import annotations

import numpy as np

_FLOOR = 1e-4


def find_peaks(maps: np.ndarray, floor: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All local maxima above ``floor``.

    A cell is a maximum where it exceeds its left and upper neighbours and no other neighbour
    exceeds it, so that of two equal cells exactly one counts. NaN is never a maximum.

    Parameters
    ----------
    maps : (N, J, h, w) float array
    floor : float

    Returns
    -------
    picture, joint : (P,) int arrays
    points : (P, 2) float32
        x, y in cells, counted from the centre of the first cell.
    scores : (P,) float32
        Height of the peak, clipped to 0..1.
    """
    high, wide = maps.shape[2:]
    # Few cells are above the floor, so that looking at their neighbours costs less than comparing maps.
    chosen = np.flatnonzero(maps > floor)
    n, j, y, x = np.unravel_index(chosen, maps.shape)
    row = wide + 2  # with a border below every cell, so that neighbours need no test of the edge
    framed = np.full((*maps.shape[:2], high + 2, row), -np.inf, maps.dtype)
    framed[:, :, 1:-1, 1:-1] = maps
    cells = framed.reshape(-1)
    place = chosen // (high * wide) * (high + 2) * row + (y + 1) * row + x + 1
    here = cells[place]
    peak = np.ones(len(n), bool)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            if (dy, dx) != (0, 0):
                beside = cells[place + (dy * row + dx)]
                # Written so that a neighbour which is no number says nothing.
                peak &= ~(here <= beside) if (dy, dx) < (0, 0) else ~(here < beside)
    n, j, y, x = n[peak], j[peak], y[peak], x[peak]
    return n, j, refine(maps, n, j, y, x), np.clip(here[peak], 0, 1).astype(np.float32)


def top_peaks(maps: np.ndarray, count: int, floor: float) -> np.ndarray:
    """The highest peaks of each map.

    Parameters
    ----------
    maps : (N, J, h, w) float array
    count : int
    floor : float
        Lower peaks are left out.

    Returns
    -------
    (N, J, count, 3) float32
        x, y in cells and the score, the highest first; NaN, NaN, 0 beyond the last peak.
    """
    n, j, points, scores = find_peaks(maps, floor)
    order = np.lexsort((-scores, j, n))
    map_of = (n * maps.shape[1] + j)[order]
    rank = np.arange(len(order)) - np.searchsorted(map_of, map_of)
    found = np.full((*maps.shape[:2], count, 3), np.nan, np.float32)
    found[..., 2] = 0
    order, rank = order[rank < count], rank[rank < count]
    found[n[order], j[order], rank, :2] = points[order]
    found[n[order], j[order], rank, 2] = scores[order]
    return found


def refine(maps: np.ndarray, n: np.ndarray, j: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Sub-cell positions of the peaks at the integer cells ``maps[n, j, y, x]``.

    The peak of a Gaussian is the vertex of the parabola through the logarithms of three
    neighbouring cells, exactly; at the border of a map the cell itself is kept.

    Returns
    -------
    (..., 2) float32, x and y in cells
    """
    high, wide = maps.shape[2:]
    centre = maps[n, j, y, x]
    dx = _vertex(maps[n, j, y, np.maximum(x - 1, 0)], centre, maps[n, j, y, np.minimum(x + 1, wide - 1)])
    dy = _vertex(maps[n, j, np.maximum(y - 1, 0), x], centre, maps[n, j, np.minimum(y + 1, high - 1), x])
    dx = np.where((x > 0) & (x < wide - 1), dx, 0)
    dy = np.where((y > 0) & (y < high - 1), dy, 0)
    return np.stack([x + dx, y + dy], axis=-1).astype(np.float32)


def _vertex(before: np.ndarray, centre: np.ndarray, after: np.ndarray) -> np.ndarray:
    a, b, c = (np.log(np.maximum(v, _FLOOR)) for v in (before, centre, after))
    curve = a - 2 * b + c
    flat = ~(curve < -1e-6)  # NaN too: then the cell itself is kept
    return np.clip(np.where(flat, 0, (a - c) / np.where(flat, 1, 2 * curve)), -0.5, 0.5)
