"""The end of a run as people read it: which labels there were, which there could not be, what to do next."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from gesture_core.classify.examples import sided_labels
from gesture_core.cli.classify import say_summary
from gesture_core.run.pipeline import RunSummary
from gesture_core.types import Row


def said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], **facts: object) -> list[str]:
    with monkeypatch.context() as patch:
        patch.setattr(sys.stderr, "isatty", lambda: True)
        say_summary(RunSummary(Path("run"), {"ok": 2, "error": 1}, **facts))  # type: ignore[arg-type]
    return capsys.readouterr().err.splitlines()


def test_labels_are_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(monkeypatch, capsys, classes={"clap": 1, "wave": 2, "wawe\x1b": 1}, lost_classes=("up",))
    assert lines == [
        "nothing to do: all rows (1 error, 2 ok) are in run/run.db; --retry-errors tries errors again",
        "examples: clap 1, wave 2, wawe\\x1b 1",
        "no example of up can be used: no input gets such a label",
    ]
    many = said(monkeypatch, capsys, classes={f"c{n:02d}": 1 for n in range(35)})
    assert many[1].endswith("c29 1, and 5 more")


def test_labels_and_what_is_right_of_them_are_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given = (("wave", "wave"), ("wave", "clap"), ("clap", "clap"), ("clap", None))
    rows = [
        Row(f"in/{folder}/x.mp4", label=label, status="ok" if label else "rejected")
        for folder, label in given
    ]
    summary = RunSummary(Path("run"), {"ok": 3, "rejected": 1}, classes={"clap": 1, "wave": 2})
    with monkeypatch.context() as patch:
        patch.setattr(sys.stderr, "isatty", lambda: True)
        say_summary(summary, rows)
        said = capsys.readouterr().err
        assert "labels: (none) 1, clap 2, wave 1\n" in said
        assert "2 of 4 labels are those of the inputs' folders (50.0%)\n" in said
        say_summary(summary, [*rows, Row("in/monday/x.mp4", label="wave", status="ok")])
        assert "folders" not in capsys.readouterr().err, "monday is no label"
    told = {"a/one.ts::wave/1": "wave", "clap/all.json::2": "clap", "zip://clap/1.mp4::file:///b.zip": ""}
    say_summary(summary, [Row(name, label=label, status="ok") for name, label in told.items()])
    assert json.loads(capsys.readouterr().err)["right"] == 2, "a series is called label/number"
    say_summary(summary, rows)
    event = json.loads(capsys.readouterr().err)
    assert event["labels"] == {"(none)": 1, "clap": 2, "wave": 1} and event["right"] == 2


def test_one_label_is_no_choice(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no longer there, and without a row from now on: 2 inputs" in said(monkeypatch, capsys, gone=2)
    lines = said(monkeypatch, capsys, classes={"wave": 3}, inputs_among_examples=1)
    assert lines[-1] == "1 input is among the examples itself: its label is no result"
    lines = said(monkeypatch, capsys, classes={"wave": 3})
    assert lines[-1] == "all examples have one label: every input that is near enough gets it"
    lines = said(monkeypatch, capsys, classes={"wave": 3, "Wave": 1, "left-hand": 1, "left_hand": 2, "x": 1})
    assert lines[-2].endswith("spaces or dashes: wave, Wave") and lines[-1].endswith(": left-hand, left_hand")
    assert len(said(monkeypatch, capsys)) == 1, "keypoints alone have no labels"


@pytest.mark.parametrize(
    ("labels", "sided"),
    [
        (("left", "right", "wave"), ["left"]),
        (("turn-Left", "Turn-right", "swipe left"), ["turn-Left"]),
        (("leftover", "wave"), []),
    ],
)
def test_labels_that_differ_by_the_side_are_said(
    labels: tuple[str, ...],
    sided: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert sided_labels(labels) == sided
    lines = said(monkeypatch, capsys, classes=dict.fromkeys(labels, 1), sided=tuple(sided))
    assert ("--set classify.mirror=none" in lines[-1]) == bool(sided)
