"""A body whose joints swing, as keypoints."""

from __future__ import annotations

import numpy as np

from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence

_X = {"shoulder": 40, "elbow": 50, "wrist": 50, "hip": 25, "knee": 25, "ankle": 25, "eye": 8, "ear": 16}
_Y = {"nose": -60, "shoulder": 0, "elbow": 60, "wrist": 115, "hip": 110, "knee": 200, "ankle": 290} | {
    "eye": -68, "ear": -64, "neck": 0
}  # fmt: skip


def _place(name: str) -> tuple[float, float]:
    side, _, joint = name.rpartition("_")
    x = _X.get(joint, 0) * {"right": -1, "left": 1, "": 0}[side]
    return float(x), float(_Y[joint])


def swing(
    joint: str = "right_wrist", axis: int = 1, cycles: float = 1.0, frames: int = 40, size: float = 90.0
) -> np.ndarray:
    """(T, 18, 2) coordinates; ``joint`` leaves its place along ``axis`` and comes back."""
    points = np.tile(np.array([_place(name) for name in COCO18.joints]), (frames, 1, 1))
    way = size * np.sin(np.pi * cycles * np.linspace(0, 1, frames)) ** 2
    outwards = -1 if axis == 1 or joint.startswith("right") else 1
    points[:, COCO18.index(joint), axis] += outwards * way
    return points


def pose(points: np.ndarray, source: str = "") -> PoseSequence:
    """Coordinates as a PoseSequence at 25 frames per second."""
    return PoseSequence(points, np.ones(points.shape[:2]), np.arange(len(points)) / 25, source=source)


GESTURES = {"up": ("right_wrist", 1, 1.0), "twice": ("right_wrist", 1, 2.0), "side": ("right_wrist", 0, 1.0)}


def data(per_class: int = 3, seed: int = 0) -> tuple[list, list[str]]:  # type: ignore[type-arg]
    """Noisy gestures of different lengths and sizes."""
    random = np.random.default_rng(seed)
    poses, labels = [], []
    for label, (joint, axis, cycles) in GESTURES.items():
        for _ in range(per_class):
            points = swing(joint, axis, cycles, int(random.integers(25, 50)), random.uniform(95, 130))
            poses.append(pose(points + random.normal(0, 1, points.shape)))
            labels.append(label)
    return poses, labels
