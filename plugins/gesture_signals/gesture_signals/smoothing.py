"""Smoothing over frames, by SciPy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np

from gesture_core.types import Signals

WIDEST = 1000.0
"""Frames: the greatest standard deviation of a Gaussian."""


@dataclass(frozen=True)
class Gaussian:
    """Gaussian smoothing of each channel (the paper: sigma 1).

    Parameters
    ----------
    sigma : float
        Standard deviation in frames; zero leaves the signals as they are.
    seconds : float
        Standard deviation in seconds instead, where it is above zero.
    """

    sigma: float = 1.0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.sigma < float("inf") and 0 <= self.seconds < float("inf")):
            raise ValueError(f"sigma {self.sigma} or seconds {self.seconds} is not a finite width")

    def apply(self, signals: Signals) -> Signals:
        """The smoothed signals; the ends are continued by reflection."""
        sigma = self.sigma
        if self.seconds > 0:
            step = float(np.median(np.diff(signals.times))) if len(signals) > 1 else 0.0
            sigma = min(self.seconds / step, float(len(signals))) if step > 0 else 0.0
        if sigma == 0:
            return signals
        return replace(signals, values=smooth(signals.values.astype(np.float64), sigma))


@dataclass(frozen=True)
class Median:
    """Running median of each channel.

    Parameters
    ----------
    radius : int
        Frames on each side; the window holds ``2 radius + 1``.
    """

    radius: int = 3

    def __post_init__(self) -> None:
        check_radius(self.radius)

    def apply(self, signals: Signals) -> Signals:
        """The filtered signals; the ends are mirrored."""
        return replace(signals, values=running_median(signals.values, self.radius))


def smooth(values: np.ndarray, sigma: float) -> np.ndarray:
    """(T, D) Gaussian average over frames; the ends are continued by reflection.

    No wider than four sequences, where nothing but the mean is left, nor than `WIDEST`: time stamps are
    not trusted to cost memory and hours.
    """
    from scipy.ndimage import gaussian_filter1d

    width = min(sigma, 4.0 * len(values), WIDEST)
    smoothed: np.ndarray = gaussian_filter1d(values, width, axis=0, mode="reflect")
    return smoothed


def check_radius(radius: object) -> None:
    """A ValueError unless ``radius`` is a whole number of frames."""
    if not isinstance(radius, Integral) or radius < 0:
        raise ValueError(f"radius {radius!r} is not a whole number of frames, zero or more")


def running_median(values: np.ndarray, radius: int) -> np.ndarray:
    """(T, D) running median over ``2 radius + 1`` frames."""
    if radius == 0:
        return values
    from scipy.ndimage import median_filter

    size = (2 * radius + 1, 1)
    median: np.ndarray = median_filter(values.astype(np.float64), size=size, mode="mirror")
    return median
