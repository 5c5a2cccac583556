"""Events against annotations, by hand."""

from __future__ import annotations

import pytest

from gesture_core.spot.evaluation import Annotation, match, score_events
from gesture_core.types import Event


def event(start: float, end: float, label: str = "wave", score: float = 0.5, name: str = "a") -> Event:
    return Event(name, 0, start, end, label, score, 0.5, "x")


def test_scores_by_hand() -> None:
    marks = [Annotation("a", 0, 10, "wave"), Annotation("a", 20, 30, "clap"), Annotation("b", 0, 10, "wave")]
    events = [event(0, 8), event(21, 35, "clap"), event(50, 60), event(0, 2, name="b")]
    scores = score_events(events, marks, 120)
    assert (scores.annotated, scores.reported, scores.minutes) == (3, 4, 2)
    assert scores.recall == {0.1: 1.0, 0.25: 2 / 3, 0.5: 2 / 3}
    assert scores.precision == {0.1: 3 / 4, 0.25: 1 / 2, 0.5: 1 / 2}
    assert scores.f1[0.5] == pytest.approx(2 * 2 / 7)
    assert scores.jaccard == pytest.approx((0.8 + 9 / 15 + 0.2) / 3)
    assert scores.false_alarms == 1.0
    assert scores.lateness == pytest.approx(1.5)


def test_an_annotation_is_met_once_by_the_best_score() -> None:
    mark = Annotation("a", 0, 10, "wave")
    good, better = event(0, 10, score=0.2), event(0, 9, score=0.9)
    assert match([good, better], [mark], 0.5) == [(better, mark)]
    assert match([event(0, 10, "clap"), event(0, 10, name="b")], [mark], 0.5) == []


def test_points_are_met_by_the_middle_of_an_event() -> None:
    marks = [Annotation("a", 5, 5, "wave"), Annotation("a", 8, 8, "wave")]
    scores = score_events([event(4, 6.5), event(8, 9)], marks, 60)
    assert scores.recall == {0.0: 0.5} and scores.f1 == {0.0: 0.5}
