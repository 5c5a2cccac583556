"""How well events fit annotations: overlap in time, false alarms, lateness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median

from gesture_core.records import Event

OVERLAPS = (0.1, 0.25, 0.5)
"""Intersection over union in time from which on an event meets an annotation."""
POINT = 0.333
"""Seconds within which an event meets a point in time (Fothergill et al. 2012)."""


@dataclass(frozen=True)
class Annotation:
    """What a person has marked in a recording: an interval, or a point where both times are equal."""

    input: str
    start: float
    end: float
    label: str


@dataclass(frozen=True)
class EventScores:
    """What came of comparing events with annotations.

    Attributes
    ----------
    annotated, reported : int
    minutes : float
        Of the recordings.
    f1, recall, precision : mapping
        By overlap. Where the annotations are points, all are by distance in time, under the key 0.
    jaccard : float
        Mean over the annotations of the overlap with the best event of their label, 0 where there is none.
    false_alarms : float
        Events a minute that meet no annotation with half of their time.
    lateness : float or None
        Median of seconds from the end of an annotation to that of its event; None where none is met.
    unknown : mapping
        Number of annotations by each label that no event of the run can have; they count as missed.
    """

    annotated: int
    reported: int
    minutes: float
    f1: Mapping[float, float]
    recall: Mapping[float, float]
    precision: Mapping[float, float]
    jaccard: float
    false_alarms: float
    lateness: float | None
    unknown: Mapping[str, int] = field(default_factory=dict)


def overlap_of(event: Event, mark: Annotation) -> float:
    """Intersection over union in time."""
    both = min(event.end, mark.end) - max(event.start, mark.start)
    whole = max(event.end, mark.end) - min(event.start, mark.start)
    return max(0.0, both / whole) if whole > 0 else 0.0


def match(
    events: Sequence[Event], marks: Sequence[Annotation], overlap: float
) -> list[tuple[Event, Annotation]]:
    """Pairs of one input and label that overlap by ``overlap`` or more, the best score first.

    Where ``overlap`` is 0, the middle of the event must lie within `POINT` seconds of a mark that is a point.
    """
    free = list(marks)
    pairs: list[tuple[Event, Annotation]] = []
    for event in sorted(events, key=lambda one: -one.score):
        best, found = -1.0, None
        for mark in free:
            if (mark.input, mark.label) != (event.input, event.label):
                continue
            if overlap > 0:
                value = overlap_of(event, mark)
                fits = value >= overlap
            else:
                value = -abs((event.start + event.end) / 2 - (mark.start + mark.end) / 2)
                fits, value = value >= -POINT, 1.0 + value
            if fits and value > best:
                best, found = value, mark
        if found is not None:
            free.remove(found)
            pairs.append((event, found))
    return pairs


def score_events(events: Sequence[Event], marks: Sequence[Annotation], seconds: float) -> EventScores:
    """Compare the events in recordings of ``seconds`` altogether with what was marked in them."""
    points = bool(marks) and all(mark.start == mark.end for mark in marks)
    pairs = {overlap: match(events, marks, overlap) for overlap in ((0.0,) if points else OVERLAPS)}
    strictest = pairs[0.0 if points else OVERLAPS[-1]]
    best = [
        max(
            (overlap_of(e, m) for e in events if (e.input, e.label) == (m.input, m.label)),
            default=0.0,
        )
        for m in marks
    ]
    late = [event.end - mark.end for event, mark in strictest]
    minutes = seconds / 60
    return EventScores(
        len(marks),
        len(events),
        minutes,
        {key: 2 * len(found) / max(len(marks) + len(events), 1) for key, found in pairs.items()},
        {key: len(found) / max(len(marks), 1) for key, found in pairs.items()},
        {key: len(found) / max(len(events), 1) for key, found in pairs.items()},
        sum(best) / len(best) if best else 0.0,
        (len(events) - len(strictest)) / minutes if minutes > 0 else 0.0,
        median(late) if late else None,
    )
