"""Which candidates become events."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gesture_core.spot.candidates import Candidate
from gesture_core.spot.suppression import Suppression, merged


def one(start: float, end: float, distance: float, code: int = 0) -> Candidate:
    return Candidate(start, end, code, distance, 0, distance)


def settled(
    candidates: list[Candidate], threshold: dict[int, float], patience: float, usual: float = 0.0
) -> list[Candidate]:
    """As in a stream: a candidate is known when it ends, and waits for what it lacks of ``usual`` besides."""
    suppression = Suppression(
        lambda c: c.distance <= threshold[c.code],
        0.3,
        lambda c: patience + max(0.0, usual - (c.end - c.start)),
    )
    events = []
    for now in np.arange(0, 20, 0.05):
        for candidate in candidates:
            if abs(candidate.end - now) < 0.025:
                suppression.add(candidate)
        events += suppression.settle(float(now))
    return events + suppression.settle(np.inf)


def test_the_best_of_those_that_overlap_is_the_event() -> None:
    few = [one(1, 2, 0.3), one(1.2, 2.2, 0.1), one(1.4, 2.4, 0.2), one(3, 4, 0.5)]
    assert settled(few, {0: 1.0}, 5.0) == [few[1], few[3]]


def test_a_refused_candidate_keeps_worse_ones_away_and_no_better_ones() -> None:
    refused, worse, better = one(1, 2, 0.3, 1), one(1, 2.2, 0.4), one(1.5, 2.6, 0.2)
    limits = {0: 1.0, 1: 0.1}
    assert settled([refused, worse], limits, 5.0) == []
    assert settled([refused, better], limits, 5.0) == [better]
    assert settled([refused, better], limits, 0.1) == [better]  # it was refused long before


def test_what_is_too_short_comes_later_and_counts_for_as_much() -> None:
    part = replace(one(1, 1.5, 0.3), lack=2.0)
    whole, worse = one(1, 2, 0.5), one(1, 2, 0.7)
    assert settled([part, whole], {0: 1.0}, 5.0) == [whole]
    assert settled([part, worse], {0: 1.0}, 5.0) == [part]
    assert settled([part], {0: 0.4}, 5.0) == [part]  # whoever is fast is as near as anybody


def test_what_was_reported_is_not_taken_back() -> None:
    early, better = one(1, 2, 0.3), one(1.3, 2.6, 0.1)
    assert settled([early, better], {0: 1.0}, 5.0) == [better]
    assert settled([early, better], {0: 1.0}, 0.2) == [early]


def test_half_a_gesture_waits_for_the_whole_one() -> None:
    half, whole = one(1, 2, 0.3), one(1, 2.9, 0.2)
    assert settled([half, whole], {0: 1.0}, 0.3, usual=2.0) == [whole]
    assert settled([half, whole], {0: 1.0}, 0.3) == [half]


def test_one_that_a_suppressed_candidate_overlaps_still_counts() -> None:
    best, between, last = one(1, 2, 0.1), one(1.5, 2.5, 0.2), one(2.1, 3.1, 0.3)
    assert settled([best, between, last], {0: 1.0}, 5.0) == [best, last]


def test_neighbours_of_a_held_gesture_are_one_event() -> None:
    parts = [one(1, 2, 0.2), one(2.5, 4, 0.1), one(6, 7, 0.3)]
    assert [(e.start, e.end, e.distance) for e in merged(parts, [True], 1.0)] == [(1, 4, 0.1), (6, 7, 0.3)]
    assert merged(parts, [False], 1.0) == parts
