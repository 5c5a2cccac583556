"""What is looked for: the examples at several tempos, and how near to them an event must be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.classify.recognizer import Recognizer
from gesture_core.dtw.subsequence import choose_subsequence_kernel
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.settings import Settings
from gesture_core.signals.chain import Chain
from gesture_core.spot.signals import at_one_rate, of_one_unit, stream_chain
from gesture_core.types import PoseSequence, Recording, Signals

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import Subsequences

NONE = "_none"
"""The label of movements that are no gesture: looked for like any other, and never an event."""
_COMMON = 0.5
"""Share of an example's variance that the channels must hold which the stream has as well."""
_MEMBERS = 3
"""Examples with others of their class from which on it has a threshold of its own."""
COPY = 0.02
"""Distance up to which an example is a copy of another one: the same clip, encoded or cut again."""
_PART = 0.5
"""Of one example that another must cover for their distance to count."""
_FEW, _FEW_UNJUDGED = 2.6, 1.1
"""Over the root of their number, what is usual between the examples of a class at least: clips of one person
on one day are too alike. More where scores rank events, as what few examples teach is never sure."""


@dataclass(frozen=True, eq=False)
class SpottingExamples:
    """Examples ready to be looked for; made by `fit`.

    Attributes
    ----------
    settings : Settings
    chain : Chain
        From recordings to what is looked into.
    series : tuple of Signals
        Each example at its own length and at every other tempo.
    example : (N,) int64
        Which example each of the series is.
    names : tuple of str
        Of the examples.
    codes : (E,) int64
        Class of each example.
    classes : tuple of str
    held : (C,) bool
        Gestures that are held: in most of their examples nothing moves.
    thresholds : (C,) float64
        Distance up to which a class has events.
    calibrated : bool
        The thresholds come from the examples; otherwise no class had two of them.
    recognizer : Recognizer or None
        The second stage.
    again : SpottingExamples or None
        With the second stage, the same on the filters of clips, where the first search has some of its own.
    """

    settings: Settings
    chain: Chain
    series: tuple[Signals, ...]
    example: np.ndarray
    names: tuple[str, ...]
    codes: np.ndarray
    classes: tuple[str, ...]
    held: np.ndarray
    thresholds: np.ndarray
    calibrated: bool
    recognizer: Recognizer | None
    again: SpottingExamples | None = None

    @classmethod
    def fit(
        cls,
        settings: Settings,
        poses: Sequence[PoseSequence | Recording],
        labels: Sequence[str],
        names: Sequence[str] | None = None,
        *,
        alive: Callable[[], None] = lambda: None,
    ) -> SpottingExamples:
        """Take clips of one gesture each."""
        if not poses or len(poses) != len(labels):
            raise InputError(f"{len(poses)} examples and {len(labels)} labels", code="E_EXAMPLES")
        names = tuple(names or [pose.source or str(n) for n, pose in enumerate(poses)])
        classes, codes = np.unique([str(label) for label in labels], return_inverse=True)
        if set(classes) == {NONE}:
            raise ConfigError(
                f"every example is called {NONE}", remedy="examples of gestures", code="E_LABELS"
            )
        chosen = settings.spot
        settings = at_one_rate(settings, poses)
        chain = stream_chain(settings)
        if chain.of_channels:
            chain = of_one_unit(chain, [chain(one) for one in poses], settings)
        series, example = [], []
        for number, pose in enumerate(poses):
            for tempo in (1.0, *chosen.tempos):
                try:
                    series.append(chain(replace(pose, times=pose.times * tempo)))
                except GestureError as error:
                    raise error.about(names[number]) from error.__cause__
                example.append(number)
            alive()
        tempos = 1 + len(chosen.tempos)
        still = np.array([not one.selected for one in series[::tempos]])
        plain = replace(settings, spot=replace(chosen, chain=(), verify=False))
        judged = chosen.verify and len(classes) > 1  # of one class alone there is nothing to tell it from
        made = cls(
            settings,
            chain,
            tuple(series),
            np.array(example),
            names,
            codes.astype(np.int64),
            tuple(classes.tolist()),
            np.array([still[codes == code].mean() > 0.5 for code in range(len(classes))]),
            np.full(len(classes), np.inf),
            False,
            Recognizer.fit(settings, poses, list(labels), names, alive=alive) if judged else None,
            cls.fit(plain, poses, labels, names, alive=alive) if judged and chosen.chain else None,
        )
        return made._with_thresholds(alive)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def note(self) -> str:
        """What is worth knowing of the thresholds; mostly empty."""
        if self.calibrated or self.settings.spot.threshold is not None:
            return ""
        return (
            "no gesture has two examples that differ: how far an event may be is a guess; "
            "try: more examples of each, or another --set spot.tolerance=…"
        )

    @property
    def limits(self) -> np.ndarray:
        """(C,) rank up to which a class has events: its threshold, or the geometric mean of its two."""
        return self.thresholds if self.again is None else np.sqrt(self.thresholds * self.again.thresholds)

    def code_of_series(self) -> np.ndarray:
        """(N,) class of each of the series."""
        return np.asarray(self.codes[self.example])

    def usual_seconds(self) -> np.ndarray:
        """(C,) mean duration of the examples of each class."""
        own = self.series[:: 1 + len(self.settings.spot.tempos)]
        seconds = np.array([one.times[-1] - one.times[0] for one in own])
        means: np.ndarray = np.bincount(self.codes, seconds) / np.bincount(self.codes)
        return means

    def look_into(
        self, present: np.ndarray, code: int | None = None
    ) -> list[tuple[np.ndarray, np.ndarray, Subsequences]]:
        """Begin to look for the examples, or those of one class, in a stream with (D,) channels ``present``.

        Returns
        -------
        list of (series, channels, state)
            Series that share their channels, those channels, and what finds them.
        """
        _, kernel = choose_subsequence_kernel(self.settings.classify.kernel, self.settings.options)
        groups: dict[bytes, list[int]] = {}
        for number, signals in enumerate(self.series):
            if code is not None and self.codes[self.example[number]] != code:
                continue
            wanted = _wanted(signals)
            spread = self._spread[number]
            used = wanted & present
            if used.any() and spread[used].sum() >= _COMMON * spread[wanted].sum():
                groups.setdefault(used.tobytes(), []).append(number)
        looking = []
        for key, members in groups.items():
            channels = np.flatnonzero(np.frombuffer(key, bool))
            values = [self.series[n].values[:, channels] for n in members]
            state = kernel.subsequences(values, self.settings.spot.floor)
            looking.append((np.array(members), channels, state))
        return looking

    @cached_property
    def _spread(self) -> list[np.ndarray]:
        """The variance of each channel of each of the series."""
        return [one.values.var(axis=0, dtype=np.float64) for one in self.series]

    def _with_thresholds(self, alive: Callable[[], None]) -> SpottingExamples:
        """The same with thresholds: what is usual between the examples of a class.

        For each example the median distance to the others of its class is taken. The nearest one is often
        of the same person, and far nearer than anybody else will be; a copy is no other one. Few examples say
        little: then it is a constant over the root of their number, if that is more.
        """
        chosen = self.settings.spot
        within = self.distances_between(alive)
        usual: np.ndarray = np.full(len(self), np.nan)
        readings: np.ndarray = np.ones(len(self))
        for number, code in enumerate(self.codes):
            others = within[number, (self.codes == code) & (np.arange(len(self)) != number)]
            readings[number] += (others <= COPY).sum()
            others = others[np.isfinite(others) & (others > COPY)]
            if len(others):
                usual[number] = np.median(others)
        known = np.isfinite(usual)
        thresholds: np.ndarray = np.full(len(self.classes), usual[known].mean() if known.any() else 0.0)
        for code in range(len(self.classes)):
            own = usual[known & (self.codes == code)]
            if len(own) >= _MEMBERS:
                thresholds[code] = own.mean()
        # Of several copies each counts for a part of one example.
        count = np.bincount(self.codes, 1 / readings, minlength=len(self.classes))
        judged = self.recognizer is not None and not self.recognizer.fitted.votes
        least = chosen.tolerance * (_FEW if judged else _FEW_UNJUDGED) / np.sqrt(count)
        thresholds = np.maximum(chosen.tolerance * thresholds, least)
        again = self.again and replace(self.again, thresholds=np.maximum(self.again.thresholds, least))
        if chosen.threshold is not None:
            thresholds[:], again = chosen.threshold, self.again
        return replace(self, thresholds=thresholds, calibrated=bool(known.any()), again=again)

    def distances_between(self, alive: Callable[[], None] = lambda: None) -> np.ndarray:
        """(E, E) distance of the best subsequence of each example (row) to each other one of its class."""
        table: np.ndarray = np.full((len(self), len(self)), np.inf)
        own = np.flatnonzero(np.diff(self.example, prepend=-1))
        for number, place in enumerate(own):
            signals = self.series[place]
            assert signals.present is not None
            for members, channels, state in self.look_into(signals.present, int(self.codes[number])):
                distances, lengths = state.push(signals.values[:, channels])
                covers = lengths >= _PART * len(signals)
                best = np.where(covers, distances, np.inf).min(axis=0)
                np.minimum.at(table[number], self.example[members], best)
            alive()
        return table


def _wanted(signals: Signals) -> np.ndarray:
    """(D,) channels that an example moves in; all that it has where it moves in none, as a posture."""
    assert signals.mask is not None and signals.present is not None
    moving = signals.mask & signals.present
    return np.asarray(moving if moving.any() else signals.present)
