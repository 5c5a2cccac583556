"""Derivative DTW (Keogh and Pazzani 2001): warp the estimated slopes instead of the values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.errors import InputError, SignalError


def derivatives(series: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The slope estimate of each series; warp these for derivative DTW.

    Keogh and Pazzani: the mean of the slope to the left neighbour and of the slope between both
    neighbours; the first and last frame take their neighbour's, so that lengths stay.

    Parameters
    ----------
    series : sequence of (T,) or (T, D) arrays, T at least 3

    Returns
    -------
    list of arrays of the same shapes
        float32 where a series is, else float64: whole numbers without a sign would wrap.

    Raises
    ------
    SignalError
        Where a series is shorter than three frames.
    InputError
        Where one is no array of frames, or has masked values.
    """
    return [_derivative(item, index) for index, item in enumerate(series)]


def _derivative(item: np.ndarray, index: int) -> np.ndarray:
    if np.ma.is_masked(item):
        raise InputError(
            f"series {index} has masked values", remedy="fill the gaps first", code="E_NOT_FINITE"
        )
    x = np.asarray(item)
    if x.ndim not in (1, 2) or x.dtype.kind not in "iuf":
        raise InputError(
            f"series {index} is {x.dtype} of shape {x.shape}, expected numbers of shape (T,) or (T, D)",
            code="E_DIMENSIONS",
        )
    if len(x) < 3:
        raise SignalError(
            f"series {index} has {len(x)} frames, derivative DTW needs 3", code="E_SIGNAL_SHORT"
        )
    x = x if x.dtype == np.float32 else x.astype(np.float64)
    slope = ((x[1:-1] - x[:-2]) + (x[2:] - x[:-2]) / 2) / 2
    return np.concatenate([slope[:1], slope, slope[-1:]])
