"""The commands as a user runs them: through a pipe, with mistakes, with closed pipes."""

from __future__ import annotations

import csv
import errno
import importlib
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from distributions import gesture

from gesture_core.demo.archive import DemoArchive

main = importlib.import_module("gesture_core.cli.main")  # the package has a function of this name


@pytest.fixture(scope="module")
def run(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run on the drawn keypoint files."""
    out = tmp_path_factory.mktemp("cli") / "run"
    done = gesture("classify", drawn.video_keypoints, *options(drawn, out), "--quiet")
    assert done.returncode in (0, 3), done.stderr
    assert done.stdout == ""
    return out


def options(drawn: DemoArchive, out: Path) -> list[str]:
    chosen = ["--examples", str(drawn.example_keypoints), "--out", str(out)]
    return [*chosen, "--kernel", "numpy", "--preset", "paper"]


def test_rows_go_to_a_pipe_as_json_and_progress_to_standard_error(drawn: DemoArchive, tmp_path: Path) -> None:
    done = gesture("classify", drawn.video_keypoints, *options(drawn, tmp_path / "run"), "--neighbors", "1")
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(rows) == 12
    assert isinstance(rows[0]["neighbors"], list)
    events = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("{")]
    planned = {"event": "planned", "inputs": 12, "waiting": 12, "examples": 6, "kernel": "numpy"}
    sources, examples = [str(drawn.video_keypoints)], [str(drawn.example_keypoints)]
    assert events[0] == {**planned, "sources": sources, "example_sources": examples}
    assert events[-1]["event"] == "done" and len(events) == len(done.stderr.splitlines())
    assert events[-1]["database"].endswith("run.db") and events[-1]["rows"] == 12
    assert events[-1]["worked_on"] == 12 and events[-1]["exit_code"] == done.returncode
    again = gesture("classify", drawn.video_keypoints, *options(drawn, tmp_path / "run"), "--neighbors", "1")
    assert json.loads(again.stderr.splitlines()[-1])["worked_on"] == 0
    assert again.stdout == done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_terminal_gets_a_table(drawn: DemoArchive, run: Path) -> None:
    import pty

    main, terminal = pty.openpty()
    command = [
        sys.executable,
        "-m",
        "gesture_core",
        "classify",
        str(drawn.video_keypoints),
        *options(drawn, run),
    ]
    process = subprocess.Popen(command, stdout=terminal, stderr=terminal, env=os.environ | {"COLUMNS": "100"})
    os.close(terminal)
    text = b""
    while True:
        try:
            piece = os.read(main, 4096)
        except OSError:
            break
        if not piece:
            break
        text += piece
    process.wait()
    os.close(main)
    shown = text.decode()
    assert "nearest example" in shown and "clip_01" in shown and "nothing to do" in shown
    assert f"sources: {drawn.video_keypoints}" in shown.replace("\r\n", "")
    assert "{" not in shown


def test_exports_agree(run: Path, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    for format in ("csv", "jsonl", "parquet"):
        done = gesture("export", run, "--format", format)
        assert done.stdout.strip() == str(run / f"results.{format}"), done.stderr
    lines = [json.loads(line) for line in (run / "results.jsonl").read_text("utf-8").splitlines()]
    with (run / "results.csv").open(newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    columns = pq.read_table(run / "results.parquet").to_pylist()
    for a, b, c in zip(lines, table, columns, strict=True):
        assert a["input"] == b["input"] == c["input"]
        assert (a["label"] or "") == b["label"] == (c["label"] or "")
        assert a["distance"] == c["distance"]
        assert a["neighbors"] == json.loads(b["neighbors"])
    piped = gesture("export", run, "--format", "csv", "--to", "-")
    assert list(csv.DictReader(io.StringIO(piped.stdout))) == table
    assert gesture("export", run, "--format", "jsonl", "--to", tmp_path / "x.jsonl").returncode == 0
    assert (tmp_path / "x.jsonl").read_bytes() == (run / "results.jsonl").read_bytes()
    assert gesture("export", run, "--to", tmp_path / "y.JSONL").returncode == 0
    assert (tmp_path / "y.JSONL").read_bytes() == (run / "results.jsonl").read_bytes()


def test_cells_that_a_spreadsheet_would_run_are_neutralised(tmp_path: Path) -> None:
    from gesture_core.run.export import CsvWriter
    from gesture_core.types import COLUMNS, Row

    names = ["=1+1", "+x", "-x", "@x", "plain", "\tx", "-1+2", "-0.45 1e-05 -3 4"]
    records = (Row("").as_record() | {"input": name} for name in names)
    CsvWriter().write(records, COLUMNS, tmp_path / "x.csv")
    with (tmp_path / "x.csv").open(newline="", encoding="utf-8") as file:
        cells = [row["input"] for row in csv.DictReader(file)]
    assert cells == ["'=1+1", "'+x", "'-x", "'@x", "plain", "'\tx", "'-1+2", "-0.45 1e-05 -3 4"]


CLASSIFY = ["classify", "{videos}", "--examples", "{examples}", "--out", "{out}"]


@pytest.mark.parametrize(
    ("arguments", "code", "hint"),
    [
        (["classify"], 2, "SOURCES is missing; try: gesture classify --help"),
        ([*CLASSIFY, "--labels"], 2, "--labels needs a value"),
        (["classify", "", "--examples", "{examples}", "--out", "{out}"], 2, "an argument is empty; try:"),
        (["classify", "{videos}", "--examples", "", "--out", "{out}"], 2, "--examples is empty; try:"),
        (["classify", "{videos}", "--examples", "{examples}", "--out="], 2, "--out is empty; try: a value"),
        (["report", "{examples}"], 2, "holds no run"),
        (["nonsense"], 2, "try: gesture --help"),
        (["extrct"], 2, 'try: "extract", or gesture --help'),
        (["models", "lst"], 2, "lst is not understood here; try: gesture models --help"),
        (["evaluate", "{examples}", "--oot", "x"], 2, "try: --out, or gesture evaluate --help"),
        (["evaluate", "{examples}", "--out", "{file}"], 2, "is a file; try: a folder"),
        (["bench", "--out", "{examples}"], 2, "is a folder"),
        (["bench", "--series", "0"], 2, "--series"),
        (["bench", "--series", "2.5"], 2, "no whole number"),
        (["demo", "--out", "{file}"], 2, "is a file; try: a folder"),
        (["render", "{film}", "--out", "{file}/x.png"], 2, "cannot be written"),
        (["render", "{film}", "--out", "x.gif"], 2, ".mp4 or .png"),
        ([*CLASSIFY, "--workers", "-1"], 2, "--workers"),
        ([*CLASSIFY, "--workers", "0.5"], 2, "--workers: '0.5' is no whole number"),
        ([*CLASSIFY, "--neighbors", "1.9"], 2, "--neighbors: '1.9' is no whole number"),
        (["explain", "{run}", "x", "--person", "0.5"], 2, "no whole number"),
        (["explain", "{run}", "x", "--channels", "1.5"], 2, "no whole number"),
        (["extract", "nowhere://x/a.mp4", "--out", "{out}"], 1, "nothing reads nowhere://"),
        (["extract", "{videos}/*.avi", "--out", "{out}"], 2, "nothing matches"),
        ([*CLASSIFY, "--reject", "3sd"], 2, "no class has two examples"),
        (["classify", "absent", "--examples", "absent", "--out", "{out}"], 2, "no such file"),
        (["export", "absent"], 2, "holds no run"),
        (["export", "{run}", "--to", "x.xlsx"], 2, "--format with one of coco, csv"),
        (["export", "{run}", "--to", "x.vtt"], 2, "--format vtt --to FOLDER"),
        (["export", "{run}", "--format", "xlsx"], 2, "parquet, eaf, vtt, srt, audacity, activitynet"),
        (["export", "{run}", "--format", "str"], 2, "did you mean srt?"),
        (["export", "{run}", "--to", "{examples}"], 2, "is a folder"),
        (["export", "{file}"], 2, "holds no run"),
        (["plugins", "gausian"], 2, "gaussian"),
        ([*CLASSIFY, "--kernel", "fast"], 2, "numpy"),
        ([*CLASSIFY, "--set", "windw=1"], 2, "window"),
        ([*CLASSIFY, "--preset", "no"], 2, "paper"),
        ([*CLASSIFY, "--reject", "x"], 2, "3sd"),
        ([*CLASSIFY, "--set", "gausian.sigma=1"], 2, "gauss"),
        ([*CLASSIFY, "--set", "gaussian.sgima=1"], 2, "has no option 'sgima'; try: did you mean sigma?"),
        ([*CLASSIFY, "--set", "variance.t_var=0.2"], 2, "takes no part under preset modern"),
        ([*CLASSIFY, "--set", "parts.window=-1"], 2, "filter 'parts' refuses its options: window -1"),
        ([*CLASSIFY, "--neighbors", "99"], 2, "99"),
        (["extract", "{clips}", "--out", "{out}", "--set", "onnx.threads=x"], 2,
         "E_OPTION pose backend 'onnx' refuses"),
        ([*CLASSIFY, "--set", "clasify.margin=1"], 2, "did you mean classify.margin?"),
        ([*CLASSIFY, "--margin", "1"], 2, "try: --set classify.margin=VALUE"),
        (["spot", *CLASSIFY[1:], "--reject", "1"], 2, "try: --set spot.tolerance=VALUE or"),
        (["watch", "0", "--examples", "{examples}", "--min-score", "0.5"], 2, "--set spot.tolerance=VALUE"),
        (["find", "{film}", "{film}", "--margin", "1"], 2, "gesture find --help"),
        (["extract", "{clips}", "--out", "{out}", "--model", "compcat"], 2, "did you mean 'compact'? one of"),
        (["extract", "{clips}", "--out", "{out}", "--model", "no/such.onnx"], 2, "gesture models"),
        (["models", "add", "no/such.onnx"], 2, "no such file"),
        (["extract", "{videos}", "--out", "{out}", "--kernel", "numpy"], 2, "gesture extract --help"),
        (["render", "{videos}", "--reject", "1"], 2, "gesture render --help"),
        (["evaluate", "{clips}", "--grid", "t_var=0.1,0.2"], 2, "try: --preset paper"),
        (["evaluate", "{clips}", "--grid", "variance.t_var=0.1,0.2"], 2, "takes no part under preset modern"),
        (["bench", "--neighbors", "1"], 2, "try: gesture bench --help"),
    ],
)  # fmt: skip
def test_mistakes_exit_with_two_and_say_what_would_be_right(
    drawn: DemoArchive,
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    code: int,
    hint: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    places = {"videos": drawn.video_keypoints, "examples": drawn.example_keypoints, "out": tmp_path / "run"}
    places |= {"run": run, "clips": drawn.videos, "film": drawn.videos / "clip_01.mp4", "file": drawn.truth}
    assert main.run([argument.format(**places) for argument in arguments]) == code
    said = capsys.readouterr()
    assert hint in said.err and not said.out
    assert list(tmp_path.iterdir()) == [], "a mistake leaves nothing behind"
    assert not (drawn.example_keypoints / "report").exists()


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
@pytest.mark.parametrize("words", ["export {run} --format jsonl --to -", "plugins", "--help"])
def test_a_closed_pipe_ends_quietly(run: Path, words: str) -> None:
    command = [sys.executable, "-m", "gesture_core", *words.format(run=run).split()]
    reader, pipe = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, text=True)
    finally:
        os.close(pipe)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.skipif(os.name != "posix", reason="descriptors of POSIX")
def test_a_closed_output_is_no_error() -> None:
    for closed in (1, 2):
        command = [
            "sh",
            "-c",
            f'exec "$0" -m gesture_core settings classify.mirror {closed}>&-',
            sys.executable,
        ]
        done = subprocess.run(command, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "") and bool(done.stdout) == (closed == 2)


def test_a_plugin_shows_its_options_as_they_would_be_set(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("gaussian", "arrays", "csv", "processes"):
        assert main.run(["plugins", name]) == 0
    shown = capsys.readouterr().out
    assert "<factory>" not in shown
    assert main.run(["plugins", "parts"]) == 0
    shown = capsys.readouterr().out
    assert (
        '{"wrist" = 1.0, "elbow" = 1.0}' in shown and "preset modern" in shown and "forearm.turning" in shown
    )
    assert main.run(["plugins", "onnx"]) == 0
    assert "batch_size : int" in capsys.readouterr().out, "options of the base are explained too"


def test_what_the_system_refuses_is_said_of_the_file_that_was_wanted(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), f"x/.{'0' * 16}.tmp-y.csv")

    monkeypatch.setattr(os, "fsync", full)
    assert main.run(["export", str(run), "--to", str(tmp_path / "y.csv")]) == 1
    assert capsys.readouterr().err.startswith(f"E_OS x/y.csv: {os.strerror(errno.ENOSPC)}; kept")


def test_no_help_shows_a_default_that_is_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    for command in [*([name] for name in main._COMMANDS), ["models", "add"], ["models", "verify"]]:
        assert main.run([*command, "--help"]) == 0
        shown = capsys.readouterr().out
        assert not any(f"[default: {nothing}]" in shown for nothing in ('""', "False", "()", "None"))


def test_help_says_what_happens_without_a_flag(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["classify", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "[default: modern]" in shown and shown.count("[default: the preset's]") == 5
    assert main.run(["render", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "who is lost for a while comes back as another person" in shown


def test_render_shows_the_frames_that_are_looked_at_and_no_others(
    drawn: DemoArchive, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film, out = drawn.videos / "clip_01.mp4", tmp_path / "seen.png"
    counts = []
    for rate, said in (("none", ""), ("5", ", looked at 5 times a second (pose.rate)")):
        assert (
            main.run(["render", str(film), "--out", str(out), "--overwrite", "--set", f"pose.rate={rate}"])
            == 0
        )
        shown = capsys.readouterr().out
        count = shown.split(": ")[1].split(" ")[0]
        assert shown.endswith(f"{count} frames, 1 person in {count} of them{said}\n")
        counts.append(int(count))
    assert counts[1] < 0.6 * counts[0]


def test_every_command_exists() -> None:
    for name in ("bench", "classify", "demo", "evaluate", "explain", "export", "extract", "models", "render"):
        assert main.app[name].help


def test_the_environment_and_presets_reach_the_run(drawn: DemoArchive, tmp_path: Path) -> None:
    done = gesture(
        "classify", drawn.video_keypoints / "clip_01", *options(drawn, tmp_path / "run"),
        GESTURE_SET_CLASSIFY__NEIGHBORS="3",
    )  # fmt: skip
    assert len(json.loads(done.stdout.splitlines()[0])["neighbors"]) == 3


def test_extracted_keypoints_can_be_classified(drawn: DemoArchive, tmp_path: Path) -> None:
    done = gesture("extract", drawn.video_keypoints, "--out", tmp_path / "q", "--quiet")
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "q" / "keypoints").rglob("*.parquet"))) == 12
    gesture("extract", drawn.example_keypoints, "--out", tmp_path / "e", "--quiet")
    assert (tmp_path / "e" / "keypoints" / "wave" / "1.parquet").is_file()
    from_files = gesture(
        "classify", tmp_path / "q" / "keypoints", "--examples", tmp_path / "e" / "keypoints",
        "--out", tmp_path / "run", "--kernel", "numpy", "--preset", "paper",
    )  # fmt: skip
    direct = gesture("classify", drawn.video_keypoints, *options(drawn, tmp_path / "direct"))
    labels = [[json.loads(line)["label"] for line in d.stdout.splitlines()] for d in (from_files, direct)]
    assert labels[0] == labels[1] and len(labels[0]) == 12


def test_a_table_that_contradicts_itself_is_a_mistake_on_the_command_line(
    drawn: DemoArchive, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "labels.csv").write_text("path,label\nclip,a\nclip,b\n")
    arguments = ["classify", str(drawn.video_keypoints), *options(drawn, tmp_path / "run")]
    assert main.run([*arguments, "--labels", str(tmp_path / "labels.csv")]) == 2
    assert "clip: is listed as a and as b; try: one line for it in" in capsys.readouterr().err
