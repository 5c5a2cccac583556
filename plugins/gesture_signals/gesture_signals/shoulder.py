"""The paper's normalization: neck at the origin, shoulder distance 1, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.signals.body import joint, relative_to_neck, trusted
from gesture_core.types import PoseSequence


@dataclass(frozen=True)
class ShoulderNormalizer:
    """Neck at the origin and shoulder distance 1 in each frame (Schneider et al. 2019).

    Parameters
    ----------
    floor : float
        Frames whose shoulder distance is below this share of the sequence's median (a person
        seen from the side, a confused network) give no coordinates at all; they are gaps.
    """

    floor: float = 0.2

    def __post_init__(self) -> None:
        if not 0 <= self.floor < 1:
            raise ValueError(f"floor {self.floor} is not in 0..1")

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 18, 2) float64 in shoulder distances; NaN where a joint, the neck or a shoulder is missing."""
        right, left = joint(pose, "right_shoulder"), joint(pose, "left_shoulder")
        width = np.linalg.norm(right - left, axis=1)
        scale = trusted(pose, width, self.floor, "distance between the shoulders")
        points: np.ndarray = relative_to_neck(pose) / scale[:, None, None]
        return points
