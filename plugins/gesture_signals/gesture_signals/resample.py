"""A common frame rate, so that the camera's does not change a distance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gesture_core.types import Signals


@dataclass(frozen=True)
class Resample:
    """Linear interpolation at evenly spaced times.

    Warping follows a different frame rate, but each frame has its price: without this step a
    clip at 60 frames per second is twice as far from everything as one at 30.

    Parameters
    ----------
    rate : float
        Frames per second of the result.
    max_frames : int
        A longer sequence keeps its own frames; time stamps are not trusted to allocate memory.
    anchored : bool
        Sample at whole multiples of ``1 / rate``, wherever the sequence begins, so that two parts of
        one recording are sampled at the same times.
    """

    rate: float = 20.0
    max_frames: int = 200_000
    anchored: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.rate <= 1000:
            raise ValueError(f"rate {self.rate} is not in 0..1000 frames per second")
        if not self.max_frames >= 2:
            raise ValueError(f"max_frames {self.max_frames} is not 2 or more")

    def apply(self, signals: Signals) -> Signals:
        """The same signals at `rate`; unchanged where they have no duration."""
        first, last = float(signals.times[0]), float(signals.times[-1])
        frames = round((last - first) * self.rate) + 1
        if len(signals) < 2 or last <= first or frames > self.max_frames:
            return signals
        if self.anchored:
            times = np.arange(np.ceil(first * self.rate), np.floor(last * self.rate) + 1) / self.rate
            if len(times) == 0:
                return signals
        else:
            times = np.linspace(first, last, max(frames, 2))
        values = np.stack([np.interp(times, signals.times, column) for column in signals.values.T], axis=1)
        return replace(signals, values=values, times=times)

    def on_stream(self, mean: float) -> Resample:
        """The same at times that do not depend on where a part begins; it subtracts no mean."""
        return replace(self, anchored=True)
