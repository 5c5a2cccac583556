"""Channels of sensors: their values and how fast they change, scaled by themselves where that is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from gesture_core.types import Signals
from gesture_signals.parts import KINDS, time_step

_KINDS = ("value", "velocity", "energy", "spread")
Scale = Literal["none", "channel", "group"]


@dataclass(frozen=True)
class Channels:
    """Each channel as it is, and what is derived from it as a group of its own (``acc/x.velocity``).

    Parameters
    ----------
    kinds : sequence of str
        ``value``, ``velocity`` (per tenth of a second), ``energy`` (its root mean square around each frame),
        ``spread`` (root mean square of the distance from its recent middle).
    scale : "none", "channel" or "group"
        Subtract the mean of each channel and divide by its standard deviation in this recording, or by that
        of its group (its name up to a ``/``): the size and place of a movement then say nothing.
    window : float
        Seconds, standard deviation of the Gaussian that ``energy`` and ``spread`` average over.
    """

    kinds: Sequence[str] = ("value",)
    scale: Scale = "none"
    window: float = 0.2

    def __post_init__(self) -> None:
        if isinstance(self.kinds, str) or not self.kinds or not set(self.kinds) <= set(_KINDS):
            raise ValueError(f"kinds {self.kinds!r} are not some of {', '.join(_KINDS)}")
        if self.scale not in get_args(Scale):
            raise ValueError(f"scale {self.scale!r} is not none, channel or group")
        if not self.window > 0:
            raise ValueError(f"window {self.window} is not above zero")

    def apply(self, signals: Signals) -> Signals:
        """The channels of every kind, those of one kind together."""
        values = self._scaled(signals)
        step = time_step(signals)
        made = [values if kind == "value" else KINDS[kind](values, step, self.window) for kind in self.kinds]
        tails = ["" if kind == "value" else f".{kind}" for kind in self.kinds]
        assert signals.mask is not None and signals.present is not None
        return replace(
            signals,
            values=np.concatenate(made, axis=1),
            channels=tuple(f"{name}{tail}" for tail in tails for name in signals.channels),
            mask=np.tile(signals.mask, len(made)),
            present=np.tile(signals.present, len(made)),
        )

    def _scaled(self, signals: Signals) -> np.ndarray:
        values = signals.values.astype(np.float64)
        if self.scale == "none":
            return values
        variances = values.var(axis=0)
        if self.scale == "group":
            groups = np.array([name.partition("/")[0] for name in signals.channels])
            variances = np.array([variances[groups == group].mean() for group in groups])
        deviations = np.sqrt(variances)
        scaled: np.ndarray = np.zeros_like(values)  # what does not change has no size
        np.divide(values - values.mean(axis=0), deviations, out=scaled, where=deviations > 1e-9)
        return scaled
