"""Killed at each write, flush, rename and commit, and at random; full disks."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from distributions import gesture

from gesture_core.demo.archive import DemoArchive
from gesture_core.run.results import open_results

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and limits of POSIX")


@pytest.fixture
def small(drawn: DemoArchive, tmp_path: Path) -> tuple[Path, Path]:
    """Three queries and two examples."""
    queries, examples = tmp_path / "queries", tmp_path / "examples"
    for name in ("clip_01", "clip_02", "clip_03"):
        shutil.copytree(drawn.video_keypoints / name, queries / name)
    for label in ("wave", "circle"):
        shutil.copytree(drawn.example_keypoints / label, examples / label)
    return queries, examples


def test_kills_at_each_point_and_at_random_lose_and_double_nothing(
    small: tuple[Path, Path], tmp_path: Path, thorough: bool
) -> None:
    points, kills, step = (28, 12, 1) if thorough else (9, 4, 3)
    script = ROOT / "tests" / "run" / "kill_points.py"
    done = subprocess.run(
        [sys.executable, str(script), *map(str, small), str(tmp_path), str(kills), "1", str(step)],
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    match = re.search(r"(\d+) at points, (\d+) at random", done.stdout)
    assert match and int(match[1]) >= points and int(match[2]) >= kills


def limited(size: int, arguments: list[str]) -> subprocess.CompletedProcess[str]:
    """The command with files limited to ``size`` bytes, as a full disk would."""
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))"
    script = f"{limit}; import sys; from gesture_core.cli import main; main(sys.argv[1:])"
    return subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, timeout=120
    )


@pytest.mark.parametrize("size", [4_000, 16_000, 60_000])
def test_a_full_disk_is_fatal_and_leaves_what_was_committed(
    small: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setenv("GESTURE_CACHE", str(tmp_path / "cache"))
    arguments = ["classify", str(small[0]), "--examples", str(small[1]), "--out", str(tmp_path / "run")]
    arguments += ["--preset", "paper", "--kernel", "numpy"]
    full = limited(size, arguments)
    assert full.returncode == 1, full.stderr
    assert "Traceback" not in full.stderr
    assert re.search(r"E_(STORE_WRITE|RUN_WRITE|RUN_DAMAGED|OS) ", full.stderr)
    again = gesture(*arguments)
    assert again.returncode in (0, 3), again.stderr
    with open_results(tmp_path / "run") as journal:
        assert len(list(journal.rows())) == 3
