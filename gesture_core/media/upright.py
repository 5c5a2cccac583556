"""Turns stored pictures upright and keeps their size constant."""

from __future__ import annotations

import numpy as np


def quarter_turns(degrees: float) -> int:
    """The multiple of 90 in 0..270 that is nearest to ``degrees``."""
    return round(degrees / 90) % 4 * 90


def upright(frame: np.ndarray, rotation: int, mirrored: bool = False) -> np.ndarray:
    """Turn ``frame`` (H, W, 3) clockwise by ``rotation`` degrees (0, 90, 180, 270), then mirror it."""
    turned = frame if rotation == 0 else np.rot90(frame, k=-rotation // 90)
    if mirrored:
        turned = turned[:, ::-1]
    return np.ascontiguousarray(turned)


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
