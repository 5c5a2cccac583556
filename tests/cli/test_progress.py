"""What is counted while a run goes on: everything once, whatever becomes of it."""

from __future__ import annotations

import json

import pytest

from gesture_core.cli import progress
from gesture_core.cli.progress import _Bar, _Counter, _JsonLines
from gesture_core.types import Row


def go(listener: _Counter) -> None:
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
    bar = _Bar()
    assert bar._bar.tasks[0].total is None and "looking" in bar._bar.tasks[0].description
    go(bar)
    (task,) = bar._bar.tasks
    assert (task.completed, task.total) == (6, 6)
    assert "frames/s" in task.fields["speed"]


def test_nothing_to_do_is_no_bar_of_zero() -> None:
    bar = _Bar()
    bar.planned(3, 0, 1, "numpy")
    assert bar._bar.tasks[0].total is None
    bar.extracted("e.mp4", cached=True)
    assert bar._bar.tasks[0].fields["speed"] == "", "no frame was decoded"


def test_events_count_to_the_end(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(progress, "_SECONDS_BETWEEN_LINES", -1.0)
    go(_JsonLines())
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert events[0] == {"event": "planned", "inputs": 3, "waiting": 3, "examples": 3, "kernel": "numpy"}
    assert [event["event"] for event in events].count("example_failed") == 2
    assert (events[-1]["files"], events[-1]["of"], events[-1]["seconds_left"]) == (6, 6, 0)
