"""Tiles of fixed shape: what keeps the number of compiled programs small."""

from __future__ import annotations

from typing import Generic, NamedTuple, TypeVar

import numpy as np
from jax import Array

from gesture_core.dtw.batches import FAR
from gesture_core.dtw.lanes import UNBOUNDED, Lanes

ROWS = 8
"""Rows of the warping table that one pass over the columns computes."""
WIDTHS = (128, 1024)
"""Lanes of a tile."""
SHORTEST = 32
"""Frames of the smallest bucket: what is shorter is not worth a program of its own."""


A = TypeVar("A", np.ndarray, Array)


class Tile(NamedTuple, Generic[A]):
    """`Lanes` padded to a bucket's shape; T is a power of two, W one of `WIDTHS`.

    Of NumPy's arrays outside compiled functions and of JAX's inside.

    Attributes
    ----------
    x, y : (T, C, W) float
    n, m : (W,) int32
    low, high : (T, W) int32 or None
    gamma : (W,) float or None
    start, stop : (T / ROWS,) int32
        The columns that each block of `ROWS` rows visits.
    blocks, columns : int
        The tile's own number of row blocks and columns.
    """

    x: A
    y: A
    n: A
    m: A
    low: A | None
    high: A | None
    gamma: A | None
    start: A
    stop: A
    blocks: int
    columns: int


def make_tile(lanes: Lanes) -> Tile[np.ndarray]:
    """Pad ``lanes`` to the next bucket.

    Every lane's value reaches the tile's last cell: either the lane fills the tile exactly, or
    padded frames, which cost nothing among themselves, carry the value there unchanged.
    """
    rows, columns = int(lanes.n.max()), int(lanes.m.max())
    exact = rows % ROWS == 0 and bool((lanes.n == rows).all() and (lanes.m == columns).all())
    if not exact:
        rows, columns = rows + 1, columns + 1
    blocks = -(-rows // ROWS)
    frames = max(SHORTEST, 1 << (max(blocks * ROWS, columns) - 1).bit_length())
    width = next(width for width in WIDTHS if width >= len(lanes))
    padding = FAR[lanes.x.dtype]
    n, m = _pad(lanes.n.astype(np.int32), (width,), 1), _pad(lanes.m.astype(np.int32), (width,), 1)
    start = np.zeros(frames // ROWS, np.int32)
    stop = np.full_like(start, columns)
    low = high = None
    if lanes.low is not None and lanes.high is not None:
        low = np.broadcast_to(m, (frames, width)).copy()
        low[: len(lanes.low), : len(lanes)] = lanes.low
        high = _pad(lanes.high, (frames, width), UNBOUNDED)
        start = low[:, : len(lanes)].reshape(-1, ROWS * len(lanes)).min(axis=1)
        stop = np.minimum(high[:, : len(lanes)].reshape(-1, ROWS * len(lanes)).max(axis=1), columns)
    channels = lanes.x.shape[1]
    return Tile(
        _pad(lanes.x, (frames, channels, width), padding),
        _pad(lanes.y, (frames, channels, width), padding),
        n,
        m,
        low,
        high,
        None if lanes.gamma is None else _pad(lanes.gamma, (width,), 1),
        start,
        stop,
        blocks,
        columns,
    )


def _pad(array: np.ndarray, shape: tuple[int, ...], fill: float) -> np.ndarray:
    """``array`` in the corner of a larger one."""
    if array.shape == shape:
        return array
    out = np.full(shape, fill, array.dtype)
    out[tuple(slice(size) for size in array.shape)] = array
    return out
