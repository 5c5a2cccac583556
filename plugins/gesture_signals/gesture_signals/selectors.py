"""Which channels take part: those that move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.types import Signals
from gesture_signals.filters import check_radius, running_median


@dataclass(frozen=True)
class VarianceThreshold:
    """Channels whose median-filtered population variance exceeds a threshold (Schneider et al. 2019).

    The median filter serves the selection only: it takes out the single frames in which a network
    jumps, which would look like motion.

    Parameters
    ----------
    t_var : float
        In the squared unit of the normalizer.
    median_radius : int
        Frames on each side of the running median.
    """

    t_var: float = 0.10
    median_radius: int = 3

    def __post_init__(self) -> None:
        if not self.t_var >= 0:
            raise ValueError(f"t_var {self.t_var} must not be negative")
        check_radius(self.median_radius)

    def select(self, signals: Signals) -> np.ndarray:
        """(D,) bool: the channel moves."""
        moves: np.ndarray = running_median(signals.values, self.median_radius).var(axis=0) > self.t_var
        return moves


@dataclass(frozen=True)
class Moving:
    """Every channel where anything moves, none where the person stands still.

    Parameters
    ----------
    deviation : float
        Standard deviation over time, in the normalizer's unit, that some channel must exceed after
        a running median. A person who tries to stand still stays below 0.02 to 0.04 torso lengths
        as networks see them; a shrug of the shoulders moves the wrists by 0.04 and more.
    median_radius : int
        Frames on each side of the running median.
    """

    deviation: float = 0.025
    median_radius: int = 3

    def __post_init__(self) -> None:
        if not self.deviation >= 0:
            raise ValueError(f"deviation {self.deviation} must not be negative")
        check_radius(self.median_radius)

    def select(self, signals: Signals) -> np.ndarray:
        """(D,) bool, all alike."""
        deviations = running_median(signals.values, self.median_radius).std(axis=0)
        moves = bool((deviations[signals.present] > self.deviation).any())
        return np.full(len(signals.channels), moves)


@dataclass(frozen=True)
class AllChannels:
    """Every channel that is present."""

    def select(self, signals: Signals) -> np.ndarray:
        """(D,) bool, all True."""
        return np.ones(len(signals.channels), bool)
