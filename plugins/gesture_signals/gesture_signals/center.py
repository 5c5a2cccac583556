"""Zero mean, or part of the way to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    """

    share: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise ValueError(f"share {self.share} is not in 0..1")

    def apply(self, signals: Signals) -> Signals:
        """The centred signals."""
        mean = signals.values.mean(axis=0, dtype="float64")
        return replace(signals, values=signals.values - self.share * mean)
