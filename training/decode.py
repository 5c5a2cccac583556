"""Heat maps to keypoints: the highest peak of each map, to a fraction of a cell."""

from __future__ import annotations

import numpy as np


def decode(heat: np.ndarray, stride: float) -> tuple[np.ndarray, np.ndarray]:
    """The highest peak of each heat map, refined by a parabola through its neighbours.

    The centre of cell ``i`` is at ``(i + 0.5) * stride - 0.5`` pixels.

    Parameters
    ----------
    heat : (N, J, h, w) float
    stride : float
        Pixels a cell.

    Returns
    -------
    points : (N, J, 2) float64, pixels
    scores : (N, J) float64, the height of the peak
    """
    n, joints, height, width = heat.shape
    flat = heat.reshape(n, joints, -1)
    best = flat.argmax(axis=2)
    y, x = best // width, best % width
    scores = np.take_along_axis(flat, best[..., None], 2)[..., 0]
    rows, columns = np.arange(n)[:, None], np.arange(joints)[None]

    def shift(axis_value: np.ndarray, limit: int, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        curve = 2 * scores - before - after
        offset = np.where(curve > 1e-6, (after - before) / np.maximum(2 * curve, 1e-6), 0)
        inside = (axis_value > 0) & (axis_value < limit - 1)
        return np.where(inside, np.clip(offset, -0.5, 0.5), 0)

    left = heat[rows, columns, y, np.maximum(x - 1, 0)]
    right = heat[rows, columns, y, np.minimum(x + 1, width - 1)]
    up = heat[rows, columns, np.maximum(y - 1, 0), x]
    down = heat[rows, columns, np.minimum(y + 1, height - 1), x]
    fine_x = x + shift(x, width, left, right)
    fine_y = y + shift(y, height, up, down)
    points = (np.stack([fine_x, fine_y], axis=-1) + 0.5) * stride - 0.5
    return points.astype(np.float64), scores.astype(np.float64)
