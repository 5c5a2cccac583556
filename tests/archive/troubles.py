"""Small archives with healthy and poisoned inputs for `trouble_plugin`, and what a run makes of them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from conftest import ROOT
from distributions import gesture, make_distribution
from trouble_plugin import length

LIMITS = ("--set", "limits.seconds=5", "--set", "limits.memory=700")
CHAIN = (
    "--set", "normalizer=trouble-normalizer", "--set", "filters=trouble-filter,gaussian,center",
    "--set", "selector=trouble-selector", "--kernel", "trouble-kernel",
)  # fmt: skip
RESULT = (
    "label",
    "distance",
    "margin",
    "status",
    "code",
    "message",
    "frames_with_pose",
    "selected",
    "attempts",
)


def make_site(folder: Path) -> Path:
    """A folder for PYTHONPATH in which the troubling distribution is installed."""
    source = (ROOT / "tests" / "archive" / "trouble_plugin.py").read_text("utf-8")
    return make_distribution(folder, "trouble", source, "6.6")


def write_clip(path: Path, frames: int, joint: int, seed: int = 0) -> None:
    """Keypoints of somebody whose ``joint`` swings, ``frames`` long."""
    rng = np.random.default_rng([seed, frames, joint])
    points = np.tile(_FIGURE * 200 + 50, (frames, 1, 1)) + rng.normal(0, 0.3, (frames, 18, 2))
    t = np.arange(frames)
    points[:, joint] += np.stack([60 * np.sin(t / 6), 40 * np.cos(t / 6)], axis=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, keypoints=points, scores=np.ones((frames, 18)), times=t / 20, skeleton=np.array("coco18"))


_FIGURE = np.array(
    [
        (0.50, 0.10), (0.50, 0.22), (0.38, 0.22), (0.32, 0.36), (0.30, 0.50), (0.62, 0.22),
        (0.68, 0.36), (0.70, 0.50), (0.42, 0.52), (0.42, 0.72), (0.42, 0.92), (0.58, 0.52),
        (0.58, 0.72), (0.58, 0.92), (0.44, 0.02), (0.56, 0.02), (0.38, 0.08), (0.62, 0.08),
    ]
)  # fmt: skip


def write_archive(folder: Path, healthy: int, poisons: Iterable[tuple[str, str]]) -> None:
    """``videos`` with healthy clips and one for each (kind, trouble), and ``examples``."""
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(folder / "examples" / label / "1.npz", 40, joint)
    for number in range(healthy):
        write_clip(
            folder / "videos" / f"healthy_{number:03d}.npz", 25 + number % 60, (4, 7)[number % 2], number
        )
    for kind, trouble in poisons:
        write_clip(folder / "videos" / f"{kind}_{trouble}.npz", length(kind, trouble), 4)


def write_video(path: Path, width: int, frames: int = 6) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20, (width, 64))
    for t in range(frames):
        picture = np.full((64, width, 3), 40, np.uint8)
        picture[:, 10 + 3 * t] = 255
        writer.write(picture)
    writer.release()


def classify(folder: Path, out: Path, site: Path | None, *options: str | Path) -> tuple[int, dict[str, dict]]:
    """Exit code, and the rows by the names of their inputs."""
    done = gesture(
        "classify", folder / "videos", "--examples", folder / "examples", "--out", out,
        "--preset", "paper", *LIMITS, *options, path=site,
    )  # fmt: skip
    assert "Traceback" not in done.stderr, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    rows = {Path(row["input"]).name: row for row in found}
    assert len(rows) == len(found), "an input has two rows"
    return done.returncode, rows


def results(rows: dict[str, dict]) -> dict[str, dict]:
    """The rows without what a plugin's mere presence changes."""
    return {name: {key: row[key] for key in RESULT} for name, row in rows.items()}


def without(folder: Path, target: Path, poisoned: Iterable[str]) -> Path:
    """A copy of an archive without the poisoned inputs."""
    shutil.copytree(folder, target)
    for name in poisoned:
        (target / "videos" / name).unlink()
    return target
