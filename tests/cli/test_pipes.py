"""What commands say through a pipe: JSON for programs, and nothing lost where nobody reads it."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from test_evaluate_explain import archive

from gesture_core.cli.main import run

pytestmark = pytest.mark.usefixtures("in_this_process")

__all__ = ["archive"]


def test_a_pipe_gets_json(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from gesture_core.spot.evaluation import score_events

    def lines(*words: str) -> list[dict[str, Any]]:
        assert run(list(words)) == 0
        return [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    grid = ["--subjects", "_([A-Z])", "--grid", "t_var=0.01,0.05", "--out", str(tmp_path)]
    *others, best = lines("evaluate", str(archive), "--preset", "paper", *grid)
    assert best == json.loads((tmp_path / "evaluation.json").read_text())
    assert [line["changes"] for line in (best, others[0])] == [{"t_var": "0.01"}, {"t_var": "0.05"}]
    assert len(others) == 2 and set(others[1]["choices"]) == {*"ABC"}
    out = str(tmp_path / "run")
    lines("classify", str(archive), "--examples", str(archive), "--out", out, "--kernel", "numpy")
    (why,) = lines("explain", out, "up_A.npy")
    assert (
        (why["label"], why["nearest"]["label"]) == ("up", "up") != (why["label"], why["runner_up"]["label"])
    )
    for side in (why["nearest"], why["runner_up"]):
        assert sum(side["costs"].values()) == pytest.approx(side["distance"], rel=1e-3, abs=1e-6)
    assert sum(one["added"] for one in why["examples"]) == pytest.approx(why["members"]["weighed"], rel=1e-3)
    (timed,) = lines("bench", "--kernel", "numpy", "--series", "2")
    assert [one["kernel"] for one in timed["kernels"]] == ["numpy"]
    monkeypatch.setattr("gesture_core.run.annotations.evaluate_events", lambda *_: score_events([], [], 60.0))
    (tree,) = lines("evaluate", str(tmp_path), "--events", str(tmp_path))
    assert (tree["reported"], tree["annotated"], tree["minutes"]) == (0, 0, 1.0)


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
def test_what_is_written_is_there_though_nobody_reads_what_is_said(archive: Path, tmp_path: Path) -> None:
    plain = "--preset paper --kernel numpy --set t_var=0.02"
    commands = {
        "evaluate {archive} --protocol leave-one-out --out {out}/scores " + plain:
            "scores/answers.csv scores/confusion.png scores/evaluation.json scores/rejection.png",
        "classify {archive} --examples {archive} --out {out}/run --engine inline " + plain:
            "run/run.db run/run.fitted",
        "explain {out}/run up_C.npy --out {out}/why.png": "why.png",
        "export {out}/run --to {out}/rows.csv": "rows.csv",
        "extract {archive} --out {out}/poses --engine inline --preset paper":
            "poses/keypoints/up/up_C.npy.parquet",
        "bench --kernel numpy --series 2 --out {out}/bench.json": "bench.json",
        "plugins new filter speed --out {out}": "gesture-speed/pyproject.toml",
    }  # fmt: skip
    for command, files in commands.items():
        words = command.format(archive=archive, out=tmp_path).split()
        # Nobody holds the other end when it starts, nor can a process that another thread forks meanwhile.
        reader, pipe = os.pipe()
        os.close(reader)
        try:
            done = subprocess.run([sys.executable, "-m", "gesture_core", *words], stdout=pipe, stderr=pipe)
        finally:
            os.close(pipe)
        assert done.returncode == 141, words
        assert all((tmp_path / name).is_file() for name in files.split()), words
    rows = list(csv.DictReader((tmp_path / "rows.csv").open()))
    assert len(rows) == 9 and {row["status"] for row in rows} == {"ok"}
