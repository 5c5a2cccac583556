"""Writes the demonstration archive: clips in ``examples/<gesture>/`` and ``videos/``, and keypoints."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gesture_core.demo.drawing import backdrop_of, draw
from gesture_core.demo.figure import GESTURES, Style, joints, random_body
from gesture_core.errors import InputError, MediaError

SIZE = (320, 240)
"""Width and height of a clip, in pixels."""
FPS = 20


@dataclass(frozen=True)
class DemoArchive:
    """Where the parts of the archive are.

    Attributes
    ----------
    videos, examples : Path
        Folders of clips.
    video_keypoints, example_keypoints : Path
        The same with OpenPose JSON instead of clips.
    truth : Path
        CSV file with ``path`` and ``label``.
    """

    videos: Path
    examples: Path
    video_keypoints: Path
    example_keypoints: Path
    truth: Path

    @classmethod
    def at(cls, folder: Path) -> DemoArchive:
        """The archive in ``folder``, whether it has been written or not."""
        return cls(
            folder / "videos",
            folder / "examples",
            folder / "keypoints" / "videos",
            folder / "keypoints" / "examples",
            folder / "truth.csv",
        )


def write_archive(folder: Path, *, queries: int = 4, examples: int = 2, seed: int = 2026) -> DemoArchive:
    """Draw ``queries`` clips and ``examples`` examples of each gesture, every one by another person.

    Parameters
    ----------
    folder : Path
        New, empty, or an earlier demonstration, which is drawn anew.
    queries, examples : int
        Clips of each gesture.
    seed : int
        The same seed draws the same people.

    Returns
    -------
    DemoArchive

    Raises
    ------
    InputError
        Where the folder holds anything but an earlier demonstration.
    MediaError
        Where OpenCV cannot write a video on this machine.
    """
    archive = DemoArchive.at(folder)
    marker = folder / ".gesture-demo"
    if folder.is_dir() and any(folder.iterdir()) and not marker.exists():
        raise InputError(
            "holds something else",
            subject=str(folder),
            remedy="an empty folder for the demonstration",
            code="E_EXISTS",
        )
    folder.mkdir(parents=True, exist_ok=True)
    marker.touch()
    rng = np.random.default_rng(seed)
    truth = []
    for label in GESTURES:
        for number in range(examples):
            _clip(archive.examples / label, archive.example_keypoints / label, f"{number + 1}", label, rng)
    order = rng.permutation([label for label in GESTURES for _ in range(queries)])
    for number, label in enumerate(order):
        name = f"clip_{number + 1:02d}"
        _clip(archive.videos, archive.video_keypoints, name, str(label), rng)
        truth.append((f"videos/{name}.mp4", str(label)))
    with archive.truth.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("path", "label"), *truth])
    return archive


def _clip(folder: Path, keypoints: Path, name: str, label: str, rng: np.random.Generator) -> None:
    import cv2

    body = random_body(rng, SIZE)
    style = Style(
        int(rng.integers(40, 64)), rng.uniform(0.8, 1.15), rng.uniform(0, 0.8), rng.uniform(1.6, 2.3)
    )
    right, left = GESTURES[label](style)
    points = joints(body, right, left, rng)
    backdrop = backdrop_of(body, SIZE, rng)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.mp4"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), FPS, SIZE)
    if not video.isOpened():
        raise MediaError("OpenCV cannot write MPEG-4 on this machine", subject=str(path))
    for frame in points:
        grain = rng.normal(0, 2.5, (SIZE[1], SIZE[0], 1))
        video.write(np.clip(draw(body, frame, backdrop) + grain, 0, 255).astype(np.uint8))
    video.release()
    _write_openpose(keypoints / name, name, points + rng.normal(0, 0.7, points.shape), rng)


def _write_openpose(folder: Path, name: str, points: np.ndarray, rng: np.random.Generator) -> None:
    """OpenPose JSON, version 1.3, COCO-18; one joint in fifty is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, frame in enumerate(points):
        seen = rng.random(len(frame)) > 0.02
        scores = np.where(seen, rng.uniform(0.6, 0.95, len(frame)), 0)
        triplets = np.column_stack([np.where(seen[:, None], frame, 0), scores])
        person = {"person_id": [-1], "pose_keypoints_2d": [round(float(v), 3) for v in triplets.ravel()]}
        path = folder / f"{name}_{number:012d}_keypoints.json"
        path.write_text(json.dumps({"version": 1.3, "people": [person]}), encoding="utf-8")
