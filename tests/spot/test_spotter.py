"""Events of drawn recordings: found where they are, the same in any blocks, live and offline."""

from __future__ import annotations

import csv
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from streams import examples_of, strung

from gesture_core import Spotter, load_poses, load_settings
from gesture_core.demo.archive import DemoArchive
from gesture_core.dtw.subsequence import reference_subsequences
from gesture_core.errors import ConfigError, GestureError, InputError, PoseError
from gesture_core.spot.candidates import Candidate, Search
from gesture_core.spot.signals import spans, stream_chain
from gesture_core.spot.spotter import EventSearch
from gesture_core.spot.suppression import Suppression
from gesture_core.types import PoseSequence

SETTINGS = load_settings(None, ["spot.tempos="], environment={})


@pytest.fixture(scope="module")
def string(drawn: DemoArchive) -> tuple[PoseSequence, list[tuple[str, float, float]]]:
    poses = load_poses(drawn.video_keypoints, workers=1)
    with drawn.truth.open(encoding="utf-8", newline="") as file:
        known = {Path(line["path"]).stem: line["label"] for line in csv.DictReader(file)}
    labels = [known[Path(pose.source).name.partition("::")[0]] for pose in poses]
    pose, marks = strung(poses)
    return pose, [(label, *mark) for label, mark in zip(labels, marks, strict=True)]


@pytest.fixture(scope="module")
def spotter(drawn: DemoArchive) -> Spotter:
    poses, labels = examples_of(drawn)
    return Spotter(poses, labels, SETTINGS)


def test_events_are_where_the_gestures_are(
    spotter: Spotter, string: tuple[PoseSequence, list[tuple[str, float, float]]]
) -> None:
    pose, truth = string
    events = spotter.spot(pose)
    assert events == sorted(events, key=lambda event: event.start)
    met = [
        any(e.label == label and min(e.end, end) - max(e.start, start) > 0.5 * (end - start) for e in events)
        for label, start, end in truth
    ]
    assert sum(met) >= 0.8 * len(truth)
    assert all(0 <= event.score <= 1 and event.input == "string" for event in events)


@pytest.mark.parametrize("patience", [None, 0.3])
def test_blocks_make_no_difference(
    spotter: Spotter, string: tuple[PoseSequence, list[tuple[str, float, float]]], patience: float | None
) -> None:
    pose = string[0].part(slice(0, 400))
    signals = stream_chain(SETTINGS)(pose)
    whole = spotter.search(signals, pose, patience, block=10_000)
    assert whole
    for block in (1, 7, 100):
        assert spotter.search(signals, pose, patience, block=block) == whole


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_blocks_give_the_same_candidates(spotter: Spotter, data: st.DataObject) -> None:
    """Walks that resemble the examples, with and without a classifier's word, cut anywhere."""
    examples = spotter.examples
    rng = np.random.default_rng(data.draw(st.integers(0, 999)))
    known = [examples.series[place].values for place in rng.integers(0, len(examples.series), 3)]
    values = np.concatenate([*known, known[0] + rng.normal(0, 0.1, known[0].shape)]).astype(np.float32)
    times = np.cumsum(rng.uniform(0.03, 0.07, len(values)))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(values)), max_size=8)))
    patience = data.draw(st.sampled_from([None, 0.0, 0.2]))
    present = np.ones(values.shape[1], bool)

    def found(places: list[int]) -> list[Candidate]:
        search = EventSearch(examples, present, patience)
        blocks = zip(np.split(values, places), np.split(times, places), strict=True)
        return [event for block in blocks for event in search.push(*block)] + search.finish()

    whole = found([])
    assert whole
    assert found(cuts) == whole


@pytest.mark.parametrize(("patience", "step"), [(None, 0.05), (None, 0.4), (1.5, 0.05), (1.5, 0.4)])
def test_nothing_is_forgotten_that_could_keep_another_away(
    spotter: Spotter, monkeypatch: pytest.MonkeyPatch, patience: float | None, step: float
) -> None:
    """However slow the frames come: a subsequence is long by its frames, not by its seconds."""
    examples, rng = spotter.examples, np.random.default_rng(0)
    known = [examples.series[place].values for place in rng.integers(0, len(examples.series), 12)]
    values = np.concatenate([one + rng.normal(0, 0.1, one.shape) for one in known]).astype(np.float32)
    times = step * np.arange(len(values))

    def found() -> tuple[list[Candidate], int]:
        search = EventSearch(examples, np.ones(values.shape[1], bool), patience)
        events, most = [], 0
        for frame in range(len(values)):
            events += search.push(values[frame : frame + 1], times[frame : frame + 1])
            most = max(most, len(search._suppression._decided))
        return events + search.finish(), most

    events, most = found()
    monkeypatch.setattr(Suppression, "forget", lambda self, before: None)
    everything, all_of_them = found()
    assert events and everything == events
    assert most < all_of_them


def test_a_live_event_waits_for_what_it_lacks_of_its_gesture(spotter: Spotter) -> None:
    """Half a gesture comes before the whole one, resembles it, and must not keep it away."""
    # The classifier is not asked here, without which one example allows for less.
    examples = replace(spotter.examples, thresholds=np.ones(len(spotter.examples.classes)))
    usual = examples.usual_seconds()
    own = examples.series[:: 1 + len(SETTINGS.spot.tempos)]
    for code in range(len(examples.classes)):
        lengths = [
            one.times[-1] - one.times[0] for one, c in zip(own, examples.codes, strict=True) if c == code
        ]
        np.testing.assert_allclose(usual[code], np.mean(lengths))
    values, times = own[0].values, own[0].times
    rest = np.repeat(values[-1:], 80, axis=0)
    search = EventSearch(examples, np.ones(values.shape[1], bool), 0.0)
    step = times[1] - times[0]
    events = search.push(np.concatenate([values, rest]), times[0] + step * np.arange(len(values) + len(rest)))
    first = min(events + search.finish(), key=lambda event: event.start)
    assert first.code == examples.codes[0] and first.end > times[-1] - 0.25 * usual[first.code]


def test_what_is_shorter_than_its_gesture_usually_is_lacks_as_much(spotter: Spotter) -> None:
    examples, lacks = spotter.examples, []
    present = np.ones(examples.series[0].values.shape[1], bool)
    for one, code in zip(examples.series, examples.codes[examples.example], strict=True):
        search = Search(examples, present, np.inf)
        found = [some for frame in search.push(one.values, one.times) for some in frame] + search.finish()
        for some in found:
            lack = 0.75 * examples.usual_seconds()[some.code] / (some.end - some.start)
            np.testing.assert_allclose(some.lack, max(1.0, lack))
            np.testing.assert_allclose(some.order, some.distance * some.lack)
            lacks.append(some.lack)
        assert any(some.code == code and some.order < 1e-3 for some in found)
    assert min(lacks) == 1.0 < max(lacks)


@pytest.mark.parametrize("live", [False, True])
def test_what_the_classifier_agrees_with_is_looked_at_again_on_all_channels(
    spotter: Spotter, string: tuple[PoseSequence, list[tuple[str, float, float]]], live: bool
) -> None:
    examples, pose = spotter.examples, string[0].part(slice(0, 250))
    again = examples.again
    assert again is not None and again.recognizer is None and again.again is None
    assert set(examples.series[0].channels) < set(again.series[0].channels)
    np.testing.assert_allclose(examples.limits**2, examples.thresholds * again.thresholds)
    assert spotter._settings.spot.chain and not again.settings.spot.chain
    signals, wide = examples.chain(pose), again.chain(pose)
    assert signals.present is not None and wide.present is not None
    search = Search(examples, signals.present, examples.thresholds)
    found = [one for some in search.push(signals.values, signals.times) for one in some]
    judged = spotter._judged(found, pose, None if live else wide)
    assert judged
    for one in judged:
        rows = (wide.times > one.start - 1.01) & (wide.times <= one.end + 1e-6)
        ways = []
        for series, number in zip(again.series, again.example, strict=True):
            if again.codes[number] == one.code and series.mask is not None and series.present is not None:
                used = series.mask & series.present & wide.present
                pair = wide.values[rows][:, used], series.values[:, used]
                ways.append(reference_subsequences(*pair, SETTINGS.spot.floor)[0][-1])
        sure = np.sqrt(one.distance * min(ways)) / one.rank
        (alone,) = seen_once(spotter)._judged([one], pose)
        np.testing.assert_allclose(sure, one.distance / alone.rank, rtol=0.1 if live else 1e-3)


def seen_once(spotter: Spotter) -> Spotter:
    """``spotter`` without the second look."""
    other = copy(spotter)
    other.examples = replace(spotter.examples, again=None)
    return other


def test_nothing_is_looked_at_again_where_nobody_judges_or_all_channels_were_there(
    drawn: DemoArchive,
) -> None:
    poses, labels = examples_of(drawn)
    for text in ("spot.verify=false", "spot.chain="):
        chosen = load_settings(None, ["spot.tempos=", text], environment={})
        examples = Spotter(poses, labels, chosen).examples
        assert examples.again is None
        np.testing.assert_array_equal(examples.limits, examples.thresholds)


def test_one_gesture_is_found_where_there_is_nothing_to_tell_it_from(
    drawn: DemoArchive, string: tuple[PoseSequence, list[tuple[str, float, float]]]
) -> None:
    poses, labels = examples_of(drawn)
    pose, truth = string
    for wanted in sorted(set(labels)):
        own = [pose for pose, label in zip(poses, labels, strict=True) if label == wanted]
        events = Spotter(own, [wanted] * len(own), SETTINGS).spot(pose)
        places = [mark for label, *mark in truth if label == wanted]
        assert all(any(e.start < end and start < e.end for e in events) for start, end in places)
        nearest = sorted(events, key=lambda event: event.distance)[: len(places)]
        assert all(any(e.start < end and start < e.end for start, end in places) for e in nearest)


def test_a_copied_example_leaves_room_for_what_is_no_copy(drawn: DemoArchive) -> None:
    poses, labels = examples_of(drawn)
    plain = load_settings(None, ["spot.tempos=", "spot.verify=false"], environment={})
    limits = Spotter(poses, labels, plain).examples.thresholds
    twice = Spotter([*poses, *poses], [*labels, *labels], plain).examples
    np.testing.assert_allclose(twice.thresholds, limits, rtol=0.3)
    alone = Spotter([poses[0], poses[0]], [labels[0], labels[0]], plain).examples
    assert not alone.calibrated and (alone.thresholds > 0).all()


def test_the_last_gesture_before_the_person_is_lost_is_still_judged(
    drawn: DemoArchive, string: tuple[PoseSequence, list[tuple[str, float, float]]]
) -> None:
    poses, labels = examples_of(drawn)
    live = Spotter(poses, labels, SETTINGS, live=True)
    pose = string[0].part(slice(0, 60))
    label, _, end = string[1][0]
    stop = int(np.searchsorted(pose.times, end)) + 1
    before = pose.part(slice(0, stop))
    expected = live.push(before) + live.finish()
    assert [event.label for event in expected] == [label]
    later = replace(string[0].part(slice(0, 30)), times=string[0].times[:30] + end + 5)
    assert live.push(before) + live.push(later)[:1] == expected


def test_a_stream_has_the_same_events_however_its_frames_come(
    drawn: DemoArchive, string: tuple[PoseSequence, list[tuple[str, float, float]]]
) -> None:
    pose = string[0].part(slice(0, 220))
    poses, labels = examples_of(drawn)
    live = Spotter(poses, labels, SETTINGS, live=True)
    at_once = live.push(pose) + live.finish()
    assert at_once
    one_by_one = [
        event for frame in range(len(pose)) for event in live.push(pose.part(slice(frame, frame + 1)))
    ]
    assert one_by_one + live.finish() == at_once


def test_what_is_called_none_is_never_an_event(
    drawn: DemoArchive, string: tuple[PoseSequence, list[tuple[str, float, float]]]
) -> None:
    poses, labels = examples_of(drawn)
    other = labels[0]
    renamed = ["_none" if label == other else label for label in labels]
    found = {event.label for event in Spotter(poses, renamed, SETTINGS).spot(string[0])}
    assert found and not found & {"_none", other}
    with pytest.raises(ConfigError, match="_none"):
        Spotter(poses, ["_none"] * len(poses), SETTINGS)


def test_a_recording_without_the_person_has_no_events_and_says_why_where_signals_fail(
    spotter: Spotter, string: tuple[PoseSequence, list[tuple[str, float, float]]]
) -> None:
    pose = string[0].part(slice(0, 100))
    nobody = replace(pose, keypoints=np.full_like(pose.keypoints, np.nan))
    assert spotter.spot(nobody) == []
    with pytest.raises(GestureError, match="at least 5"):
        spotter.spot(pose.part(slice(0, 3)))
    with pytest.raises(InputError, match="live"):
        spotter.push(pose)


def test_a_lost_person_begins_a_new_stream(
    string: tuple[PoseSequence, list[tuple[str, float, float]]],
) -> None:
    pose = string[0].part(slice(0, 200))
    points = pose.keypoints.copy()
    lost = (pose.times > 1.0) & (pose.times < 2.5)
    points[lost] = np.nan
    parts = list(spans(replace(pose, keypoints=points), 1.0))
    assert [round(float(part.times[0])) for part in parts] == [0, 3] or len(parts) == 2
    assert sum(map(len, parts)) == len(pose) - int(lost.sum())


def test_a_stream_keeps_the_depth_that_its_network_gives(drawn: DemoArchive) -> None:
    poses, labels = examples_of(drawn)
    pose = replace(
        poses[0], keypoints=poses[0].keypoints.copy(), depth=20 * np.sin(poses[0].keypoints[..., 0])
    )
    spotter = Spotter([pose.solid], labels[:1], "depth", live=True)
    nobody = replace(poses[0].part(slice(5)), keypoints=np.full((5, 18, 2), np.nan))
    for part in (nobody, pose, replace(nobody, times=pose.times[-1] + 0.05 + nobody.times)):
        spotter.push(part)
    live = spotter._live
    assert live is not None and live.pose.keypoints.shape[2] == 3
    assert np.nanmax(live.pose.keypoints[..., 2]) > 0
    with pytest.raises(PoseError, match="no depth"):
        spotter.push(replace(poses[0], times=poses[0].times + 100))
