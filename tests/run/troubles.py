"""Small archives with healthy and poisoned inputs for `trouble_plugin`, and what a run makes of them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from conftest import ROOT
from distributions import make_distribution
from trouble_plugin import FIGURE, length

LIMITS = ("--set", "limits.seconds=6", "--set", "limits.memory=700")
CHAIN = (
    "--set", "normalizer=trouble-normalizer", "--set", "filters=trouble-filter,gaussian,center",
    "--set", "selector=trouble-selector", "--kernel", "trouble-kernel",
)  # fmt: skip


def make_site(folder: Path) -> Path:
    """A folder for PYTHONPATH in which the troubling distribution is installed."""
    source = (ROOT / "tests" / "run" / "trouble_plugin.py").read_text("utf-8")
    return make_distribution(folder, "trouble", source, "6.6")


def with_site(site: Path) -> dict[str, str]:
    """This process's environment, with what is installed in ``site``."""
    path = os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**os.environ, "PYTHONPATH": path}


def write_clip(path: Path, frames: int, joint: int, seed: int = 0) -> None:
    """Keypoints of somebody whose ``joint`` swings, ``frames`` long."""
    rng = np.random.default_rng([seed, frames, joint])
    points = np.tile(FIGURE * 200 + 50, (frames, 1, 1)) + rng.normal(0, 0.3, (frames, 18, 2))
    t = np.arange(frames)
    points[:, joint] += np.stack([60 * np.sin(t / 6), 40 * np.cos(t / 6)], axis=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, keypoints=points, scores=np.ones((frames, 18)), times=t / 20, skeleton=np.array("coco18"))


def write_archive(folder: Path, healthy: int, poisons: Iterable[tuple[str, str]]) -> None:
    """``videos`` with healthy clips and one for each (kind, trouble), and ``examples``."""
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(folder / "examples" / label / "1.npz", 40, joint)
    for number in range(healthy):
        name, joint = f"healthy_{number:03d}.npz", (4, 7)[number % 2]
        write_clip(folder / "videos" / name, 25 + number % 60, joint, number)
    for kind, trouble in poisons:
        write_clip(folder / "videos" / f"{kind}_{trouble}.npz", length(kind, trouble), 4)


def write_video(path: Path, width: int, frames: int, right: bool = True, seed: int = 0) -> None:
    """A bar that swings, bright for the right wrist and grey for the left one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, frames, right])
    speed, grain = rng.uniform(2, 5), rng.integers(0, 12, (48, width, 3), np.uint8)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20, (width, 48))
    for t in range(frames):
        picture = grain.copy()
        middle = width // 2 + int(0.35 * width * np.sin(t / speed))
        picture[:, middle - 3 : middle + 3] = 255 if right else 120
        writer.write(picture)
    writer.release()


def classify(
    folder: Path, out: Path, site: Path | None, *options: str | Path
) -> tuple[int, dict[str, dict[str, Any]]]:
    """Exit code, and the rows by the names of their inputs."""
    command: list[str | Path] = [
        "classify",
        folder / "videos",
        "--examples",
        folder / "examples",
        "--out",
        out,
    ]
    done = subprocess.run(
        [sys.executable, "-m", "gesture_core", *command, "--preset", "paper", *LIMITS, *options],
        env=with_site(site) if site else None,
        capture_output=True,
        text=True,
        timeout=1800,
    )
    assert "Traceback" not in done.stderr, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    rows = {Path(row["input"]).name: row for row in found}
    assert len(rows) == len(found), "an input has two rows"
    return done.returncode, rows
