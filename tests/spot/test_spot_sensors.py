"""Events in long recordings of sensors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gesture_core import Spotter, classify_archive, explain, load_settings, spot_archive
from gesture_core.cli.main import run as gesture
from gesture_core.errors import ConfigError, InputError
from gesture_core.run.cut import cut_events
from gesture_core.run.find import find
from gesture_core.types import PoseSequence, Recording

RATE = 50
CHANNELS = ("acc/x", "acc/y", "acc/z", "gyro/x", "gyro/y", "gyro/z")
ORDER = ("shake", "turn", "turn", "shake", "turn")


def movement(kind: str, samples: int, seed: int, turns: float = 300.0) -> np.ndarray:
    """(T, 6) of a device that is moved; ``turns`` is the unit of its gyroscope."""
    clock, pace = np.arange(samples) / RATE, {"shake": 18, "turn": 5, "rest": 0}[kind]
    size = np.sin(np.pi * np.arange(samples) / samples)[:, None] * (kind != "rest")
    wave, other, none = np.sin(pace * clock), np.cos(pace * clock), np.zeros(samples)
    rng = np.random.default_rng(seed)
    acc = size * np.stack([wave, other, none], axis=1) + [0, 0, 9.8] + rng.normal(0, 0.03, (samples, 3))
    gyro = size * np.stack([other, none, wave], axis=1) + rng.normal(0, 0.01, (samples, 3))
    return np.hstack([acc, turns * gyro])


def examples(turns: float = 300.0) -> tuple[list[Recording], list[str]]:
    kinds = [kind for kind in ("shake", "turn") for _ in range(3)]
    lengths = (70, 80, 100) * 2
    values = [
        movement(kind, n, seed, turns) for seed, (kind, n) in enumerate(zip(kinds, lengths, strict=True))
    ]
    return [Recording(v, np.arange(len(v)) / RATE, CHANNELS, f"{n}") for n, v in enumerate(values)], kinds


def day(turns: float = 300.0) -> tuple[Recording, list[tuple[str, float, float]]]:
    """All of `ORDER` with rests between, and where each is."""
    parts, truth, at = [], [], 0
    for number, kind in enumerate(ORDER):
        parts += [movement("rest", 100, 20 + number, turns), movement(kind, 90, 40 + number, turns)]
        truth.append((kind, (at + 100) / RATE, (at + 190) / RATE))
        at += 190
    values = np.vstack([*parts, movement("rest", 100, 60, turns)])
    return Recording(values, np.arange(len(values)) / RATE, CHANNELS, "day"), truth


def save(path: Path, recording: Recording) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    head = ",".join(["time", *(name.replace("/", "_") for name in recording.channels)])
    table = np.column_stack([recording.times, recording.values])
    np.savetxt(path, table, "%.5f", ",", header=head, comments="")


@pytest.mark.parametrize("turns", [0.01, 300.0])
def test_gestures_are_found_whatever_the_units_are(turns: float) -> None:
    recording, truth = day(turns)
    events = Spotter(*examples(turns), "sensors").spot(recording)
    assert [event.label for event in events] == list(ORDER)
    for event, (_, start, end) in zip(events, truth, strict=True):
        assert abs(event.start - start) < 0.4 and abs(event.end - end) < 0.4


def test_a_recording_of_another_rate_and_with_a_gap(tmp_path: Path) -> None:
    recording, truth = day()
    kept = np.arange(0, len(recording), 2)
    kept = kept[(recording.times[kept] < 1.9) | (recording.times[kept] > 3.7)]  # without the first movement
    half = Recording(recording.values[kept], recording.times[kept], CHANNELS, "day")
    events = Spotter(*examples(), "sensors").spot(half)
    assert [event.label for event in events] == list(ORDER[1:])
    assert abs(events[0].start - truth[1][1]) < 0.4


def test_a_run_over_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number, (clip, label) in enumerate(zip(*examples(), strict=True)):
        save(tmp_path / "examples" / label / f"{number}.csv", clip)
    recording, truth = day()
    save(tmp_path / "recordings" / "day.csv", recording)
    folders = tmp_path / "recordings", tmp_path / "examples"
    with pytest.warns(UserWarning, match="one label here; gesture spot finds every gesture in them"):
        classify_archive(*folders, tmp_path / "labels", "sensors", engine="inline")
    summary = spot_archive(*folders, tmp_path / "run", "sensors", engine="inline")
    assert [row.label for row in summary.rows()] == list(ORDER)
    decided = explain(tmp_path / "run", "day.csv", event=2)
    assert decided.explanation.nearest.label == "turn"
    clips = cut_events(tmp_path / "run", tmp_path / "clips")
    assert [clip.file.suffix for clip in clips] == [".parquet"] * len(ORDER)
    again = classify_archive(tmp_path / "clips", folders[1], tmp_path / "again", "sensors", engine="inline")
    assert all(Path(row.input).parent.name == row.label for row in again.rows())
    found = find(tmp_path / "examples" / "turn" / "3.csv", folders[0], settings="sensors", top=3, workers=1)
    assert {round(hit.start) for hit in found.hits} == {
        round(start) for kind, start, _ in truth if kind == "turn"
    }
    assert (
        gesture(["watch", str(folders[0] / "day.csv"), "--examples", str(folders[1]), "--preset", "sensors"])
        == 2
    )
    assert "gesture spot" in capsys.readouterr().err


def test_what_happens_now_is_not_found_in_channels() -> None:
    with pytest.raises(ConfigError, match="while they happen"):
        Spotter(*examples(), "sensors", live=True)
    with pytest.raises(ConfigError, match="while they happen"):
        Spotter(*examples(), "sensors").push(
            PoseSequence(np.zeros((1, 18, 2)), np.ones((1, 18)), np.zeros(1))
        )


@pytest.mark.parametrize("verify", [True, False])
def test_other_channels_are_said_and_never_compared(verify: bool) -> None:
    settings = load_settings("sensors", spot__verify=verify, environment={})
    clips, labels = examples()
    renamed = replace(clips[0], channels=(*CHANNELS[:3], "mag/x", "mag/y", "mag/z"), source="odd")
    fewer = replace(clips[0], values=clips[0].values[:, :3], channels=CHANNELS[:3], source="odd")
    spotter = Spotter(clips, labels, settings)
    for other in (renamed, fewer):
        with pytest.raises(InputError, match=r"odd: .*other channels than the examples.*lacks gyro/x"):
            spotter.spot(other)
        with pytest.raises(InputError, match=r"example 6 \(odd\) has other channels than example 0"):
            Spotter([*clips, other], [*labels, "turn"], settings)
