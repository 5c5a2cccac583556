"""Why an event is one: the example that it resembles, how both run, and what each channel costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gesture_core.classify.explanation import Alignment, Explanation
from gesture_core.errors import InputError
from gesture_core.settings import Settings
from gesture_core.spot.examples import SpottingExamples
from gesture_core.spot.signals import spans
from gesture_core.types import Event, PoseSequence, Signals

_STEPS = ((1, 1), (1, 2), (2, 1))
"""Frames of the stream and of the example by which a path goes on, see `gesture_core.dtw.subsequence`."""


class EventExplainer:
    """Aligns events with their examples, which are fitted once.

    Parameters
    ----------
    examples, labels, names
        Those of the run.
    settings : Settings
        Of the run.
    """

    def __init__(
        self,
        examples: Sequence[PoseSequence],
        labels: Sequence[str],
        names: Sequence[str],
        settings: Settings,
    ) -> None:
        self._settings = replace(settings, spot=replace(settings.spot, verify=False))
        self._known = SpottingExamples.fit(self._settings, examples, labels, names)
        self._latest: tuple[PoseSequence, float, Signals] | None = None

    def __call__(self, event: Event, pose: PoseSequence) -> Explanation:
        """Align an event with its example, and with the nearest example of another label that ends with it.

        Parameters
        ----------
        event : Event
        pose : PoseSequence
            The recording of the event's person.

        Raises
        ------
        InputError
            ``E_NO_COMMON`` where the event cannot be found again.
        """
        known, signals = self._known, self._signals(event, pose)
        last = int(np.searchsorted(signals.times, event.end - 1e-6))
        last = min(last, len(signals) - 1)
        first = max(0, last + 1 - 2 * max(map(len, known.series)) - 2)
        assert signals.present is not None
        ways: dict[int, tuple[float, int, np.ndarray]] = {}
        for members, channels, state in known.look_into(signals.present):
            distances, lengths = state.push(signals.values[first : last + 1, channels])
            for column, member in enumerate(members.tolist()):
                if np.isfinite(distances[-1, column]):
                    ways[member] = float(distances[-1, column]), int(lengths[-1, column]), channels
        own = [n for n in ways if known.names[known.example[n]] == event.example]
        other = [n for n in ways if known.classes[known.codes[known.example[n]]] != event.label]
        if not own:
            raise InputError(
                "its example does not end with the event", subject=event.input, code="E_NO_COMMON"
            )
        sides = []
        for some in (own, other):
            if some:
                best = min(some, key=lambda n: ways[n][0])
                distance, length, channels = ways[best]
                part = slice(last + 1 - length, last + 1)
                number = int(known.example[best])
                tempos = 1.0, *self._settings.spot.tempos
                tempo, example = tempos[best % len(tempos)], known.series[best]
                found = _align(signals, part, example, channels, self._settings.spot.floor)
                # What is shown of the example is at its own time, not at the tempo at which it fits.
                found = replace(found, signals=replace(example, times=example.times / tempo))
                label = known.classes[known.codes[number]]
                sides.append(replace(found, example=known.names[number], label=label, distance=distance))
        return Explanation(sides[0], sides[1] if len(sides) > 1 else None)

    def _signals(self, event: Event, pose: PoseSequence) -> Signals:
        """Those of the part of a recording in which the event is; the latest are kept for the next event."""
        chain = self._known.chain
        for one in spans(pose, self._settings.spot.gap, chain.skeleton):
            if one.times[0] <= event.end <= one.times[-1] + 1e-6:
                start = float(one.times[0])
                if self._latest is None or self._latest[0] is not pose or self._latest[1] != start:
                    self._latest = pose, start, chain(one)
                return self._latest[2]
        raise InputError("the person is not there at that time", subject=event.input, code="E_NO_COMMON")


def _align(signals: Signals, part: slice, example: Signals, channels: np.ndarray, floor: float) -> Alignment:
    """A part of a stream against an example, on some channels."""
    query = replace(signals, values=signals.values[part], times=signals.times[part])
    x, y = query.values[:, channels].astype(np.float64), example.values[:, channels].astype(np.float64)
    path, paid = subsequence_path(x, y)
    size = np.sqrt((x.var(axis=0).sum() + floor) * (y.var(axis=0).sum() + floor))
    costs, used = np.zeros(len(signals.channels)), np.zeros(len(signals.channels), bool)
    costs[channels] = paid / len(y) / size
    used[channels] = True
    places = np.where(used, 0, -1)
    return Alignment("", "", float(costs.sum()), False, query, example, costs, used, (path,), places)


def subsequence_path(stream: np.ndarray, example: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The path of least cost through all of a (T, D) part of a stream and an (m, D) example.

    Returns
    -------
    path : (K, 2) int64
        Matched frames.
    paid : (D,) float64
        What each channel adds to its cost, which is that of `dtw.subsequence`.
    """
    cost = np.square(stream[:, None] - example[None])
    local = cost.sum(axis=2)
    rows, columns = local.shape
    table = np.full((rows + 1, columns + 1), np.inf)
    table[0, 0] = 0.0
    steps = np.zeros((rows + 1, columns + 1), np.int64)
    for t in range(rows):
        for j in range(columns):
            for number, (back, forth) in enumerate(_STEPS):
                if t + 1 < back or j + 1 < forth:
                    continue
                more = (
                    (local[t - 1, j] + local[t, j]) / 2
                    if back == 2
                    else local[t, j + 1 - forth : j + 1].sum()
                )
                value = table[t + 1 - back, j + 1 - forth] + more
                if value < table[t + 1, j + 1]:
                    table[t + 1, j + 1], steps[t + 1, j + 1] = value, number
    if not np.isfinite(table[-1, -1]):
        raise InputError(f"no path through {rows} and {columns} frames", code="E_NO_COMMON")
    path: list[tuple[int, int]] = []
    paid = np.zeros(stream.shape[1])
    t, j = rows - 1, columns - 1
    while t >= 0 and j >= 0:
        back, forth = _STEPS[steps[t + 1, j + 1]]
        if back == 2:
            cells, share = [(t, j), (t - 1, j)], 0.5
        else:
            cells, share = [(t, j - k) for k in range(forth)], 1.0
        for cell in cells:
            path.append(cell)
            paid += share * cost[cell]
        t, j = t - back, j - forth
    return np.array(path[::-1]), paid
