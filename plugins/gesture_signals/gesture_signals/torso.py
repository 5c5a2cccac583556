"""Scale by the torso, which a turn of the body or a shrug changes less than the shoulders."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gesture_core.signals.body import joint, mid_hip, relative_to_neck, trusted
from gesture_core.types import PoseSequence

RUNNING = 1.0
"""Seconds of the running scale in long recordings, unless another one is set."""


@dataclass(frozen=True)
class TorsoNormalizer:
    """Neck at the origin; scale from the running median of the distance from neck to mid-hip.

    Parameters
    ----------
    window : float
        Seconds of the running median; zero takes the median of the whole sequence, which is
        steadier unless the person walks towards the camera.
    floor : float
        Frames below this share of the sequence's median do not take part.
    shoulders : float
        Torso lengths in one shoulder distance, for a person whose hips are not in the picture
        (a camera one metre away); zero makes that an error, E_POSE_SCALE.
    """

    window: float = 0.0
    floor: float = 0.2
    shoulders: float = 0.0

    def __post_init__(self) -> None:
        if not (self.window >= 0 and self.shoulders >= 0) or not 0 <= self.floor < 1:
            raise ValueError(
                f"window {self.window} and shoulders {self.shoulders} must not be negative, "
                f"floor {self.floor} must be in 0..1"
            )

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 18, 2) float64 in torso lengths; NaN where a joint or the neck is missing."""
        length = np.linalg.norm(joint(pose, "neck") - mid_hip(pose), axis=1)
        what = "distance from neck to hips"
        if self.shoulders and not np.isfinite(length).any():
            across = joint(pose, "right_shoulder") - joint(pose, "left_shoulder")
            length = self.shoulders * np.linalg.norm(across, axis=1)
            what = "distance between the shoulders"
        length = trusted(pose, length, self.floor, what)
        scale = median_over_time(length, pose.times, self.window)[:, None, None]
        points: np.ndarray = relative_to_neck(pose) / scale
        return points

    def on_stream(self, mean: float) -> TorsoNormalizer:
        """The same with a running scale; it subtracts no mean."""
        return replace(self, window=self.window or RUNNING)


def median_over_time(values: np.ndarray, times: np.ndarray, window: float) -> np.ndarray:
    """(T,) median of the finite ``values`` within ``window`` seconds around each frame.

    A frame with no finite value near it takes the median of all; at least one must be finite.
    """
    whole = float(np.nanmedian(values))
    if window == 0:
        return np.full(len(values), whole)
    starts = np.searchsorted(times, times - window / 2, side="left")
    stops = np.searchsorted(times, times + window / 2, side="right")
    out = np.full(len(values), whole)
    for frame, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        near = values[start:stop]
        near = near[np.isfinite(near)]
        if len(near):
            out[frame] = np.median(near)
    return out
