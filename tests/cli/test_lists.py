"""What a shell's pattern puts on a command line: every list is taken whole, or refused with what to write."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest

from gesture_core.demo.archive import DemoArchive

main = importlib.import_module("gesture_core.cli.main")  # the package has a function of this name
PLAIN = ["--kernel", "numpy", "--preset", "paper"]


@pytest.fixture
def places(drawn: DemoArchive, tmp_path: Path) -> dict[str, Path]:
    """Three clips, and the examples in two folders of their own."""
    for number, label in enumerate(sorted(drawn.example_keypoints.iterdir())):
        folder = tmp_path / f"ex{number % 2}"
        folder.mkdir(exist_ok=True)
        (folder / label.name).symlink_to(label)
    clips = sorted(drawn.video_keypoints.iterdir())[:3]
    return {"a": clips[0], "b": clips[1], "c": clips[2], "ex0": tmp_path / "ex0", "ex1": tmp_path / "ex1"}


def rows(
    places: dict[str, Path], out: Path, words: str, capsys: pytest.CaptureFixture[str]
) -> tuple[list[str], dict[str, object]]:
    """Names of the inputs that came of a command line, and its event ``planned``."""
    arguments = words.format(**places, out=out).split()
    place = arguments.index("--") if "--" in arguments else len(arguments)
    code = main.run([*arguments[:place], *PLAIN, *arguments[place:]])
    said = capsys.readouterr()
    assert code == 0, said.err
    planned = json.loads(said.err.splitlines()[0])
    return [Path(json.loads(line)["input"]).name for line in said.out.splitlines()], planned


@pytest.mark.parametrize(
    "words",
    [
        "classify {a} {b} --examples {ex0} {ex1} --out {out}",
        "classify {a} {b} --out {out} --examples {ex0} --examples {ex1}",
        "classify --examples {ex0} {ex1} --out {out} {a} {b}",
        "classify --examples {ex0} {ex1} --out {out} -- {a} {b}",
        "classify --out {out} {a} {b} --examples {ex0} {ex1}",
    ],
)
def test_examples_take_everything_up_to_the_next_option(
    places: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str
) -> None:
    names, planned = rows(places, tmp_path / "run", words, capsys)
    assert names == [places["a"].name, places["b"].name]
    assert planned["sources"] == [str(places["a"]), str(places["b"])]
    assert planned["example_sources"] == [str(places["ex0"]), str(places["ex1"])]
    assert planned["examples"] == 6


def test_other_commands_take_all_sources_too(
    places: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["extract", *(str(places[name]) for name in "abc"), "--out", str(tmp_path / "run")]
    assert main.run(arguments) == 0
    assert len(capsys.readouterr().out.splitlines()) == 3
    assert main.run(["bench", str(places["a"]), str(places["b"]), "--kernel", "numpy"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["series"] == 2
    labels = [str(path) for place in ("ex0", "ex1") for path in sorted(places[place].iterdir())]
    one_each = ["--labels", r"/([a-z-]+)/[0-9]+$", "--protocol", "leave-one-out", *PLAIN]
    assert main.run(["evaluate", *labels, *one_each, "--grid", "t_var=0.01,0.1"]) == 0
    said = capsys.readouterr()
    best = json.loads(said.out.splitlines()[-1])
    assert (best["right"], best["tested"]) == (0, 6) and "6 of 6 tests cannot be right" in said.err
    assert json.loads(said.err.splitlines()[1])["sources"] == labels


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        ("classify --examples {ex0} {ex1} {a} --out {out}",
         "SOURCES is missing: --examples takes everything up to the next option; "
         "try: the sources before --examples, or last after --"),
        ("classify {a} --examples --out {out}", "--examples needs a value"),
        ("classify {a} --out {out} {b} --examples {ex0}", "apart from the other sources"),
        ("classify {a} --examples {ex0} --labels x.csv y.csv --out {out}", "y.csv stands apart"),
        ("classify {a} --examples {ex0} --out {out} --set dtw.window=3 neighbors=1",
         "--set again: --set KEY=VALUE --set neighbors=1"),
        ("classify --set dtw.window=3 neighbors=1 --examples {ex0} --out {out}",
         "--set again: --set KEY=VALUE --set neighbors=1"),
        ("extract {a} --out {out} {out}2", "2 stands apart from the other sources, behind an option; "
         "try: all sources before the options, or last after --"),
        ("extract --set keypoints.fps=25 people=multi --out {out}", "--set KEY=VALUE --set people=multi"),
        ("evaluate {ex0} --grid mirror=1.1,1.2 rest=0.1", "--grid again: --grid KEY=VALUE --grid rest=0.1"),
        ("evaluate --grid mirror=1.1,1.2 rest=0.1 {ex0}", "--grid again: --grid KEY=VALUE --grid rest=0.1"),
        ("evaluate {ex0} --set a=1 b=2", "--set again: --set KEY=VALUE --set b=2"),
        ("bench {a} --set dtw.window=3 dtw.cost=squared", "--set KEY=VALUE --set dtw.cost=squared"),
        ("bench --set dtw.window=3 dtw.cost=squared", "--set KEY=VALUE --set dtw.cost=squared"),
        ("render {a} {b} {b}", "is not understood here; try: gesture render --help"),
        ("render a.mp4 --set keypoints.fps=25 people=multi", "--set KEY=VALUE --set people=multi"),
        ("demo --set dtw.window=3 neighbors=1", "--set KEY=VALUE --set neighbors=1"),
        ("models add x.onnx --contract colour=rgb scale=2", "--contract KEY=VALUE --contract scale=2"),
        ("explain {out} {a} {b}", "is not understood here"),
        ("export {a} {b}", "is not understood here"),
        ("settings dtw classify", "is not understood here"),
    ],
)  # fmt: skip
def test_what_could_be_meant_otherwise_is_refused(
    places: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str, hint: str
) -> None:
    before = sorted(tmp_path.iterdir())
    assert main.run(words.format(**places, out=tmp_path / "run").split()) == 2
    said = capsys.readouterr()
    assert hint in said.err and not said.out
    assert sorted(tmp_path.iterdir()) == before, "a mistake leaves nothing behind"


def test_a_name_with_an_equals_sign_is_a_name(
    places: dict[str, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a=1").symlink_to(places["a"])
    assert main.run(["extract", "--set", "keypoints.fps=25", "a=1", "--out", "run"]) == 0
    assert json.loads(capsys.readouterr().out)["input"] == "a=1"


def test_a_traceback_is_shown_where_it_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for command in main._COMMANDS:
        wrong = [command, "absent", "absent", "--absent", "--traceback"]
        assert main.run(wrong) == 2
        assert "Traceback (most recent call last)" in capsys.readouterr().err
    export = ["export", str(tmp_path / "absent\x1b[2J")]
    assert main.run(export) == 2
    assert "Traceback" not in capsys.readouterr().err
    assert main.run([*export, "--traceback"]) == 2
    said = capsys.readouterr().err
    assert "in export" in said and said.splitlines()[-1].startswith("E_NO_RUN") and "\x1b" not in said
    monkeypatch.setenv("GESTURE_TRACEBACK", "1")
    assert main.run(export) == 2
    assert "Traceback" in capsys.readouterr().err
    monkeypatch.setenv("GESTURE_TRACEBACK", "0")
    monkeypatch.chdir(tmp_path)
    assert main.run(["extract", "--out", "run", "--", "--traceback"]) == 2
    assert capsys.readouterr().err.startswith("E_NOT_FOUND --traceback"), "what follows -- is a name"
