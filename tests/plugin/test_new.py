"""Plugins as ``gesture plugins new`` writes them: built, installed, found, tested and run."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from distributions import gesture

from gesture_core import load_poses
from gesture_core.classify.comparison import parts
from gesture_core.cli.main import run
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import ConfigError
from gesture_core.plugin.hooks import KINDS
from gesture_core.plugin.template import write_plugin
from gesture_core.settings import Settings
from gesture_core.signals.mirror import mirrored
from gesture_core.testing import checks_for
from gesture_core.types import Signals

NAMES = {
    "video": "thinned",
    "pose": "lights",
    "reader": "motion-text",
    "normalizer": "hips",
    "filter": "speed",
    "selector": "lively",
    "kernel": "plain",
    "classifier": "middle",
    "writer": "markdown",
    "engine": "here",
}
"""What a plugin of each kind is called here."""


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The folder of a new plugin of each kind."""
    folder = tmp_path_factory.mktemp("sources")
    return {kind: write_plugin(kind, name, folder)[0] for kind, name in NAMES.items()}


@pytest.fixture(scope="module")
def installed(sources: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which pip has installed them all."""
    target = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--target", target, *sources.values()], check=True, capture_output=True)
    return target


@pytest.fixture(scope="module")
def clips(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with files for the new reader."""
    folder = tmp_path_factory.mktemp("clips")
    for clip in sorted(drawn.video_keypoints.iterdir())[:2]:
        (pose,) = load_poses([clip])
        table = np.column_stack([pose.times, pose.onto("coco18").keypoints.reshape(len(pose), -1)])
        np.savetxt(folder / f"{clip.name}.motion-text", table, header="motion-text 1")
    return folder


def check(command: Sequence[str | Path], cwd: Path, **environment: str) -> str:
    """Run a command that must succeed; what it printed."""
    done = subprocess.run(command, cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_there_is_one_of_each_kind() -> None:
    assert NAMES.keys() == KINDS.keys()


@pytest.mark.timeout(600)
def test_their_tests_pass_as_written(installed: Path, sources: dict[str, Path]) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "--import-mode=importlib", "-p", "no:cacheprovider"]
    said = check([*command, *sources.values()], sources["filter"].parent, PYTHONPATH=os.fspath(installed))
    least = sum(len(checks_for(kind)) + 2 for kind in NAMES)
    assert sum(map(int, re.findall(r"(\d+) passed", said))) >= least and "skipped" not in said


def test_they_are_listed_with_their_origin_and_options(installed: Path) -> None:
    listed = gesture("plugins", "--check", path=installed)
    assert listed.returncode == 0, listed.stdout
    for name in NAMES.values():
        line = next(line for line in listed.stdout.splitlines() if f'"{name}"' in line)
        assert f"gesture-{name} 0.1.0" in line and '"ok"' in line
    shown = gesture("plugins", "hips", path=installed).stdout
    assert "hips.minimum" in shown and "--set signals.normalizer=hips" in shown


@pytest.mark.parametrize("kind", NAMES)
def test_the_commands_of_its_readme_run(
    kind: str, installed: Path, sources: dict[str, Path], drawn: DemoArchive, clips: Path, tmp_path: Path
) -> None:
    text = (sources[kind] / "README.md").read_text("utf-8")
    commands = [line.split("#")[0] for line in text.splitlines() if line.startswith("gesture ")]
    assert len(commands) >= 2
    (tmp_path / "videos").symlink_to(drawn.videos if kind in ("pose", "video") else drawn.video_keypoints)
    (tmp_path / "examples").symlink_to(drawn.example_keypoints)
    (tmp_path / "clips").symlink_to(clips)
    for command in commands:
        done = gesture(*shlex.split(command)[1:], path=installed, cwd=tmp_path)
        assert done.returncode == 0 and "Traceback" not in done.stderr, (command, done.stderr)


def test_they_run_in_the_main_job(installed: Path, drawn: DemoArchive, tmp_path: Path) -> None:
    out = tmp_path / "run"
    chosen = shlex.split(
        "--preset paper --kernel plain --set mode=dependent --set reduce=sum --set normalizer=hips "
        "--set hips.minimum=2 --set filters=gaussian,center,speed --set selector=lively"
    )
    done = gesture(
        "classify", drawn.video_keypoints, "--examples", drawn.example_keypoints, "--out", out, *chosen,
        path=installed,
    )  # fmt: skip
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(rows) == 12, done.stderr
    assert {row["status"] for row in rows} <= {"ok", "rejected"}
    assert any("speed" in channel for row in rows for channel in row["selected"])
    exported = gesture("export", out, "--format", "markdown", path=installed)
    assert exported.returncode == 0, exported.stderr
    assert (out / "results.md").read_text("utf-8").count("\n") == 14


def test_its_filter_adds_channels_that_know_their_side(
    installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(installed))
    speed_filter = import_module("gesture_speed.filter").SpeedFilter
    for name in [name for name in sys.modules if name.partition(".")[0] == "gesture_speed"]:
        del sys.modules[name]  # the tutorial's plugin has this name too
    rng = np.random.default_rng(0)
    names = ("left_wrist_x", "left_wrist_y", "right_wrist_x", "right_wrist_y", "nose_x")
    there = np.array([True, True, True, False, True])
    walk = np.cumsum(rng.normal(size=(20, 5)), axis=0)
    salient = np.array([True, False, False, False, True])
    signals = Signals(walk, np.arange(20) / 20, names, salient, there)
    fast = speed_filter().apply(signals)
    assert fast.channels == (*names, "left_wrist.speed", "right_wrist.speed")
    assert fast.mask is not None and fast.present is not None
    assert fast.mask[5:].tolist() == [True, False] and fast.present[5:].tolist() == [True, False]
    other = mirrored(fast)
    np.testing.assert_array_equal(other.values[:, 6], fast.values[:, 5])
    np.testing.assert_allclose(speed_filter().apply(mirrored(signals)).values, other.values, atol=1e-6)
    assert parts(fast.channels[5:], Settings()) == {"wrist.speed": [0, 1]}


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_what_is_written_is_clean_and_typed(installed: Path, sources: dict[str, Path]) -> None:
    rules = ["--isolated", "--line-length=110", "--select=E,F,W,I,B,UP,SIM,RUF,PTH"]
    for folder in sources.values():
        check([sys.executable, "-m", "ruff", "check", *rules], folder)
        check([sys.executable, "-m", "ruff", "format", "--check", *rules[:2]], folder)
    types: list[str | Path] = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--config-file",
        ROOT / "pyproject.toml",
    ]
    check([*types, *sources.values()], ROOT, MYPYPATH=os.fspath(installed))


@pytest.mark.parametrize(
    ("kind", "name", "message"),
    [
        ("filtr", "speed", "did you mean filter"),
        ("filter", "Speed", "lower-case letters"),
        ("filter", "3d", "a letter first"),
        ("filter", "../speed", "is no name"),
        ("filter", "speed_up", "is no name"),
        ("filter", "gaussian", "filter 'gaussian' of gesture-"),
        ("filter", "core", "package gesture_core is installed already"),
    ],
)
def test_a_name_that_cannot_be_used_is_refused(kind: str, name: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message):
        write_plugin(kind, name, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_the_command_says_what_it_wrote_and_writes_over_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["plugins", "new", "filter", "my-speed", "--out", str(tmp_path / "mine")]
    assert run(command) == 0
    said = capsys.readouterr().out
    files = sorted(p for p in (tmp_path / "mine" / "gesture-my-speed").rglob("*") if p.is_file())
    assert len(files) == 6
    for file in files:
        assert f"  {file.relative_to(tmp_path / 'mine' / 'gesture-my-speed')}\n" in said
    assert f"pip install -e {tmp_path}/mine/gesture-my-speed" in said
    text = files[0].read_text("utf-8")
    assert run(command) == 2
    assert "E_EXISTS" in capsys.readouterr().err
    assert files[0].read_text("utf-8") == text
