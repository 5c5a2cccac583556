"""Subsequences that may be events: where the distance to a class has a local minimum in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.spot.examples import SpottingExamples

_AROUND = 2
"""Frames before and after an end that must be farther: each candidate costs the classifier a look."""
_SHORT = 0.75
"""Of the usual length of its gesture: what is shorter is often a part of it, or of another one."""
_MOMENT = 1e-6
"""Seconds that a subsequence has at least."""


@dataclass(frozen=True)
class Candidate:
    """A subsequence that may be an event.

    Attributes
    ----------
    start, end : float
        Seconds.
    code : int
        Index of its class.
    distance : float
    example : int
        The nearest one.
    rank : float
        What its threshold is asked of: the distance, or its mean with that on all channels, larger the less
        the classifier is sure of the class.
    lack : float
        How many times shorter it is than three quarters of what is usual of its class; at least 1.
    """

    start: float
    end: float
    code: int
    distance: float
    example: int
    rank: float
    lack: float = 1.0

    @property
    def order(self) -> float:
        """The lower, the better, of those that overlap."""
        return self.rank * self.lack

    def overlaps(self, other: Candidate, share: float) -> bool:
        """Whether the two have more than ``share`` of the shorter one in common."""
        shorter = min(self.end - self.start, other.end - other.start)
        return min(self.end, other.end) - max(self.start, other.start) > share * shorter


class Search:
    """The candidates in one stream, as its frames come.

    Parameters
    ----------
    examples : SpottingExamples
    present : (D,) bool
        Channels that the stream has.
    worst : float or (C,) float array
        Distance to each class above which no subsequence is a candidate.

    Attributes
    ----------
    earliest : (B,) float64
        After each of the frames last taken, when candidates that are still to come can begin at the earliest.
    """

    def __init__(self, examples: SpottingExamples, present: np.ndarray, worst: np.ndarray | float) -> None:
        self._looking = examples.look_into(present)
        self._example, self._worst = examples.example, worst
        self._short = _SHORT * examples.usual_seconds()
        classes, codes = len(examples.classes), examples.code_of_series()
        self._columns = [
            [np.flatnonzero(codes[members] == code) for code in range(classes)]
            for members, _, _ in self._looking
        ]
        # The frames before the next one: each class's distance, series and begin, and their times.
        self._best: np.ndarray = np.full((2 * _AROUND, classes), np.inf)
        self._series: np.ndarray = np.zeros((2 * _AROUND, classes), np.int64)
        self._begin: np.ndarray = np.zeros((2 * _AROUND, classes))
        self._keep = 2 * max(map(len, examples.series)) + 2 * _AROUND
        self._times: np.ndarray = np.full(self._keep, -np.inf)

    def push(self, values: np.ndarray, times: np.ndarray) -> list[list[Candidate]]:
        """Candidates that are known at each of the new frames, one list for each."""
        count, classes = len(values), self._best.shape[1]
        best: np.ndarray = np.full((count, classes), np.inf)
        series: np.ndarray = np.zeros((count, classes), np.int64)
        length: np.ndarray = np.ones((count, classes), np.int64)
        rows = np.arange(count)
        for (members, channels, state), columns in zip(self._looking, self._columns, strict=True):
            distances, lengths = state.push(values[:, channels])
            for code, own in enumerate(columns):
                if len(own) == 0:
                    continue
                nearest = own[distances[:, own].argmin(axis=1)]
                found = distances[rows, nearest]
                better = found < best[:, code]
                best[better, code] = found[better]
                series[better, code] = members[nearest[better]]
                length[better, code] = lengths[rows, nearest][better]
        self._times = np.concatenate([self._times[-self._keep :], times])
        self.earliest = self._times[:count]  # a subsequence has at most twice the frames of its example
        last = len(self._times) - count + rows
        begin = self._times[last[:, None] - length + 1]
        return self._minima(best, series, begin)

    def finish(self) -> list[Candidate]:
        """Candidates that end with the last frame."""
        self._times = np.append(self._times, self._times[[-1] * _AROUND])
        nothing: np.ndarray = np.full((_AROUND, self._best.shape[1]), np.inf)
        found = self._minima(nothing, np.zeros(nothing.shape, np.int64), np.zeros(nothing.shape))
        return [one for some in found for one in some]

    def _minima(self, best: np.ndarray, series: np.ndarray, begin: np.ndarray) -> list[list[Candidate]]:
        """Candidates that end `_AROUND` frames before each of the new ones."""
        found: list[list[Candidate]] = [[] for _ in best]
        ends = self._times[-len(best) - _AROUND : -_AROUND]
        self._best = np.concatenate([self._best, best])
        self._series = np.concatenate([self._series, series])
        self._begin = np.concatenate([self._begin, begin])
        middle = self._best[_AROUND:-_AROUND]
        least = np.lib.stride_tricks.sliding_window_view(self._best, _AROUND, axis=0).min(axis=-1)
        low = (middle <= least[: len(best)]) & (middle < least[_AROUND + 1 :]) & (middle <= self._worst)
        for frame, code in np.argwhere(low).tolist():
            one = frame + _AROUND
            distance, example = float(self._best[one, code]), int(self._example[self._series[one, code]])
            start, end = float(self._begin[one, code]), float(ends[frame])
            lack = max(1.0, float(self._short[code]) / max(end - start, _MOMENT))
            found[frame].append(Candidate(start, end, code, distance, example, distance, lack))
        kept = slice(-2 * _AROUND, None)
        self._best, self._series, self._begin = self._best[kept], self._series[kept], self._begin[kept]
        return found
