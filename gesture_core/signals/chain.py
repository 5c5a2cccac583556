"""From keypoints, or channels, to signals: gaps, normalizer, selector, filters, in this order."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from gesture_core.errors import ConfigError, GestureError, InputError, PluginError, PoseError, SignalError
from gesture_core.plugin.abilities import WholeBody
from gesture_core.plugin.registry import calling, name_of, registry
from gesture_core.signals.gaps import GapRule, fill_gaps, require_pose
from gesture_core.signals.repair import readings_apart, repaired
from gesture_core.signals.turns import without_jumps
from gesture_core.skeletons import COCO18, skeleton
from gesture_core.types import PoseSequence, Recording, Signals

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import Filter, Normalizer, Selector
    from gesture_core.settings import Settings


@cache
def channels_of(name: str, axes: str = "xy") -> tuple[str, ...]:
    """Those of each joint of a skeleton."""
    return tuple(f"{joint}_{axis}" for joint in skeleton(name).joints for axis in axes)


CHANNELS = channels_of(COCO18.name)
CHANNELS_3D = channels_of(COCO18.name, "xyz")


@dataclass(frozen=True)
class Chain:
    """The steps from a `PoseSequence`, or a `Recording`, to `Signals`.

    The selector sees the normalised, unfiltered signals (Schneider et al. 2019, section III);
    its mask then travels through the filters, which may drop or add channels.

    Attributes
    ----------
    normalizer : Normalizer or None
        None where inputs are recordings of channels, which have no body.
    filters : tuple of Filter
    selector : Selector
    gaps : GapRule
    allow_still : bool
        Let sequences pass in which no channel moves. An example with salient channels can still
        be compared with them (the paper's union of both selections), but a person who stands
        still is then given the label of some gesture.
    repair : bool
        Mend single wrong frames first, see `gesture_core.signals.repair`.
    fps : float
        Samples per second of arrays without times.
    """

    normalizer: Normalizer | None
    filters: tuple[Filter, ...]
    selector: Selector
    gaps: GapRule = field(default_factory=GapRule)
    allow_still: bool = False
    repair: bool = True
    fps: float = 30.0

    @property
    def of_channels(self) -> bool:
        """Whether inputs are recordings of channels instead of people."""
        return self.normalizer is None

    @classmethod
    def from_settings(cls, settings: Settings) -> Chain:
        """The chain that ``settings`` describe, its plugins found by name.

        A step may be named twice: ``gaussian:wide`` is a second `gaussian` whose options are those
        of ``[options."gaussian:wide"]``.

        Raises
        ------
        PluginError, ConfigError
            For an unknown plugin, or an option that it does not take.
        """
        chosen = settings.signals
        rule = GapRule(chosen.max_gap, chosen.min_seen, chosen.min_frames, settings.classify.min_pose)

        def make(kind: str, name: str) -> Any:
            return registry().make(kind, name.partition(":")[0], settings.options.get(name, {}))

        normalizer = make("normalizer", chosen.normalizer) if chosen.input == "keypoints" else None
        if isinstance(normalizer, WholeBody) and not settings.keypoints.whole:
            raise ConfigError(
                f"signals.normalizer = {chosen.normalizer!r} takes more than the body",
                remedy="--set keypoints.parts=body,hands",
                code="E_OPTION",
            )
        return cls(
            normalizer,
            tuple(make("filter", name) for name in chosen.filters),
            make("selector", chosen.selector),
            rule,
            chosen.still == "posture",
            chosen.repair,
            settings.keypoints.rate,
        )

    @property
    def skeleton(self) -> str:
        """What the normalizer is given: the canonical body, or the whole one that it asks for."""
        return self.normalizer.skeleton if isinstance(self.normalizer, WholeBody) else COCO18.name

    def __call__(self, pose: PoseSequence | Recording) -> Signals:
        """The signals of one person, or of one recording.

        Raises
        ------
        PoseError
            E_POSE_SHORT where there are too few frames, E_POSE_SPARSE where a person, or every joint,
            is seen in too few of them, E_POSE_SCALE where the normalizer finds no scale or origin.
        SignalError
            E_NO_SALIENT where no channel moves enough to be compared.
        PluginError
            Where a plugin returns arrays of another shape or raises.
        """
        try:
            signals = self.normalised(pose)
            with calling(self.selector):
                mask = self.selector.select(signals)
            if np.shape(mask) != (len(signals.channels),):
                raise _broke(self.selector, f"returned a mask of shape {np.shape(mask)}")
            if np.asarray(mask).dtype.kind == "f" and not np.isfinite(mask).all():
                raise _broke(self.selector, "returned a mask with NaN or infinity")
            signals = replace(signals, mask=np.asarray(mask, bool))
            for step in self.filters:
                with calling(step):
                    signals = step.apply(signals)
                if not isinstance(signals, Signals):
                    raise _broke(step, f"returned {type(signals).__name__} instead of Signals")
            if not (self.allow_still or signals.selected):
                raise SignalError(
                    "no channel moves enough to be compared; a person who stands still makes no gesture",
                    subject=pose.source,
                    remedy="a lower --set variance.t_var=…, or --set signals.selector=all where poses are "
                    "classes too",
                    code="E_NO_SALIENT",
                )
            return signals
        except GestureError as error:
            raise error.about(pose.source) from error.__cause__

    def normalised(self, pose: PoseSequence | Recording) -> Signals:
        """The signals before selection and filters: every channel in body units, gaps filled."""
        if self.normalizer is None or isinstance(pose, Recording):
            if self.normalizer is None and isinstance(pose, Recording):
                return _dense(pose, self.gaps, repair=self.repair)
            raise _other_kind(pose)
        name = self.skeleton
        if name != COCO18.name:  # joints that are not compared need no repair
            pose = pose.onto(name)
        pose, frames = repaired(pose) if self.repair else (pose, 0)
        share = frames / max(len(pose), 1)
        pose = require_pose(pose.onto(name), self.gaps)
        joints, _ = fill_gaps(pose.keypoints, pose.times, self.gaps)
        # Scores of interpolated joints stay zero, so that later steps know them from seen ones.
        dense = replace(pose, keypoints=joints, scores=pose.scores)
        with calling(self.normalizer):
            points = self.normalizer.normalize(dense)
        if np.shape(points) != dense.keypoints.shape:
            raise _broke(self.normalizer, f"returned coordinates of shape {np.shape(points)}")
        # Frames that the normalizer does not trust are gaps like any other.
        points = np.where(np.isfinite(points).all(axis=2, keepdims=True), points, np.nan)
        points, present = fill_gaps(points, pose.times, self.gaps)
        if not present.any():
            raise PoseError(
                f"no joint has a place in {self.gaps.min_seen:.0%} of the frames",
                subject=pose.source,
                remedy="a lower --set signals.min_seen=…, another normalizer, or a clip in which joints "
                "are seen",
                code="E_POSE_SPARSE",
            )
        return Signals(
            points.reshape(len(pose), -1),
            pose.times,
            channels_of(name, "xyz"[: points.shape[2]]),
            present=np.repeat(present, points.shape[2]),
            source=pose.source,
            repaired=share,
        )


def _other_kind(item: PoseSequence | Recording) -> InputError:
    """A person where channels are expected, or the other way round."""
    if isinstance(item, Recording):
        cause, wanted = "is a recording of channels, where people's keypoints are expected", "channels"
    else:
        cause, wanted = "holds a person's keypoints, where channels are expected", "keypoints"
    remedy = f"--set signals.input={wanted}, or a preset for {wanted}"
    return InputError(cause, subject=item.source, remedy=remedy, code="E_MIXED")


def _dense(recording: Recording, rule: GapRule, *, repair: bool) -> Signals:
    """The channels in the order of their names, from the first to the last sample, gaps filled."""
    there = np.flatnonzero(recording.seen.any(axis=1))
    if len(there) < max(rule.min_frames, 1):
        raise PoseError(
            f"holds {len(there)} samples with a value, at least {rule.min_frames} are needed",
            subject=recording.source,
            remedy="a longer recording, or a lower --set signals.min_frames=…",
            code="E_POSE_SHORT",
        )
    whole = slice(there[0], there[-1] + 1)
    order = np.argsort(recording.channels)
    times = recording.times[whole]
    given = recording.values[whole].astype(np.float64)
    apart = readings_apart(given) if repair else np.zeros(given.shape, bool)
    given = without_jumps(np.where(apart, np.nan, given), recording.channels)[:, order, None]
    values, present = fill_gaps(given, times, rule)
    if not present.any():
        raise PoseError(
            f"no channel has a value in {rule.min_seen:.0%} of the samples",
            subject=recording.source,
            remedy="a lower --set signals.min_seen=…, or a recording with fewer gaps",
            code="E_POSE_SPARSE",
        )
    names = tuple(recording.channels[i] for i in order)
    return Signals(
        np.where(present, values[..., 0], 0),
        times,
        names,
        present=present,
        source=recording.source,
        apart=int(apart.sum()),
    )


def _broke(plugin: object, what: str) -> PluginError:
    return PluginError(
        f"{name_of(plugin)} {what}", remedy="repair or replace the plugin", code="E_PLUGIN_CONTRACT"
    )
