"""What is counted while a run goes on: everything once, whatever becomes of it."""

from __future__ import annotations

import json
import re
import sys

import pytest

from gesture_core.cli import progress
from gesture_core.cli.progress import Bar, Events
from gesture_core.types import Row


def go(listener: Events) -> None:
    """Two inputs that are extracted, one of them in vain, one that nobody reads, and three examples."""
    listener.planned(3, 3, 3, "numpy")
    listener.extracted("e.mp4", cached=True)
    listener.extracted("vain.mp4", cached=False)
    listener.example_failed(Row("vain.mp4", code="E_MEDIA_BROKEN", message="vain.mp4: no"))
    listener.example_failed(Row("closed.npz", code="E_READ", message="closed.npz: no"))
    listener.row(Row("notes.md", status="skipped"))
    listener.frames("a.mp4", 40)
    listener.extracted("a.mp4", cached=False)
    listener.extracted("closed.mp4", cached=False)
    listener.row(Row("a.mp4", "00", status="ok"))
    listener.row(Row("a.mp4", "00", person=1, status="ok"))
    listener.row(Row("closed.mp4", status="error", code="E_READ"))


def test_the_bar_ends_at_its_end(capsys: pytest.CaptureFixture[str]) -> None:
    bar = Bar()
    assert bar.shown.total is None and "looking" in bar.shown.description
    go(bar)
    total: float | None = bar.shown.total
    assert (bar.shown.completed, total) == (6, 6)
    assert bar.shown.fields["speed"].startswith("40 frames, ")
    assert bar.shown.description == "keypoints"
    bar.stage("fitting")
    assert bar.shown.description == "fitting", "a wait says what for"
    assert "{" not in capsys.readouterr().err, "events are for programs"


def test_nothing_to_do_is_no_bar_of_zero() -> None:
    bar = Bar()
    bar.planned(3, 0, 1, "numpy")
    assert bar.shown.total is None
    bar.extracted("e.mp4", cached=True)
    assert bar.shown.fields["speed"] == "", "no frame was decoded"


def test_events_count_to_the_end(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(progress, "_SECONDS_BETWEEN_LINES", -1.0)
    go(Events(["in"], ["ex", "more"]))
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    planned = {"event": "planned", "inputs": 3, "waiting": 3, "examples": 3, "kernel": "numpy"}
    assert events[0] == {**planned, "sources": ["in"], "example_sources": ["ex", "more"]}
    assert [event["event"] for event in events].count("example_failed") == 2
    assert (events[-1]["files"], events[-1]["of"], events[-1]["seconds_left"]) == (6, 6, 0)
    assert (events[-1]["frames"], events[-1]["stage"]) == (40, "keypoints")


def test_a_terminal_is_told_first_what_is_worked_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(sys.stderr, "isatty", lambda: True)
        with progress.progress([f"{n}.mp4" for n in range(9)], ["ex\x1b[2J"]):
            pass
        with progress.progress(["only.mp4"]):
            pass
        with progress.progress(["a.mp4"], ["b"], quiet=True):
            pass
    assert re.findall("(?:sources|examples): .*", capsys.readouterr().err) == [
        "sources: 0.mp4 1.mp4 2.mp4 3.mp4 4.mp4, and 4 more",
        "examples: ex\\x1b[2J",
        "sources: only.mp4",
    ]


def test_the_network_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    events = progress.Events()
    for _ in range(2):
        events.network("compact")
    assert capsys.readouterr().err.count("compact") == 1


def test_stages_add_up(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """`gesture find` plans its clip and then the archive, `gesture report` examples, inputs and previews."""
    monkeypatch.setattr(progress, "_SECONDS_BETWEEN_LINES", -1.0)
    listener = Events(["in"])
    for names in (["clip.mp4"], ["a.mp4", "b.mp4", "clip.mp4"]):
        listener.planned(len(names), len(names), 0, "")
        for name in names:
            listener.extracted(name, cached=True)
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    shown = [(one["files"], one["of"]) for one in events if one["event"] == "progress"]
    assert shown == [(1, 1), (2, 4), (3, 4), (4, 4)]
    assert all(one["seconds_left"] >= 0 for one in events if one["event"] == "progress")
