"""A crash, a hang, a hunger for memory, a lying plugin: each costs its own input, never the run."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from distributions import gesture, make_distribution, make_kernel

from gesture_core.demo.archive import DemoArchive

EXPECTED = {
    "raise": "E_PLUGIN_RAISED",
    "exit": "E_PLUGIN_RAISED",
    "os-exit": "E_WORKER_CRASH",
    "kill": "E_WORKER_CRASH",
    "segfault": "E_WORKER_CRASH",
    "hang": "E_WORKER_HANG",
    "hungry": "E_WORKER_MEMORY",
    "huge": "E_WORKER_MEMORY",
    "wrong-type": "E_PLUGIN_RAISED",
    "wrong-item": "E_PLUGIN_RAISED",
    "wrong-shape": "E_KEYPOINTS_SHAPE",
    "nan-times": "E_KEYPOINTS_TIMES",
    "interrupt": "E_WORKER_CRASH",
    "recursion": "E_PLUGIN_RAISED",
    "stdout": "",
    "close": "E_WORKER_CRASH",
}
HEALTHY = 20
COMMON = ("--preset", "paper", "--kernel", "numpy", "--workers", "2")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    source = (ROOT / "tests" / "run" / "trap_plugin.py").read_text("utf-8")
    return make_distribution(tmp_path_factory.mktemp("site"), "trap", source, "6.6")


def rows(text: str) -> dict[str, dict[str, Any]]:
    found = [json.loads(line) for line in text.splitlines()]
    assert len({row["input"] for row in found}) == len(found), "an input has two rows"
    return {Path(row["input"]).name: row for row in found}


def test_every_trap_costs_one_row(drawn: DemoArchive, site: Path, tmp_path: Path) -> None:
    source = tmp_path / "source"
    shutil.copytree(drawn.video_keypoints, source)
    for number in range(HEALTHY - 12):
        shutil.copytree(drawn.video_keypoints / "clip_01", source / f"again_{number}")
        (source / f"again_{number}" / f"clip_01_{number:012d}_keypoints.json").unlink()
    limits = ("--set", "limits.seconds=6", "--set", "limits.memory=700")
    examples = ("--examples", drawn.example_keypoints)
    clean = gesture("classify", source, *examples, "--out", tmp_path / "clean", *COMMON, *limits, path=site)
    for name in EXPECTED:
        (source / f"{name}.trap").write_text(name)
    done = gesture("classify", source, *examples, "--out", tmp_path / "run", *COMMON, *limits, path=site)
    assert done.returncode == 3, done.stderr
    found = rows(done.stdout)
    assert len(found) == HEALTHY + len(EXPECTED)
    for name, code in EXPECTED.items():
        row = found.pop(f"{name}.trap")
        assert row["code"] == code or (name == "stdout" and row["status"] in ("ok", "rejected")), row
        if code:
            assert row["status"] == "error" and row["label"] is None
            assert row["attempts"] == (2 if code.startswith("E_WORKER") else 1), row
        if code == "E_PLUGIN_RAISED":
            assert "trap 6.6" in row["message"]
    assert found == rows(clean.stdout), "a trap changed another input's row"


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("raise RuntimeError('no')", "E_PLUGIN_RAISED"),
        ("sys.exit(4)", "E_PLUGIN_RAISED"),
        ("return np.ones((1, 1, 1))", "E_PLUGIN_CONTRACT"),
        ("return np.full((len(queries), state), np.nan)", "E_PLUGIN_CONTRACT"),
        ("queries.values[...] = 0; return np.ones((len(queries), state))", ""),
    ],
)
def test_a_bad_kernel_gives_rows_that_name_it(
    drawn: DemoArchive, tmp_path: Path, body: str, code: str
) -> None:
    site = make_kernel(tmp_path / "site", body)
    done = gesture(
        "classify", drawn.video_keypoints, "--examples", drawn.example_keypoints, "--out", tmp_path / "run",
        "--preset", "paper", "--kernel", "bad", path=site,
    )  # fmt: skip
    found = rows(done.stdout)
    assert len(found) == 12, done.stderr
    assert "Traceback" not in done.stderr
    for row in found.values():
        assert row["code"] == code or row["status"] == "rejected"
        if code:
            assert row["label"] is None and "bad" in row["message"]
