"""`Spotter`: examples in, then the events of whole recordings, or of a stream as its frames come."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from gesture_core.classify.recognizer import Recognizer
from gesture_core.errors import GestureError, InputError
from gesture_core.records import Event
from gesture_core.settings import Settings, load_settings
from gesture_core.signals.chain import Chain
from gesture_core.spot.candidates import Candidate, Search
from gesture_core.spot.examples import NONE, SpottingExamples
from gesture_core.spot.live import LiveSignals
from gesture_core.spot.signals import refuse_channels, refuse_limits, spans, stream_chain
from gesture_core.spot.suppression import Suppression, merged
from gesture_core.types import PoseSequence, Recording, Signals

BLOCK = 512
"""Frames of a recording that are compared at a time."""
LIVE_PATIENCE = 0.25
"""Seconds, unless ``spot.patience`` is set."""
_SUREST = 1.4
"""Times its threshold that a candidate may be away which the classifier is sure of."""
_SHORTEST = 2
"""Frames that a cut needs to be judged by the classifier."""
_LEAST = 1e-3
"""Of what a distance is divided by."""
_BEFORE = 1.0
"""Seconds before a candidate in which it is looked where else it may begin."""

Judge = Callable[[Sequence[Candidate]], list[Candidate]]


class EventSearch:
    """Signals of one stream in, events out, the same in whatever blocks they come.

    Parameters
    ----------
    examples : SpottingExamples
    present : (D,) bool
        Channels that the stream has.
    patience : float or None
        Seconds that an event waits for a better one, and besides what it lacks of the usual length of its
        gesture; None for as long as there can be one.
    judge : callable, optional
        The second stage: takes candidates, and gives back those that it agrees with, ranked.

    Attributes
    ----------
    refused : list of float
        Of gestures over which nothing was better, and that were farther than their threshold: how many times
        as far.
    """

    def __init__(
        self,
        examples: SpottingExamples,
        present: np.ndarray,
        patience: float | None = None,
        judge: Judge | None = None,
    ) -> None:
        self._examples, self._judge = examples, judge
        self.refused: list[float] = []
        worst = examples.thresholds * (_SUREST if judge and examples.recognizer else 1.0)
        self._search = Search(examples, present, worst)
        self._live, usual = patience is not None, examples.usual_seconds()

        def waits(one: Candidate) -> float:
            if patience is None:
                return 0.0
            return patience + max(0.0, float(usual[one.code]) - (one.end - one.start))

        self._suppression = Suppression(self._near, examples.settings.spot.overlap, waits)

    def push(self, values: np.ndarray, times: np.ndarray) -> list[Candidate]:
        """Events that are certain after the next (B, D) ``values`` at (B,) ``times``."""
        found = self._search.push(values, times)
        known = iter(self._judged([one for some in found for one in some]))
        following = next(known, None)
        events: list[Candidate] = []
        # What begins before this moment, and so could be better, has come.
        settled = times if self._live else self._search.earliest
        for now, some in zip(settled.tolist(), found, strict=True):
            for one in some:
                if following is not None and (one.end, one.code) == (following.end, following.code):
                    self._suppression.add(following)
                    following = next(known, None)
            events += self._suppression.settle(now)
        if len(times):
            self._suppression.forget(float(self._search.earliest[-1]))
        return self._gestures(events)

    def finish(self) -> list[Candidate]:
        """The events that were still waiting when the stream ended."""
        for one in self._judged(self._search.finish()):
            self._suppression.add(one)
        return self._gestures(self._suppression.settle(np.inf))

    def _near(self, one: Candidate) -> bool:
        threshold = self._examples.limits[one.code]
        near = bool(one.rank <= threshold)
        if not near and self._examples.classes[one.code] != NONE:
            self.refused.append(float(one.rank / max(threshold, _LEAST)))
        return near

    def _judged(self, candidates: list[Candidate]) -> list[Candidate]:
        return self._judge(candidates) if self._judge and candidates else candidates

    def _gestures(self, events: list[Candidate]) -> list[Candidate]:
        return [one for one in events if self._examples.classes[one.code] != NONE]


class Spotter:
    """Finds the gestures of some examples in long recordings, or in a stream of poses.

    Parameters
    ----------
    poses : sequence of PoseSequence or Recording
        Clips of one gesture each.
    labels : sequence of str
        ``_none`` for other movements: looked for like any gesture, and never an event.
    settings : Settings or str, optional
        Ready settings, or the name of a preset.
    names : sequence of str, optional
        What to call each example.
    live : bool
        For `push`: signals are those that a stream can have while it goes on. ``spot.live`` says the same.

    Attributes
    ----------
    refused : list of float
        Of gestures in the last recording that were farther than their threshold, with nothing better over
        them: how many times as far.

    Examples
    --------
    >>> from gesture_core import Spotter, load_poses
    >>> examples = load_poses("examples/")  # doctest: +SKIP
    >>> spotter = Spotter(examples, labels)  # doctest: +SKIP
    >>> for event in spotter.spot(recording):  # doctest: +SKIP
    ...     print(event.label, event.start, event.end)
    """

    def __init__(
        self,
        poses: Sequence[PoseSequence | Recording],
        labels: Sequence[str],
        settings: Settings | str | None = None,
        *,
        names: Sequence[str] | None = None,
        live: bool = False,
        alive: Callable[[], None] = lambda: None,
    ) -> None:
        ready = settings if isinstance(settings, Settings) else load_settings(settings)
        live = live or ready.spot.live
        refuse_limits(ready)
        self.examples = SpottingExamples.fit(ready, poses, labels, names, alive=alive)
        self._settings = ready
        self._clips = Chain.from_settings(ready)
        self._live: LiveSignals | None = None
        if live:
            refuse_channels(ready)
            self._live = LiveSignals(stream_chain(ready), ready.spot.gap)
        self._going: EventSearch | None = None
        self._source = ("", 0)
        self.refused: list[float] = []

    def spot(self, pose: PoseSequence | Recording) -> list[Event]:
        """The events of a whole recording of one person, by their starts.

        Warns
        -----
        UserWarning
            Where parts of the recording could not be searched.

        Raises
        ------
        GestureError
            Where no part gives signals; of the first one.
        """
        events, note = self.spot_with_note(pose)
        if note:
            warnings.warn(note, stacklevel=2)
        return events

    def spot_with_note(
        self, pose: PoseSequence | Recording, alive: Callable[[], None] = lambda: None
    ) -> tuple[list[Event], str]:
        """As `spot`, with what could not be searched as a text; ``alive`` is called now and then."""
        self.refused = []
        if self._live is not None and isinstance(pose, PoseSequence):
            return self._as_live(pose, alive), ""
        chain, chosen = self.examples.chain, self._settings.spot
        found: list[Candidate] = []
        failed: list[tuple[PoseSequence | Recording, GestureError]] = []
        parts = list(spans(pose, chosen.gap, chain.skeleton))
        for span in parts:
            try:
                signals = chain(span)
            except GestureError as error:
                failed.append((span, error))
                continue
            found += self.search(signals, span, chosen.patience, alive=alive)
        if failed and len(failed) == len(parts):
            raise failed[0][1]
        events = merged(found, self.examples.held.tolist(), chosen.merge)
        note = ""
        if failed:
            seconds = sum(float(span.times[-1] - span.times[0]) for span, _ in failed)
            note = (
                f"{len(failed)} of {len(parts)} parts in which the person is seen, {seconds:.1f} s together, "
                f"could not be searched: {failed[0][1].code}"
            )
        return [self._event(one, pose.source, pose.person) for one in events], note

    def _as_live(self, pose: PoseSequence, alive: Callable[[], None]) -> list[Event]:
        """The events of a whole recording that would have been found while it went on."""
        events: list[Event] = []
        for start in range(0, len(pose), BLOCK):
            events += self.push(pose.part(slice(start, start + BLOCK)))
            alive()
        return sorted(events + self.finish(), key=lambda event: (event.start, event.end))

    def search(
        self,
        signals: Signals,
        pose: PoseSequence | Recording,
        patience: float | None = None,
        block: int = BLOCK,
        alive: Callable[[], None] = lambda: None,
    ) -> list[Candidate]:
        """The events in ``signals``, which were made of ``pose``, in blocks of ``block`` frames."""
        assert signals.present is not None
        again = self.examples.again
        wide = again.chain(pose) if again else None
        search = EventSearch(
            self.examples, signals.present, patience, lambda some: self._judged(some, pose, wide)
        )
        found: list[Candidate] = []
        for start in range(0, len(signals), block):
            part = slice(start, start + block)
            found += search.push(signals.values[part], signals.times[part])
            alive()
        found += search.finish()
        self.refused += search.refused
        return found

    def push(self, pose: PoseSequence) -> list[Event]:
        """Take the next frames of a stream; the events that have become certain.

        Raises
        ------
        InputError
            Where the spotter was not made with ``live=True``.
        """
        if self._live is None:
            refuse_channels(self._settings)
            raise InputError(
                "this spotter is for recordings", remedy="Spotter(…, live=True)", code="E_OPTION"
            )
        self._source = (pose.source, pose.person)
        patience = self._settings.spot.patience
        patience = LIVE_PATIENCE if patience is None else patience
        found: list[Candidate] = []
        recent = self._live
        for part in self._live.push(pose.solid if self._settings.keypoints.depth else pose):
            if part is None:  # the person was lost
                found += self._ended()
                continue
            if self._going is None:
                assert part.present is not None
                self._going = EventSearch(
                    self.examples, part.present, patience, lambda some: self._judged(some, recent.pose)
                )
            found += self._going.push(part.values, part.times)
        return [self._event(one, *self._source) for one in found]

    def finish(self) -> list[Event]:
        """The events that were still waiting when the stream ended; the next `push` begins another one."""
        found = self._ended()
        if self._live is not None:
            self._live.clear()
        return [self._event(one, *self._source) for one in found]

    def _ended(self) -> list[Candidate]:
        """The last events of the stream that goes on, if there is one."""
        going, self._going = self._going, None
        if going is None:
            return []
        found = going.finish()
        self.refused += going.refused
        return found

    def _judged(
        self, candidates: Sequence[Candidate], pose: PoseSequence | Recording, signals: Signals | None = None
    ) -> list[Candidate]:
        """The candidates whose cut the classifier gives the same label, the surer it is the better ranked.

        A score is about 1 for the right class and 0 for another one, but where the nearest examples vote; at
        one half a candidate keeps its distance. ``signals`` are those of `SpottingExamples.again`, of the
        whole ``pose``; in a stream they are made of its last frames.
        """
        recognizer, again = self.examples.recognizer, self.examples.again
        if recognizer is None:
            return list(candidates)
        agreed: list[tuple[Candidate, float]] = []
        for one, scores in self._scored(recognizer, candidates, pose):
            code = int(scores.argmax())
            label = recognizer.library.classes[code]
            if np.isfinite(scores[code]) and label == self.examples.classes[one.code]:
                sure = max(2 * float(scores[code]), _LEAST) if not recognizer.fitted.votes else 1.0
                agreed.append((one, sure))
        if again is None or not agreed:
            return [replace(one, rank=one.distance / sure) for one, sure in agreed]
        if signals is None:
            first = min(one.start for one, _ in agreed) - _BEFORE
            try:
                signals = again.chain(pose.part(slice(int(np.searchsorted(pose.times, first)), None)))
            except GestureError:  # as a clip it would get no label either
                return []
        return [replace(one, rank=self._twice(again, one, signals) / sure) for one, sure in agreed]

    def _twice(self, again: SpottingExamples, one: Candidate, signals: Signals) -> float:
        """A candidate's distance and that of ``again`` to what ends with it in ``signals``: their mean."""
        assert signals.present is not None
        start, stop = np.searchsorted(signals.times, (one.start - _BEFORE, one.end + 1e-6))
        nearest = np.inf
        for _, channels, state in again.look_into(signals.present, one.code):
            distances, _ = state.push(signals.values[start:stop, channels])
            nearest = min(nearest, float(distances[-1:].min(initial=np.inf)))
        return float(np.sqrt(one.distance * nearest))

    def _scored(
        self, recognizer: Recognizer, candidates: Sequence[Candidate], pose: PoseSequence | Recording
    ) -> Iterator[tuple[Candidate, np.ndarray]]:
        """The candidates of whose cuts signals can be made, and the score of each class."""
        usable: list[tuple[Candidate, Signals]] = []
        for one in candidates:
            start = int(np.searchsorted(pose.times, one.start - 1e-9))
            stop = max(int(np.searchsorted(pose.times, one.end + 1e-9, side="right")), start + _SHORTEST)
            with suppress(GestureError):  # such a clip would get no label either
                usable.append((one, self._clips(pose.part(slice(start, stop)))))
        scores = recognizer.scores([signals for _, signals in usable])
        yield from zip((one for one, _ in usable), scores, strict=True)

    def _event(self, one: Candidate, source: str, person: int) -> Event:
        threshold = float(self.examples.limits[one.code])
        return Event(
            source,
            person,
            one.start,
            one.end,
            self.examples.classes[one.code],
            max(0.0, 1 - one.rank / threshold) if threshold > 0 else 0.0,
            one.distance,
            self.examples.names[one.example],
        )
