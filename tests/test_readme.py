"""The README cannot rot: its commands and its Python are run, its table is compared with the code."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from conftest import ROOT
from pages import blocks, spoken_commands, table, write_folder

from gesture_core.cli.main import app, run
from gesture_core.demo.archive import DemoArchive

README = ROOT / "README.md"
TEXT = README.read_text("utf-8")
BLOCKS = blocks(README)
COMMANDS = [command for block in BLOCKS for command in block.commands]


@pytest.fixture(scope="module")
def folder(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the README supposes."""
    return write_folder(drawn, tmp_path_factory.mktemp("readme"))


def test_it_is_short() -> None:
    assert len(TEXT.splitlines()) <= 150


def test_every_command_in_a_block_runs_in_order(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    assert len(COMMANDS) >= 5
    for command in COMMANDS:
        assert run(shlex.split(command)[1:]) == 0, (command, capsys.readouterr().err)
    for name in (
        "run/results.csv",
        "run/explain-cam1_0001.mp4.png",
        "scores/confusion.png",
        "run/report/index.html",
    ):
        assert (folder / name).is_file(), name


@pytest.mark.parametrize("command", list(spoken_commands(README)))
def test_every_command_in_the_text_is_understood(command: str) -> None:
    words = [word.strip("[]").split("|")[0] for word in shlex.split(command)[1:]]
    if words[0] == "classify" and "…" in words:
        words = ["classify", "videos/", "--examples", "examples/", "--out", "run/"]
    if words[1:] == []:  # a command is spoken of, not shown
        assert words[0] in app
        return
    app.parse_args(words, exit_on_error=False, print_error=False)


def test_the_python_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    (text,) = (block.text for block in BLOCKS if block.kind == "python")
    names: dict[str, object] = {}
    exec(compile(text.replace('"run/"', '"run-python/"'), "README.md", "exec"), names)
    assert names["labels"] == ["wave", "wave", "clap", "clap"]


def test_the_table_of_commands_is_that_of_the_code() -> None:
    shown = {re.match(r"`gesture (\w+)", cells[0])[1] for cells in table(README, "command")}  # type: ignore[index]
    assert shown == {name for name in app if not name.startswith("-")}


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
