"""Signals that a stream can have, and the parts of a recording in which the person is seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gesture_core.classify.balance import balanced
from gesture_core.classify.comparison import check_alike
from gesture_core.errors import ConfigError
from gesture_core.plugin.abilities import StreamStep
from gesture_core.settings import Settings, load_settings
from gesture_core.signals.chain import Chain
from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence, Recording, Signals


def refuse_channels(settings: Settings) -> None:
    """Raise E_OPTION where inputs are recordings of channels, in which nothing is found while they go on."""
    if settings.signals.input == "channels":
        raise ConfigError(
            "signals.input = channels: while they happen, events are found in the movements of people alone",
            remedy="gesture spot, without --set spot.live=true, with the recording as a file",
            code="E_OPTION",
        )


def refuse_limits(settings: Settings) -> None:
    """Raise E_OPTION for limits on the labels of clips: no event would be another one under them."""
    asked = settings.classify
    limits = {
        "reject": None if asked.reject == load_settings(environment={}).classify.reject else asked.reject,
        "reject_sd": asked.reject_sd, "margin": asked.margin, "min_score": asked.min_score,
        "confidence": asked.confidence,
    }  # fmt: skip
    for name, value in limits.items():
        if value is not None:
            raise ConfigError(
                f"classify.{name} = {value:g} is for the labels of clips, and says nothing about events",
                remedy=f"--set classify.{name}=none; for events a lower --set spot.tolerance=…",
                code="E_OPTION",
            )


def stream_chain(settings: Settings) -> Chain:
    """The chain of ``settings`` for recordings: their filters, and nothing that needs a whole clip.

    What stands still has signals as well, as most of a long recording does.
    """
    chosen = replace(settings.signals, filters=settings.spot.chain or settings.signals.filters)
    chain = Chain.from_settings(replace(settings, signals=chosen))
    normalizer = chain.normalizer
    if isinstance(normalizer, StreamStep):
        normalizer = normalizer.on_stream()
    filters = tuple(step.on_stream() if isinstance(step, StreamStep) else step for step in chain.filters)
    return replace(chain, normalizer=normalizer, filters=filters, allow_still=True)


def at_one_rate(settings: Settings, clips: Sequence[PoseSequence | Recording]) -> Settings:
    """``settings`` under which channels have the rate of most of some ``clips``, not each its own: at another
    tempo an example has fewer samples.
    """
    steps = [np.diff(one.times) for one in clips if isinstance(one, Recording)]
    usual = [float(np.median(step[step > 0])) for step in steps if (step > 0).any()]
    resample = settings.options.get("resample", {})
    if not usual or resample.get("rate") != 0:
        return settings
    options = {**settings.options, "resample": {**resample, "rate": round(1 / float(np.median(usual)), 6)}}
    return replace(settings, options=options)


@dataclass(frozen=True, eq=False)
class Scaled:
    """A filter: every channel times a factor of its own, (D,); the channels must be those of an example."""

    factors: np.ndarray
    example: Signals

    def apply(self, signals: Signals) -> Signals:
        """The scaled signals."""
        check_alike([signals], "recording", self.example)
        return replace(signals, values=signals.values * self.factors)


def of_one_unit(chain: Chain, series: Sequence[Signals], settings: Settings) -> Chain:
    """``chain`` with what `classify.balance` says of ``series``: no unit makes a channel count for more.

    Together their channels then have a variance of 1 over all frames.
    """
    check_alike(series, "example")
    weights = np.array(balanced(series, settings).dtw.weights or np.ones(len(series[0].channels)))
    spread = np.concatenate([one.values for one in series]).astype(np.float64).var(axis=0)
    scaled = Scaled(np.sqrt(weights / float(spread @ weights)), series[0])
    return replace(chain, filters=(*chain.filters, scaled))


def spans(
    pose: PoseSequence | Recording, gap: float, layout: str = COCO18.name
) -> Iterator[PoseSequence | Recording]:
    """The parts of ``pose``, in a layout, in which nobody is lost for longer than ``gap`` seconds."""
    pose = pose.onto(layout) if isinstance(pose, PoseSequence) else pose
    seen = np.flatnonzero(pose.seen.any(axis=1))
    if len(seen) == 0:
        return
    cuts = np.flatnonzero(np.diff(pose.times[seen]) > gap) + 1
    for part in np.split(seen, cuts):
        yield pose.part(slice(int(part[0]), int(part[-1]) + 1))
