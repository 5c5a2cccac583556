"""The README cannot rot: its commands and its Python are run, its tables compared with the code."""

from __future__ import annotations

import csv
import re
import shlex
from pathlib import Path
from typing import get_args

import pytest
from conftest import ROOT

from gesture_core.cli.main import _COMMANDS, app, run
from gesture_core.demo.archive import DemoArchive
from gesture_core.demo.motions import GESTURES
from gesture_core.plugin.interfaces import KINDS
from gesture_core.settings import LimitSettings, load_settings
from gesture_core.types import COLUMNS, Status

TEXT = (ROOT / "README.md").read_text("utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
SHELL = [line for kind, text in BLOCKS if not kind for line in text.splitlines()]
COMMANDS = [line for line in SHELL if line.startswith("gesture ")]
INLINE = sorted({found.replace("\\|", "|") for found in re.findall(r"`(gesture [^`]+)`", TEXT)})
PYTHON = [text for kind, text in BLOCKS if kind == "python"]


def table(heading: str) -> list[list[str]]:
    """Cells of the table whose first heading is ``heading``."""
    rows = re.search(rf"^\| {re.escape(heading)} \|.*\n\|[-|]+\n((?:\|.*\n)+)", TEXT, re.MULTILINE)
    assert rows, heading
    escaped = rows[1].replace("\\|", "¦")
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in escaped.splitlines()]


@pytest.fixture(scope="module")
def folder(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the README supposes: examples/<label>/<clip> and videos/monday/<clip>; here with keypoints."""
    place = tmp_path_factory.mktemp("readme")
    for label in drawn.example_keypoints.iterdir():
        (place / "examples" / label.name).mkdir(parents=True)
        (place / "examples" / label.name / "anna_1").symlink_to(label / "1")
    with drawn.truth.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            clip = Path(row["path"]).stem
            if not (ben := place / "examples" / row["label"] / "ben_2").exists():
                ben.symlink_to(drawn.video_keypoints / clip)
    monday = place / "videos" / "monday"
    monday.mkdir(parents=True)
    (monday / "cam1_0001.mp4").write_bytes((drawn.videos / "clip_01.mp4").read_bytes())
    for number in range(2, 5):
        (monday / f"clip_{number}").symlink_to(drawn.video_keypoints / f"clip_{number:02d}")
    return place


def test_every_command_in_a_block_runs_in_order(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    assert len(COMMANDS) >= 6
    for command in COMMANDS:
        assert run(shlex.split(command)[1:]) == 0, (command, capsys.readouterr().err)
    for name in ("run/results.csv", "run/explain-cam1_0001.mp4.png", "scores/confusion.png", "seen.png"):
        assert (folder / name).is_file(), name


@pytest.mark.parametrize("command", INLINE)
def test_every_command_in_the_text_is_understood(command: str) -> None:
    words = [word.strip("[]").split("|")[0] for word in shlex.split(command)[1:]]
    if words[0] == "classify" and "…" in words:
        words = ["classify", "videos/", "--examples", "examples/", "--out", "run/"]
    if words[1:] == []:  # a command is spoken of, not shown
        assert words[0] in _COMMANDS
        return
    app.parse_args(words, exit_on_error=False, print_error=False)


def test_the_python_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert len(PYTHON) == 2
    for text in PYTHON:
        names: dict[str, object] = {}
        exec(compile(text.replace('"run/"', '"run-python/"'), "README.md", "exec"), names)
        if "labels" in names:
            assert names["labels"] == ["wave", "wave", "clap", "clap"]


def test_the_expression_for_labels_finds_the_gestures_of_the_demonstration() -> None:
    (expression,) = re.findall(r"--labels '([^']+)'", TEXT)
    for label in GESTURES:
        assert re.search(expression, f"{label}_1.avi")["label"] == label  # type: ignore[index]


def test_the_preset_loads(tmp_path: Path) -> None:
    (text,) = (text for kind, text in BLOCKS if kind == "toml")
    (tmp_path / "mine.toml").write_text(text)
    settings = load_settings(tmp_path / "mine.toml", environment={})
    assert settings.classify.reject == 0.5
    assert settings.options["resample"]["rate"] == 25.0


def test_the_tables_are_those_of_the_code() -> None:
    commands = {re.match(r"`gesture (\w+)", cells[0])[1] for cells in table("command")}  # type: ignore[index]
    assert commands == set(_COMMANDS)
    assert {cells[0].strip("`") for cells in table("status")} == set(get_args(Status))
    assert [cells[0].strip("`") for cells in table("hook")] == [kind.hook for kind in KINDS.values()]
    assert re.sub(r"\s+", " ", f"`{', '.join(COLUMNS)}`") in re.sub(r"\s+", " ", TEXT)
    defaults = LimitSettings()
    for name, value, _ in table("setting"):
        known = getattr(defaults, name.strip("`").removeprefix("limits."))
        assert float(re.sub(r"[^0-9.]", "", value)) == known, name


def test_links_lead_somewhere_and_pictures_are_small() -> None:
    anchors = {
        re.sub(r"[^\w -]", "", line.lstrip("# ").lower()).replace(" ", "-")
        for line in re.findall(r"^#+ .*$", TEXT, re.MULTILINE)
    }
    for target in re.findall(r"\]\(([^)\s]+)\)", TEXT):
        if target.startswith("#"):
            assert target[1:] in anchors, target
        elif "://" not in target:
            assert (ROOT / target).is_file(), target
            assert (ROOT / target).stat().st_size < 300_000, target
    for path in re.findall(r"`((?:gesture_core|plugins|tests|benchmarks|docs)/[\w./]+)`", TEXT):
        assert (ROOT / path).exists(), path
