"""Turn the body upright first, so that a camera that hangs askew does not matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.errors import PoseError
from gesture_core.signals.body import joint, mid_hip
from gesture_core.types import PoseSequence
from gesture_signals.torso import TorsoNormalizer


@dataclass(frozen=True)
class UprightNormalizer:
    """`TorsoNormalizer` after turning the picture so that the torso stands upright.

    One angle serves the whole sequence, the direction of the summed vectors from mid-hip to neck, so
    that a bow or a lunge is still seen as one. What is lost is the difference between a person who
    stands and one who lies.

    Parameters
    ----------
    window, floor, shoulders
        Those of `TorsoNormalizer`. Without hips the shoulders' line is made level instead.
    """

    window: float = 0.25
    floor: float = 0.2
    shoulders: float = 1.45

    def __post_init__(self) -> None:
        TorsoNormalizer(self.window, self.floor, self.shoulders)

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 18, 2) float64 in torso lengths, upright; NaN where a joint or the neck is missing."""
        scaled = TorsoNormalizer(self.window, self.floor, self.shoulders).normalize(pose)
        up = _sum(joint(pose, "neck") - mid_hip(pose))
        if not up.any():
            across = _sum(joint(pose, "left_shoulder") - joint(pose, "right_shoulder"))
            up = np.array([across[1], -across[0]])
        length = float(np.linalg.norm(up))
        if length == 0:
            raise PoseError(
                "neither torso nor shoulders show which way is up",
                subject=pose.source,
                remedy="signals.normalizer=torso",
                code="E_POSE_SCALE",
            )
        right, down = (-up[1] / length, up[0] / length), (-up[0] / length, -up[1] / length)
        turned: np.ndarray = scaled @ np.array([right, down]).T
        return turned


def _sum(vectors: np.ndarray) -> np.ndarray:
    """(2,) sum of the (T, 2) ``vectors`` that are known."""
    total: np.ndarray = np.nansum(vectors, axis=0)
    return total
