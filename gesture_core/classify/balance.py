"""What each group of channels counts for: a weight, and a scale that is learned from the examples."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from gesture_core.classify.comparison import Series, parts
from gesture_core.errors import ConfigError, SignalError, near
from gesture_core.settings import Settings
from gesture_core.types import Signals

_MOVED = re.compile(r"@[+-]\d+$")


def balanced(series: Sequence[Series], settings: Settings) -> Settings:
    """``settings`` with the ``dtw.weights`` that ``classify.balance`` and ``classify.weights`` ask for.

    What a group costs is divided by the variances of its channels over all frames of ``series``, summed, so
    that neither a unit nor a number of channels makes it count for more, and multiplied by its weight. The
    groups of a stream (``acc@imu``) count for one together. What never changes counts for nothing.

    Raises
    ------
    ConfigError
        E_OPTION for a weight that is no number, or of a group that is not there.
    SignalError
        E_NO_SALIENT where no channel of any example changes.
    """
    chosen = settings.classify
    signals = [item for item in series if isinstance(item, Signals)]
    if not signals or not (chosen.balance or chosen.weights):
        return settings
    groups = parts(signals[0].channels, settings)
    factors = _factors(chosen.weights, list(groups))
    weights = np.zeros(len(signals[0].channels))
    spreads = [_spread(signals, columns) if chosen.balance else 1.0 for columns in groups.values()]
    # Of keypoints, what stands behind the mark is a share: ``elbow@1``.
    streams = [_stream(name) if settings.signals.input == "channels" else "" for name in groups]
    moving = Counter(
        name for name, spread, factor in zip(streams, spreads, factors, strict=True) if spread and factor
    )
    for columns, factor, spread, stream in zip(groups.values(), factors, spreads, streams, strict=True):
        share = moving[stream] if stream and chosen.balance else 1
        weights[columns] = factor / spread / share if spread and factor else 0.0
    if not weights.any():
        raise SignalError(
            "no channel of any example changes, or none has a weight",
            remedy="examples that move, or other --set classify.weights=…",
            code="E_NO_SALIENT",
        )
    own = settings.dtw.weights
    weights = weights if own is None or len(own) != len(weights) else weights * np.array(own)
    return replace(settings, dtw=settings.dtw.replace(weights=tuple(weights.tolist())))


def _stream(group: str) -> str:
    """The stream of a group, as a folder of files in step names it, with its kind: ``imu.velocity``.

    A move in time, as of ``acc@+1``, is none.
    """
    return _MOVED.sub("", group).partition("@")[2]


def _spread(signals: Sequence[Signals], columns: Sequence[int]) -> float:
    """Sum of the variances of some channels over all frames in which they are there."""
    total = 0.0
    for column in columns:
        frames = [item.values[:, column] for item in signals if item.present is None or item.present[column]]
        values = np.concatenate(frames).astype(np.float64) if frames else np.zeros(1)
        # Of a constant channel nothing but rounding is left.
        spread = float(values.var())
        total += spread if spread > 1e-12 * float(np.square(values).mean()) else 0.0
    return total


def _factors(texts: Sequence[str], groups: Sequence[str]) -> list[float]:
    """The weight of each group, from texts such as ``acc=2`` and ``*.velocity=0.5``; the last one counts."""
    factors = dict.fromkeys(groups, 1.0)
    for text in texts:
        pattern, _, number = text.partition("=")
        try:
            factor = float(number)
        except ValueError:
            factor = -1.0
        if not 0 <= factor < float("inf"):
            raise ConfigError(f"classify.weights: {text!r}", remedy="group=number, as acc=2", code="E_OPTION")
        known = [name for name in groups if fnmatchcase(name, pattern.strip())]
        if not known:
            cause = f"classify.weights: no group of channels {pattern.strip()!r}"
            raise ConfigError(cause, remedy=near(pattern.strip(), groups), code="E_OPTION")
        factors |= dict.fromkeys(known, factor)
    return list(factors.values())
