"""Signals that a stream can have, and the parts of a recording in which the person is seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gesture_core.errors import ConfigError
from gesture_core.plugin.abilities import StreamStep
from gesture_core.settings import Settings
from gesture_core.signals.chain import Chain
from gesture_core.types import PoseSequence


def refuse_channels(settings: Settings) -> None:
    """Raise E_OPTION where inputs are recordings of channels, before any is looked at."""
    if settings.signals.input == "channels":
        raise ConfigError(
            "signals.input = channels: events are found in the movements of people alone",
            remedy="gesture classify, with a file for each movement",
            code="E_OPTION",
        )


def stream_chain(settings: Settings) -> Chain:
    """The chain of ``settings`` for recordings: their filters, and nothing that needs a whole clip.

    What stands still has signals as well, as most of a long recording does.
    """
    refuse_channels(settings)
    chosen = replace(settings.signals, filters=settings.spot.chain or settings.signals.filters)
    chain = Chain.from_settings(replace(settings, signals=chosen))
    normalizer = chain.normalizer
    if isinstance(normalizer, StreamStep):
        normalizer = normalizer.on_stream()
    filters = tuple(step.on_stream() if isinstance(step, StreamStep) else step for step in chain.filters)
    return replace(chain, normalizer=normalizer, filters=filters, allow_still=True)


def spans(pose: PoseSequence, gap: float) -> Iterator[PoseSequence]:
    """The parts of ``pose`` in which the person is never lost for longer than ``gap`` seconds."""
    seen = np.flatnonzero(pose.seen.any(axis=1))
    if len(seen) == 0:
        return
    cuts = np.flatnonzero(np.diff(pose.times[seen]) > gap) + 1
    for part in np.split(seen, cuts):
        yield pose.part(slice(int(part[0]), int(part[-1]) + 1))
