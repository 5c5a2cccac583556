"""Filters of single channels: zero mean, smoothing over frames, a common frame rate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np

from gesture_core.types import Signals

WIDEST = 1000.0
"""Frames: the greatest standard deviation of a Gaussian."""
_MOST = 10
"""Times its own frames that a long sequence may have at another rate."""


@dataclass(frozen=True)
class Center:
    """Subtract each channel's mean over time (Schneider et al. 2019; not unit variance).

    Parameters
    ----------
    share : float
        Part of the mean that is subtracted. 1 forgets where a movement takes place; 0.5 keeps
        half of it, so that the same stroke beside the head and beside the hip stay apart while
        body proportions matter less.
    """

    share: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise ValueError(f"share {self.share} is not in 0..1")

    def apply(self, signals: Signals) -> Signals:
        """The centred signals."""
        mean = signals.values.mean(axis=0, dtype=np.float64)
        return replace(signals, values=signals.values - self.share * mean)

    def on_stream(self) -> Center:
        """Nothing is subtracted."""
        return replace(self, share=0.0)


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


@dataclass(frozen=True)
class Resample:
    """Linear interpolation at evenly spaced times.

    Warping follows a different frame rate, but each frame has its price: without this step a
    clip at 60 frames per second is twice as far from everything as one at 30.

    Parameters
    ----------
    rate : float
        Frames per second of the result; 0 for its own: the median of its steps, evenly.
    max_frames : int
        What would have more than these, and than ten times its own, keeps its own: time stamps are not
        trusted to allocate memory.
    anchored : bool
        Sample at whole multiples of ``1 / rate``, wherever the sequence begins, so that two parts of
        one recording are sampled at the same times.
    """

    rate: float = 20.0
    max_frames: int = 200_000
    anchored: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.rate <= 1000:
            raise ValueError(f"rate {self.rate} is not in 0..1000 frames per second")
        if not self.max_frames >= 2:
            raise ValueError(f"max_frames {self.max_frames} is not 2 or more")

    def apply(self, signals: Signals) -> Signals:
        """The same signals at `rate`; unchanged where they have no duration."""
        first, last = float(signals.times[0]), float(signals.times[-1])
        rate = self.rate or _own_rate(signals.times)
        frames = round((last - first) * rate) + 1
        if len(signals) < 2 or last <= first or frames > max(self.max_frames, _MOST * len(signals)):
            return signals
        if self.anchored:
            times = np.arange(np.ceil(first * rate), np.floor(last * rate) + 1) / rate
            if len(times) == 0:
                return signals
        else:
            times = np.linspace(first, last, max(frames, 2))
        values = np.stack([np.interp(times, signals.times, column) for column in signals.values.T], axis=1)
        return replace(signals, values=values, times=times)

    def on_stream(self) -> Resample:
        """The same at times that do not depend on where a part begins."""
        return replace(self, anchored=True)


def _own_rate(times: np.ndarray) -> float:
    """Frames per second by the median of the steps; 0 where time stands still."""
    steps = np.diff(times)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    return 1 / step if step > 0 else 0.0


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


@dataclass(frozen=True)
class Shape:
    """Beside each channel, what it was and will be: frames are compared by the shape around them.

    ShapeDTW with raw subsequences as descriptors (Zhao and Itti 2018), whose cost is divided by their number.

    Parameters
    ----------
    seconds : float
        How far to each side, at the sequence's own rate; at the ends the first or last frame stands for more.
    steps : int
        Neighbours on each side, evenly spaced.
    """

    seconds: float = 0.25
    steps: int = 2

    def __post_init__(self) -> None:
        if not 0 < self.seconds < float("inf"):
            raise ValueError(f"seconds {self.seconds} is no finite number above zero")
        if not isinstance(self.steps, Integral) or self.steps < 1:
            raise ValueError(f"steps {self.steps} is no whole number of one or more")

    def apply(self, signals: Signals) -> Signals:
        """The channels as they are and, as ``left_wrist_x@-1`` and so on, moved in time."""
        step = float(np.median(np.diff(signals.times))) if len(signals) > 1 else 0.0
        apart = max(1, round(self.seconds / step / self.steps)) if step > 0 else 1
        places, last = np.arange(len(signals)), len(signals) - 1
        moves = [0, *(sign * number for number in range(1, self.steps + 1) for sign in (-1, 1))]
        values = [signals.values[np.clip(places + apart * move, 0, last)] for move in moves]
        assert signals.mask is not None and signals.present is not None
        return replace(
            signals,
            values=np.concatenate(values, axis=1) / np.sqrt(len(moves)),
            channels=tuple(f"{c}@{move:+d}" if move else c for move in moves for c in signals.channels),
            mask=np.tile(signals.mask, len(moves)),
            present=np.tile(signals.present, len(moves)),
        )
