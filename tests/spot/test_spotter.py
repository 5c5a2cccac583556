"""Events of drawn recordings: found where they are, the same in any blocks, live and offline."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from streams import examples_of, strung

from gesture_core import Spotter, load_poses, load_settings
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.spot.signals import part_of, spans, stream_chain
from gesture_core.types import PoseSequence

SETTINGS = load_settings(None, ["classify.kernel=numpy"], environment={})


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
    pose = part_of(string[0], 0, 400)
    signals = stream_chain(SETTINGS, SETTINGS.spot.mean)(pose)
    whole = spotter.search(signals, pose, patience, block=10_000)
    assert whole
    for block in (1, 7, 100):
        assert spotter.search(signals, pose, patience, block=block) == whole


def test_a_stream_has_the_same_events_however_its_frames_come(
    drawn: DemoArchive, string: tuple[PoseSequence, list[tuple[str, float, float]]]
) -> None:
    pose = part_of(string[0], 0, 220)
    poses, labels = examples_of(drawn)
    live = Spotter(poses, labels, SETTINGS, live=True)
    at_once = live.push(pose) + live.finish()
    assert at_once
    one_by_one = [event for frame in range(len(pose)) for event in live.push(part_of(pose, frame, frame + 1))]
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
    pose = part_of(string[0], 0, 100)
    nobody = replace(pose, keypoints=np.full_like(pose.keypoints, np.nan))
    assert spotter.spot(nobody) == []
    with pytest.raises(GestureError, match="at least 5"):
        spotter.spot(part_of(pose, 0, 3))
    with pytest.raises(InputError, match="live"):
        spotter.push(pose)


def test_a_lost_person_begins_a_new_stream(
    string: tuple[PoseSequence, list[tuple[str, float, float]]],
) -> None:
    pose = part_of(string[0], 0, 200)
    points = pose.keypoints.copy()
    lost = (pose.times > 1.0) & (pose.times < 2.5)
    points[lost] = np.nan
    parts = list(spans(replace(pose, keypoints=points), 1.0))
    assert [round(float(part.times[0])) for part in parts] == [0, 3] or len(parts) == 2
    assert sum(map(len, parts)) == len(pose) - int(lost.sum())
