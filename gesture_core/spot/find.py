"""Query by example: where in recordings somebody does what a clip shows, the nearest first.

The distances are those of `gesture_core.dtw.subsequence`, exact. Of a stretch of a recording a bound is
computed first, from the box that its channels stay in: a path pays for each frame of the query at least what
lies outside the box, and no part of the stretch varies by more than a quarter of the square of the box
(Popoviciu 1935). Where that is more than the worst of the places that are kept, nothing is warped: most of a
recording in which people stand and wait.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gesture_core.errors import GestureError
from gesture_core.settings import Settings
from gesture_core.spot.candidates import Candidate, Search
from gesture_core.spot.examples import SpottingExamples
from gesture_core.spot.signals import spans
from gesture_core.types import PoseSequence, Signals

STRETCH = 64
"""Frames that one bound is about."""
_KEPT = 1 - 1e-4
"""Of a bound: kernels compute in float32."""


@dataclass(frozen=True, order=True)
class Hit:
    """A place where somebody does what the query shows.

    Attributes
    ----------
    distance : float
        0 is a copy; movements that have nothing in common are at about 1.
    input : str
        The recording, as the user named it.
    person : int
        Track number; 0 for the first or only one.
    start, end : float
        Seconds in the recording's own time.
    """

    distance: float
    input: str
    person: int
    start: float
    end: float


class Query:
    """A clip that is looked for in one recording after the other, and the best places so far.

    Parameters
    ----------
    pose : PoseSequence
        The clip.
    settings : Settings
        ``spot.tempos``, ``.chain``, ``.floor``, ``.gap`` and ``.overlap`` have a meaning here.
    top : int
        How many places are kept.

    Attributes
    ----------
    hits : list of Hit
        The best of all that was searched, nearest first.
    frames, warped : int
        Frames that were searched, and those of them for which a warping was computed.
    """

    def __init__(self, pose: PoseSequence, settings: Settings, top: int) -> None:
        spot = replace(settings.spot, verify=False, threshold=np.inf, live=False)
        self._settings = replace(settings, spot=spot)
        self._examples = SpottingExamples.fit(self._settings, [pose], ["query"], [pose.source])
        self._chain = self._examples.chain
        self._longest = 2 * max(map(len, self._examples.series)) + 2
        self._top = top
        self.hits: list[Hit] = []
        self.frames = self.warped = 0

    @property
    def worst(self) -> float:
        """Distance above which no place is kept any more."""
        return self.hits[-1].distance if len(self.hits) == self._top else np.inf

    def search(self, pose: PoseSequence, alive: Callable[[], None] = lambda: None) -> tuple[list[Hit], str]:
        """The places in a recording of one person that are among the best so far, and what was not searched.

        Raises
        ------
        GestureError
            Where no part of it gives signals.
        """
        found: list[Candidate] = []
        failed: list[GestureError] = []
        parts = list(spans(pose, self._settings.spot.gap, self._chain.skeleton))
        for span in parts:
            try:
                signals = self._chain(span)
            except GestureError as error:
                failed.append(error)
                continue
            found += self.candidates(signals, alive)
        if failed and len(failed) == len(parts):
            raise failed[0]
        new = [
            Hit(one.distance, pose.source, pose.person, one.start, one.end)
            for one in _apart(found, self._settings.spot.overlap, self._top)
        ]
        for hit in new:
            insort(self.hits, hit)
        del self.hits[self._top :]
        note = (
            f"{len(failed)} of {len(parts)} parts could not be searched: {failed[0].code}" if failed else ""
        )
        return [hit for hit in new if hit.distance <= self.worst], note

    def candidates(self, signals: Signals, alive: Callable[[], None] = lambda: None) -> list[Candidate]:
        """Minima of the distance in ``signals`` that are no worse than the worst that is kept."""
        assert signals.present is not None
        found: list[Candidate] = []
        search: Search | None = None
        worst = self.worst
        self.frames += len(signals)
        bounds = _Bounds(self._examples, signals)
        for start in range(0, len(signals), STRETCH):
            stop = min(start + STRETCH, len(signals))
            if bounds.least(max(0, start - self._longest), stop) > worst:
                found += search.finish() if search else []
                search = None
                continue
            # Whatever ends in this stretch begins after what is pushed first.
            first = start
            if search is None:
                search = Search(self._examples, signals.present, worst)
                first = max(0, start - self._longest)
            part = slice(first, stop)
            self.warped += stop - first
            for some in search.push(signals.values[part], signals.times[part]):
                found += some
            alive()
        return found + (search.finish() if search else [])


class _Bounds:
    """Lower bounds of the distances of all subsequences in stretches of one stream."""

    def __init__(self, examples: SpottingExamples, signals: Signals) -> None:
        self._values, self._floor = signals.values, examples.settings.spot.floor
        assert signals.present is not None
        looking = examples.look_into(signals.present)
        self._series = [
            (examples.series[number].values[:, channels], channels)
            for members, channels, _ in looking
            for number in members
        ]
        self._spreads = [float(values.var(axis=0, dtype=np.float64).sum()) for values, _ in self._series]

    def least(self, start: int, stop: int) -> float:
        """What no subsequence of the frames ``start`` to before ``stop`` is nearer than."""
        part = self._values[start:stop]
        low, high = part.min(axis=0), part.max(axis=0)
        least = np.inf
        for (values, channels), spread in zip(self._series, self._spreads, strict=True):
            below, above = low[channels], high[channels]
            outside = np.maximum(np.maximum(values - above, below - values), 0)
            cost = float(np.square(outside, dtype=np.float64).sum()) / len(values)
            variance = float(np.square((above - below).astype(np.float64)).sum()) / 4
            size = np.sqrt((spread + self._floor) * (variance + self._floor))
            least = min(least, cost / size if size > 0 else 0.0)
        return least * _KEPT


def _apart(candidates: Sequence[Candidate], overlap: float, most: int) -> list[Candidate]:
    """The nearest of those that overlap, nearest first, at most so many."""
    kept: list[Candidate] = []
    for one in sorted(candidates, key=lambda one: (one.distance, one.end)):
        if len(kept) == most:
            break
        if not any(one.overlaps(other, overlap) for other in kept):
            kept.append(one)
    return kept
