"""A standing body that can move its wrists, as keypoints in pixels."""

from __future__ import annotations

import numpy as np

from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence

STANDING = {
    "nose": (0, -60), "neck": (0, 0),
    "right_shoulder": (-40, 0), "right_elbow": (-50, 60), "right_wrist": (-50, 115),
    "left_shoulder": (40, 0), "left_elbow": (50, 60), "left_wrist": (50, 115),
    "right_hip": (-25, 110), "right_knee": (-25, 200), "right_ankle": (-25, 290),
    "left_hip": (25, 110), "left_knee": (25, 200), "left_ankle": (25, 290),
    "right_eye": (-8, -68), "left_eye": (8, -68), "right_ear": (-16, -64), "left_ear": (16, -64),
}  # fmt: skip
J = {name: index for index, name in enumerate(COCO18.joints)}


def standing(frames: int = 40, fps: float = 25.0) -> np.ndarray:
    """(T, 18, 2) coordinates of a body that stands still."""
    return np.tile(np.array([STANDING[name] for name in COCO18.joints], float), (frames, 1, 1)) + 300.0


def pose(points: np.ndarray, fps: float = 25.0, source: str = "clip") -> PoseSequence:
    """Coordinates as a PoseSequence with full confidence."""
    return PoseSequence(points, np.ones(points.shape[:2]), np.arange(len(points)) / fps, source=source)


def waving(
    joint: str = "right_wrist", cycles: float = 1.0, frames: int = 40, axis: int = 1, size: float = 90.0
) -> np.ndarray:
    """A body whose ``joint`` swings upwards (axis 1) or sideways (axis 0) and back."""
    points = standing(frames)
    points[:, J[joint], axis] -= size * np.sin(np.pi * cycles * np.linspace(0, 1, frames)) ** 2
    return points
