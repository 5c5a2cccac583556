"""Brings pictures of any size into the input of a network, and points back into the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesture_core.pose.contracts import ModelContract

MAX_ASPECT = 3.0
"""A free input is at most this much wider than high; wider pictures are letterboxed into it."""


@dataclass(frozen=True)
class Letterbox:
    """How a picture lies in the network's input: scaled by `scale`, then moved by `left`, `top`.

    Both ends count coordinates from the centre of the first pixel, as cv2.resize does, so that
    ``input = (picture + 0.5) * scale - 0.5 + offset``.
    """

    width: int
    height: int
    scale_x: float
    scale_y: float
    left: int
    top: int
    inner_width: int
    inner_height: int

    @classmethod
    def fit(cls, frame_size: tuple[int, int], input_size: tuple[int, int]) -> Letterbox:
        """The largest undistorted, centred copy of a (width, height) picture in (height, width)."""
        width, height = frame_size
        high, wide = input_size
        scale = min(wide / width, high / height)
        inner_width = min(wide, max(1, round(width * scale)))
        inner_height = min(high, max(1, round(height * scale)))
        return cls(
            wide,
            high,
            inner_width / width,
            inner_height / height,
            (wide - inner_width) // 2,
            (high - inner_height) // 2,
            inner_width,
            inner_height,
        )

    def back(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) points of the input as points of the picture."""
        scale = np.array([self.scale_x, self.scale_y], np.float32)
        offset = np.array([self.left, self.top], np.float32)
        return ((points - offset + 0.5) / scale - 0.5).astype(np.float32)


def input_size(contract: ModelContract, frame_size: tuple[int, int], size: int | None) -> tuple[int, int]:
    """(height, width) of the input for a (width, height) picture.

    A free input has the height `size` and the picture's aspect ratio, both rounded up to the
    network's multiple, as OpenPose does (``net_resolution -1x368``).
    """
    if contract.input_size is not None:
        return contract.input_size
    step = contract.multiple
    width, height = frame_size
    high = _up(size or contract.default_size, step)
    wide = _up(round(high * min(width / height, MAX_ASPECT)), step)
    return high, max(wide, step)


def _up(value: int, step: int) -> int:
    return -(-value // step) * step


def to_batch(frames: Sequence[np.ndarray], box: Letterbox, contract: ModelContract) -> np.ndarray:
    """The input of the network for ``frames``, (H, W, 3) uint8 in BGR, all of one size.

    Returns
    -------
    (N, 3, H, W) or (N, H, W, 3) array of the contract's dtype
    """
    pictures = np.full((len(frames), box.height, box.width, 3), contract.pad, np.uint8)
    rows = slice(box.top, box.top + box.inner_height)
    columns = slice(box.left, box.left + box.inner_width)
    for picture, frame in zip(pictures, frames, strict=True):
        picture[rows, columns] = _scaled(frame, box.inner_width, box.inner_height)
    order = (0, 1, 2) if contract.colour == "bgr" else (2, 1, 0)
    high, wide = box.height, box.width
    shape = (len(frames), 3, high, wide) if contract.channels_first else (len(frames), high, wide, 3)
    batch = np.empty(shape, contract.dtype)
    for target, channel in enumerate(order):
        plane = batch[:, target] if contract.channels_first else batch[..., target]
        plane[...] = pictures[..., channel]
        if contract.mean[target]:
            plane -= contract.mean[target]
        if contract.scale[target] != 1:
            plane *= contract.scale[target]
    return batch


def _scaled(frame: np.ndarray, wide: int, high: int) -> np.ndarray:
    """``frame`` in another size: halved by averaging as long as possible, then interpolated.

    Interpolation alone would drop thin limbs, and averaging to any size takes six times as long.
    """
    import cv2

    while frame.shape[1] >= 2 * wide and frame.shape[0] >= 2 * high:
        half = frame.shape[1] // 2, frame.shape[0] // 2
        frame = cv2.resize(frame, half, interpolation=cv2.INTER_AREA)
    return cv2.resize(frame, (wide, high), interpolation=cv2.INTER_LINEAR)
