"""Several people: assembled by part-affinity fields, joined into tracks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_networks import FIGURE

from gesture_core.plugin.interfaces import Person
from gesture_core.pose.decode import find_peaks
from gesture_core.pose.people import LIMBS, SAMPLES, Tracker, assemble, limb_scores

SIZE = (60, 100)


def draw(people: list[np.ndarray], skeleton: str = "coco18") -> tuple[np.ndarray, np.ndarray]:
    """Heat maps (J, h, w) and fields (2 L, h, w) of people (J, 2), NaN where a joint is missing."""
    joints = people[0].shape[0]
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    maps = np.zeros((joints, *SIZE))
    fields = np.zeros((2 * len(LIMBS[skeleton]), *SIZE))
    for person in people:
        for joint, (x, y) in enumerate(person):
            if not np.isnan(x):
                spot = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 3)
                maps[joint] = np.maximum(maps[joint], spot)
        for k, (a, b) in enumerate(LIMBS[skeleton]):
            step = person[b] - person[a]
            length = np.linalg.norm(step)
            if not length > 0:
                continue
            unit = step / length
            dx, dy = columns - person[a, 0], rows - person[a, 1]
            along, across = dx * unit[0] + dy * unit[1], np.abs(dx * unit[1] - dy * unit[0])
            on = (along >= -1) & (along <= length + 1) & (across <= 1.5)
            fields[2 * k][on], fields[2 * k + 1][on] = unit
    return maps, fields


def figure(x: float, y: float, size: float) -> np.ndarray:
    return FIGURE * size + (x, y)


def match(
    found: list[tuple[np.ndarray, np.ndarray]], people: list[np.ndarray], tolerance: float = 0.6
) -> None:
    """Each person is found once, each joint at its place."""
    assert len(found) == len(people)
    for person in people:
        distances = [np.nanmean(np.linalg.norm(points - person, axis=1)) for points, _ in found]
        best = found[int(np.argmin(distances))]
        np.testing.assert_array_equal(np.isnan(best[0][:, 0]), np.isnan(person[:, 0]))
        np.testing.assert_allclose(best[0], person, atol=tolerance)


def test_people_side_by_side_and_overlapping_are_told_apart() -> None:
    people = [figure(2, 4, 48), figure(20, 8, 46), figure(55, 2, 40)]
    maps, fields = draw(people)
    match(assemble(maps[None], fields[None], "coco18", 0.1)[0], people)


def test_a_person_with_hidden_joints_keeps_the_others() -> None:
    one, two = figure(2, 4, 48), figure(50, 4, 48)
    one[[3, 4, 16]] = np.nan
    maps, fields = draw([one, two])
    match(assemble(maps[None], fields[None], "coco18", 0.1)[0], [one, two])


def test_each_picture_of_a_batch_has_its_own_people() -> None:
    pictures = [[figure(2, 4, 48)], [figure(50, 4, 48), figure(2, 4, 40)], [figure(30, 4, 50)]]
    drawn = [draw(people) for people in pictures]
    maps, fields = (np.stack(part) for part in zip(*drawn, strict=True))
    for found, people in zip(assemble(maps, fields, "coco18", 0.1), pictures, strict=True):
        match(found, people)


def test_an_empty_picture_has_nobody_and_lone_joints_are_no_person() -> None:
    maps, fields = draw([figure(2, 4, 48)])
    assert assemble(np.zeros_like(maps)[None], fields[None], "coco18", 0.1) == [[]]
    assert assemble(maps[None], np.zeros_like(fields)[None], "coco18", 0.1) == [[]]


@settings(max_examples=30, deadline=None)
@given(st.floats(30, 44), st.floats(0, 50), st.floats(0, 10), st.sampled_from((4, 7, 10, 13, 16, 17)))
def test_one_person_is_found_at_any_place_and_size(size: float, x: float, y: float, hidden: int) -> None:
    person = figure(x + 2, y + 3, size)
    person[hidden] = np.nan
    maps, fields = draw([person])
    match(assemble(maps[None], fields[None], "coco18", 0.1)[0], [person])


def test_a_plateau_is_one_peak() -> None:
    maps = np.zeros((1, 1, 6, 8), np.float32)
    maps[0, 0, 2:4, 3:5] = 0.5
    n, _, _, scores = find_peaks(maps, 0.1)
    assert len(n) == 1 and scores[0] == 0.5


def test_the_line_integral_is_that_of_a_slow_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(1)
    field = random.normal(size=(2, 20, 30))
    starts, ends = random.uniform(0, 19, (4, 2)), random.uniform(0, 19, (5, 2))
    monkeypatch.setattr("gesture_core.pose.people.SHARE", 0.0)
    monkeypatch.setattr("gesture_core.pose.people.ALONG", -10)
    got = limb_scores(field, starts, ends)
    for i, a in enumerate(starts):
        for j, b in enumerate(ends):
            unit = (b - a) / np.linalg.norm(b - a)
            total = 0.0
            for t in np.linspace(0, 1, SAMPLES):
                x, y = np.rint(a + t * (b - a)).astype(int)
                total += field[0, y, x] * unit[0] + field[1, y, x] * unit[1]
            want = total / SAMPLES + min(15 / float(np.linalg.norm(b - a)) - 1, 0)
            assert got[i, j] == pytest.approx(max(want, 0), abs=1e-6)


def person(x: float, y: float, hidden: tuple[int, ...] = ()) -> Person:
    points = figure(x, y, 100).astype(np.float32)
    points[list(hidden)] = np.nan
    return Person(points, np.where(np.isnan(points[:, 0]), 0, 0.9).astype(np.float32))


def test_tracks_go_on_through_a_gap_whatever_the_order_of_people() -> None:
    tracker = Tracker(18)
    random = np.random.default_rng(0)
    for t in range(30):
        people = [person(4 * t, 0, hidden=(4,) if t % 2 else ()), person(300 - 4 * t, 160)]
        if 10 <= t < 15:
            people.pop()
        tracker.add([people[i] for i in random.permutation(len(people))])
    (first, one, _), (second, two, scores) = tracker.tracks()
    assert (first, second, len(one), len(two)) == (0, 0, 30, 30)
    np.testing.assert_allclose(one[20, 1], figure(80, 0, 100)[1], atol=1e-3)
    assert np.isnan(two[10:15]).all() and (scores[10:15] == 0).all()
    np.testing.assert_allclose(two[20, 1], figure(220, 160, 100)[1], atol=1e-3)


def test_a_flicker_is_no_person_and_a_late_comer_starts_late() -> None:
    tracker = Tracker(18)
    for t in range(20):
        people = [person(0, 0)]
        if t == 7:
            people.append(person(500, 500))
        if t >= 12:
            people.append(person(250, 0))
        tracker.add(people)
    assert [(first, len(points)) for first, points, _ in tracker.tracks()] == [(0, 20), (12, 8)]


def test_someone_who_comes_back_much_later_is_a_new_track() -> None:
    tracker = Tracker(18, patience=5)
    for t in range(40):
        tracker.add([person(0, 0)] if t < 10 or t >= 25 else [])
    assert sorted((first, len(points)) for first, points, _ in tracker.tracks()) == [(0, 10), (25, 15)]


def test_no_frames_and_no_people_are_no_tracks() -> None:
    assert Tracker(18).tracks() == []
    tracker = Tracker(18)
    tracker.add([])
    assert tracker.tracks() == []


@pytest.mark.parametrize("speeds", [(6.0, -5.0), (8.0, 2.5), (6.0, 0.0)])
def test_who_walks_behind_somebody_is_the_same_person_afterwards(speeds: tuple[float, float]) -> None:
    exchanged = 0
    for seed in range(8):
        random = np.random.default_rng(seed)
        tracker, start = Tracker(18), 300 - 45 * np.array(speeds) + random.uniform(-20, 20, 2)
        truth = []
        for t in range(90):
            places = start + np.array(speeds) * t
            both = [person(x, 4.0 * n) for n, x in enumerate(places)]
            hidden = abs(places[0] - places[1]) < 30
            order = random.permutation(1 if hidden else 2)
            tracker.add([both[n] for n in order])
            truth.append(places)
        for first, points, _ in tracker.tracks():
            seen = np.flatnonzero(~np.isnan(points[:, 0, 0]))
            middle = points[seen, 1, :1] - figure(0, 0, 100)[1, 0]
            known = np.array(truth)[first + seen]
            clear = np.abs(known[:, 0] - known[:, 1]) > 60
            who = np.abs(middle - known).argmin(axis=1)[clear]
            exchanged += len(set(who.tolist())) > 1
    assert exchanged <= 1
