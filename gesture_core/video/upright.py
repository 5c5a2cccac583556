"""Turns stored pictures upright and keeps their size constant."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

Matrix = tuple[float, float, float, float]


def quarter_turns(degrees: float) -> int:
    """The multiple of 90 in 0..270 that is nearest to ``degrees``."""
    return round(degrees / 90) % 4 * 90


def upright(frame: np.ndarray, rotation: int, mirrored: bool = False) -> np.ndarray:
    """Turn ``frame`` (H, W, 3) clockwise by ``rotation`` degrees (0, 90, 180, 270), then mirror it."""
    turned = frame if rotation == 0 else np.rot90(frame, k=-rotation // 90)
    if mirrored:
        turned = turned[:, ::-1]
    return np.ascontiguousarray(turned)


def display_matrix(frame: Any) -> Matrix | None:
    """a, b, c, d of the display matrix that a PyAV frame carries, None where it carries none."""
    for index in range(len(frame.side_data)):
        item = frame.side_data[index]
        if item.type.name == "DISPLAYMATRIX":
            values = np.frombuffer(bytes(item), np.int32, 9) / 65536
            return float(values[0]), float(values[1]), float(values[3]), float(values[4])
    return None


def orientation(matrix: Matrix | None, counterclockwise: float = 0.0) -> tuple[int, bool]:
    """Clockwise rotation, and whether to mirror after it.

    Parameters
    ----------
    matrix : (a, b, c, d) or None
        Point (x, y) of the stored picture is shown at (a x + c y, b x + d y); ISO 14496-12,
        section 8.2.2.
    counterclockwise : float
        Degrees where there is no matrix.
    """
    if matrix is None:
        return quarter_turns(-counterclockwise), False
    a, b, c, d = matrix
    if a * d - b * c < 0:
        return quarter_turns(math.degrees(math.atan2(b, d))), True
    return quarter_turns(math.degrees(math.atan2(b, a))), False


def fit(frame: np.ndarray, width: int, height: int) -> np.ndarray:
    """Scale ``frame`` into ``width`` x ``height`` pixels, keeping its aspect, on black.

    A recording may change its size half-way (a call that loses bandwidth, a phone that is turned).
    Coordinates of joints must not jump then, nor bodies change their shape.
    """
    import cv2

    scale = min(width / frame.shape[1], height / frame.shape[0])
    inner_width = min(width, max(1, round(frame.shape[1] * scale)))
    inner_height = min(height, max(1, round(frame.shape[0] * scale)))
    left, top = (width - inner_width) // 2, (height - inner_height) // 2
    out = np.zeros((height, width, 3), np.uint8)
    out[top : top + inner_height, left : left + inner_width] = cv2.resize(
        frame, (inner_width, inner_height), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    )
    return out
