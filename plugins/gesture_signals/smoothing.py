"""Smoothing over frames, by SciPy."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gesture_core.types import Signals


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
        sigma = self._frames(signals.times)
        if sigma == 0:
            return signals
        from scipy.ndimage import gaussian_filter1d

        values = gaussian_filter1d(signals.values.astype(np.float64), sigma, axis=0, mode="reflect")
        return replace(signals, values=values)

    def _frames(self, times: np.ndarray) -> float:
        """The width in frames; no wider than the sequence."""
        if self.seconds == 0:
            return self.sigma
        step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        return min(self.seconds / step, float(len(times))) if step > 0 else 0.0


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
        if self.radius < 0 or int(self.radius) != self.radius:
            raise ValueError(f"radius {self.radius} is not a whole number of frames")

    def apply(self, signals: Signals) -> Signals:
        """The filtered signals; the ends are mirrored."""
        return replace(signals, values=running_median(signals.values, self.radius))


def running_median(values: np.ndarray, radius: int) -> np.ndarray:
    """(T, D) running median over ``2 radius + 1`` frames."""
    if radius == 0:
        return values
    from scipy.ndimage import median_filter

    return median_filter(values.astype(np.float64), size=(2 * radius + 1, 1), mode="mirror")
