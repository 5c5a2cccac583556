"""Zero mean, or part of the way to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gesture_core.types import Signals


@dataclass(frozen=True)
class Center:
    """Subtract each channel's mean over time (Schneider et al. 2019; not unit variance).

    Parameters
    ----------
    share : float
        Part of the mean that is subtracted. 1 forgets where a movement takes place; 0.5 keeps
        half of it, so that the same stroke beside the head and beside the hip stay apart while
        body proportions matter less.
    window : float
        Seconds around each frame over which the mean is taken; ``inf`` is the whole sequence, and
        with zero nothing is subtracted.
    """

    share: float = 1.0
    window: float = float("inf")

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise ValueError(f"share {self.share} is not in 0..1")
        if not self.window >= 0:
            raise ValueError(f"window {self.window} is negative")

    def apply(self, signals: Signals) -> Signals:
        """The centred signals."""
        mean = running_mean(signals.values, signals.times, self.window)
        return replace(signals, values=signals.values - self.share * mean)

    def on_stream(self, mean: float) -> Center:
        """The same with a mean of ``mean`` seconds."""
        return replace(self, window=mean)


def running_mean(values: np.ndarray, times: np.ndarray, window: float) -> np.ndarray:
    """(T, D) float64 mean within ``window`` seconds around each frame, or (D,) of all for ``inf``.

    Zero where the window is zero; at the ends the window is shorter.
    """
    if window == 0:
        return np.zeros(values.shape[1])
    if window == float("inf"):
        return np.asarray(values.mean(axis=0, dtype="float64"))
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0, dtype="float64")])
    starts = np.searchsorted(times, times - window / 2, side="left")
    stops = np.searchsorted(times, times + window / 2, side="right")
    mean: np.ndarray = (sums[stops] - sums[starts]) / (stops - starts)[:, None]
    return mean
