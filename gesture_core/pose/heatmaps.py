"""Peaks of heat maps, refined below the size of a cell."""

from __future__ import annotations

import numpy as np

_FLOOR = 1e-4


def best_peaks(maps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The highest peak of each map.

    Parameters
    ----------
    maps : (N, J, h, w) float array

    Returns
    -------
    points : (N, J, 2) float32
        x, y in cells, counted from the centre of the first cell.
    scores : (N, J) float32
        Height of the peak, clipped to 0..1.
    """
    pictures, joints, high, wide = maps.shape
    flat = maps.reshape(pictures, joints, high * wide)
    best = flat.argmax(axis=2)
    scores = np.take_along_axis(flat, best[..., None], axis=2)[..., 0]
    y, x = np.divmod(best, wide)
    n, j = np.ogrid[:pictures, :joints]
    points = refine(maps, n, j, y, x)
    return points, np.clip(scores, 0, 1).astype(np.float32)


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
    flat = curve > -1e-6
    return np.clip(np.where(flat, 0, (a - c) / np.where(flat, 1, 2 * curve)), -0.5, 0.5)
