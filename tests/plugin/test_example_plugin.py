"""A real third-party distribution: built, installed, found, run."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from distributions import gesture

from gesture_core.demo.archive import DemoArchive


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which pip has installed the example plugin."""
    source = tmp_path_factory.mktemp("source") / "plugin"
    shutil.copytree(ROOT / "tests" / "example_plugin", source)
    target = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--target", str(target), str(source)], check=True, capture_output=True)
    return target


def test_it_is_listed_with_its_origin_and_options(installed: Path) -> None:
    listed = gesture("plugins", "--check", path=installed)
    assert listed.returncode == 0, listed.stdout
    for name in ("hips", "plain", "markdown"):
        line = next(line for line in listed.stdout.splitlines() if f" {name} " in line)
        assert "gesture-example 1.2.3" in line
    assert "hips.minimum" in gesture("plugins", "hips", path=installed).stdout


def test_it_runs_in_the_main_job(installed: Path, drawn: DemoArchive, tmp_path: Path) -> None:
    out = tmp_path / "run"
    chosen = [
        "--set",
        "normalizer=hips",
        "--kernel",
        "plain",
        "--set",
        "mode=dependent",
        "--set",
        "reduce=sum",
    ]
    chosen += ["--set", "hips.minimum=2", "--preset", "paper"]
    done = gesture(
        "classify", drawn.video_keypoints, "--examples", drawn.example_keypoints, "--out", out, *chosen,
        path=installed,
    )  # fmt: skip
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(rows) == 12, done.stderr
    assert {row["status"] for row in rows} <= {"ok", "rejected"}
    exported = gesture("export", out, "--format", "markdown", path=installed)
    assert exported.returncode == 0, exported.stderr
    assert (out / "results.md").read_text("utf-8").count("\n") == 14
