"""A real third-party distribution: built, installed, found, run."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from distributions import gesture

from gesture_core.classify.comparison import parts
from gesture_core.demo.archive import DemoArchive
from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals


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
    for name in ("hips", "speed", "plain", "markdown"):
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


def test_its_readme_is_right(installed: Path, drawn: DemoArchive, tmp_path: Path) -> None:
    """Its commands run as they stand, under the default preset too."""
    (tmp_path / "videos").symlink_to(drawn.video_keypoints)
    (tmp_path / "examples").symlink_to(drawn.example_keypoints)
    text = (ROOT / "tests" / "example_plugin" / "README.md").read_text("utf-8")
    commands = [line for line in text.splitlines() if line.startswith("gesture ")]
    assert len(commands) == 4
    for command in commands:
        done = gesture(*shlex.split(command)[1:], path=installed, cwd=tmp_path)
        assert done.returncode == 0, (command, done.stderr)
    assert "speed" in (tmp_path / "run-speed" / "run.db").read_bytes().decode("latin-1")
    assert (tmp_path / "run" / "results.md").is_file()


def test_its_filter_adds_channels_that_know_their_side(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "example_plugin"))
    from gesture_example.speed import SpeedFilter

    rng = np.random.default_rng(0)
    names = ("left_wrist_x", "left_wrist_y", "right_wrist_x", "right_wrist_y", "nose_x")
    there = [True, True, True, False, True]
    walk = np.cumsum(rng.normal(size=(20, 5)), axis=0)
    signals = Signals(walk, np.arange(20) / 20, names, [True, False, False, False, True], there)
    fast = SpeedFilter().apply(signals)
    assert fast.channels == (*names, "left_wrist.speed", "right_wrist.speed")
    assert fast.mask is not None and fast.present is not None
    assert fast.mask[5:].tolist() == [True, False] and fast.present[5:].tolist() == [True, False]
    other = mirrored(fast)
    np.testing.assert_array_equal(other.values[:, 6], fast.values[:, 5])
    np.testing.assert_allclose(SpeedFilter().apply(mirrored(signals)).values, other.values, atol=1e-6)
    assert parts(fast.channels[5:]) == {"wrist.speed": [0, 1]}
