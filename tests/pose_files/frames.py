"""Writes OpenPose JSON as OpenPose does, for tests that read it back."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np


def frame_name(name: str, number: int) -> str:
    return f"{name}_{number:012d}_keypoints.json"


def frame_text(people: Sequence[np.ndarray], *, key: str = "pose_keypoints_2d", version: float = 1.3) -> str:
    """One frame; each person is a (J, 3) array of x, y, score with zeros where missing."""
    entries = [
        {
            "person_id": [-1],
            key: [round(float(value), 4) for value in person.reshape(-1)],
            "face_keypoints_2d": [],
        }
        for person in people
    ]
    return json.dumps({"version": version, "people": entries})


def write_frame(folder: Path, name: str, number: int, people: Sequence[np.ndarray], **form: object) -> Path:
    path = folder / frame_name(name, number)
    path.write_text(frame_text(people, **form))  # type: ignore[arg-type]
    return path


def person(joints: int, at: tuple[float, float], size: float = 100.0, seed: int = 0) -> np.ndarray:
    """A body of ``joints`` joints within a box of ``size`` pixels whose corner is ``at``."""
    rng = np.random.default_rng(seed)
    body = rng.uniform(0, size, (joints, 2)) + at
    return np.column_stack([body, rng.uniform(0.4, 0.95, joints)])
