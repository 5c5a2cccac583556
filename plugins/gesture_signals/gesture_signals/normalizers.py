"""Keypoints in the body's own frame of reference: neck at the origin, scaled by shoulders or torso."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from gesture_core.errors import PoseError
from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence

RUNNING = 1.0
"""Seconds of the running scale in long recordings, unless another one is set."""

# Below this share of the picture (or of the pose's own extent) a distance is noise of the network.
_TINY = 1e-3


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
        right, left = _joint(pose, "right_shoulder"), _joint(pose, "left_shoulder")
        width = np.linalg.norm(right - left, axis=1)
        scale = _trusted(pose, width, self.floor, "distance between the shoulders")
        points: np.ndarray = _relative_to_neck(pose) / scale[:, None, None]
        return points


@dataclass(frozen=True)
class Torso:
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

    window: float = 0.25
    floor: float = 0.2
    shoulders: float = 1.45

    def __post_init__(self) -> None:
        if not (self.window >= 0 and self.shoulders >= 0) or not 0 <= self.floor < 1:
            raise ValueError(
                f"window {self.window} and shoulders {self.shoulders} must not be negative, "
                f"floor {self.floor} must be in 0..1"
            )

    def scaled(self, pose: PoseSequence) -> np.ndarray:
        """(T, J, 2 or 3) float64 in torso lengths; NaN where a joint or the neck is missing."""
        length = np.linalg.norm(_joint(pose, "neck") - _mid_hip(pose), axis=1)
        what = "distance from neck to hips"
        if self.shoulders and not np.isfinite(length).any():
            across = _joint(pose, "right_shoulder") - _joint(pose, "left_shoulder")
            length = self.shoulders * np.linalg.norm(across, axis=1)
            what = "distance between the shoulders"
        length = _trusted(pose, length, self.floor, what)
        scale = median_over_time(length, pose.times, self.window)[:, None, None]
        points: np.ndarray = _relative_to_neck(pose) / scale
        return points


@dataclass(frozen=True)
class TorsoNormalizer(Torso):
    """Neck at the origin; scale from the running median of the distance from neck to mid-hip."""

    window: float = 0.0
    shoulders: float = 0.0

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 18, 2) float64 in torso lengths; NaN where a joint or the neck is missing."""
        return self.scaled(pose)

    def on_stream(self) -> TorsoNormalizer:
        """The same with a running scale."""
        return replace(self, window=self.window or RUNNING)


@dataclass(frozen=True)
class UprightNormalizer(Torso):
    """`TorsoNormalizer` after turning the picture so that the torso stands upright.

    One angle serves the whole sequence, the direction of the summed vectors from mid-hip to neck, so
    that a bow or a lunge is still seen as one. What is lost is the difference between a person who
    stands and one who lies. Without hips the shoulders' line is made level instead.
    """

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 18, 2) float64 in torso lengths, upright; NaN where a joint or the neck is missing."""
        scaled = self.scaled(pose)
        up = _sum(_joint(pose, "neck") - _mid_hip(pose))
        if not up.any():
            across = _sum(_joint(pose, "left_shoulder") - _joint(pose, "right_shoulder"))
            up = np.array([across[1], -across[0]])
        length = float(np.linalg.norm(up))
        if length == 0:
            raise PoseError(
                "neither torso nor shoulders show which way is up",
                subject=pose.source,
                remedy="--set signals.normalizer=torso",
                code="E_POSE_SCALE",
            )
        right, down = (-up[1] / length, up[0] / length), (-up[0] / length, -up[1] / length)
        scaled[..., :2] = scaled[..., :2] @ np.array([right, down]).T
        return scaled


@dataclass(frozen=True)
class ViewNormalizer(Torso):
    """`TorsoNormalizer` in the torso's own axes, so that a turn of the body does not matter.

    x points to the body's left, y down the back, z to the back. One frame of reference serves the whole
    sequence: y from the summed vectors from neck to mid-hip, x from those across shoulders and hips, at a
    right angle. What is lost is which way a person faces, and whether they stand or lie. Only for keypoints
    in three dimensions.

    Parameters
    ----------
    upright : bool
        Turn around the vertical axis of the picture alone, so that a bow in all frames stays one.
    """

    upright: bool = False
    needs_depth: ClassVar[bool] = True

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 18, 3) float64 in torso lengths; NaN where a joint or the neck is missing."""
        if pose.keypoints.shape[2] != 3:
            raise PoseError(
                "has no depth, and a turn of the body cannot be undone without",
                subject=pose.source,
                remedy="files of keypoints in three dimensions, or videos and the network blazepose, with "
                "--set keypoints.depth=true; or --set signals.normalizer=torso",
                code="E_POSE_SCALE",
            )
        scaled = self.scaled(pose)
        down = np.array([0.0, 1.0, 0.0]) if self.upright else _sum(_mid_hip(pose) - _joint(pose, "neck"))
        pairs = [("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")]
        left = np.sum([_sum(_joint(pose, one) - _joint(pose, other)) for one, other in pairs], axis=0)
        down = down / max(float(np.linalg.norm(down)), 1e-12)
        left = left - (left @ down) * down
        length = float(np.linalg.norm(left))
        if length == 0 or not down.any():
            raise PoseError(
                "neither shoulders nor hips show which way it faces",
                subject=pose.source,
                remedy="--set signals.normalizer=torso",
                code="E_POSE_SCALE",
            )
        left = left / length
        turned: np.ndarray = scaled @ np.array([left, down, np.cross(left, down)]).T
        return turned


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


def _sum(vectors: np.ndarray) -> np.ndarray:
    """(2 or 3,) sum of the (T, 2 or 3) ``vectors`` that are known."""
    total: np.ndarray = np.nansum(vectors, axis=0)
    return total


def _joint(pose: PoseSequence, name: str) -> np.ndarray:
    """(T, 2 or 3) float64 track of a COCO-18 joint, NaN where missing."""
    return pose.keypoints[:, COCO18.index(name)].astype(np.float64)


def _relative_to_neck(pose: PoseSequence) -> np.ndarray:
    """(T, 18, 2 or 3) float64 coordinates with each frame's neck at the origin.

    Raises
    ------
    PoseError
        E_POSE_SCALE where no frame has a neck.
    """
    points = pose.keypoints.astype(np.float64)
    neck = points[:, [COCO18.index("neck")]]
    if np.isnan(neck).all():
        raise PoseError(
            "the neck is missing, or seen too seldom, so that the body has no origin",
            subject=pose.source,
            remedy="another --set signals.normalizer=…, or a clip in which the neck is seen",
            code="E_POSE_SCALE",
        )
    relative: np.ndarray = points - neck
    return relative


def _mid_hip(pose: PoseSequence) -> np.ndarray:
    """(T, 2) midpoint of the hips; the one that is seen where the other is missing."""
    both = np.stack([_joint(pose, "right_hip"), _joint(pose, "left_hip")])
    count = (~np.isnan(both)).sum(axis=0)
    total = np.nansum(both, axis=0)
    middle: np.ndarray = np.full_like(total, np.nan)
    np.divide(total, count, out=middle, where=count > 0)
    return middle


def _trusted(pose: PoseSequence, lengths: np.ndarray, floor: float, what: str) -> np.ndarray:
    """``lengths`` with NaN for frames that must not become a scale.

    Parameters
    ----------
    pose : PoseSequence
        Whose distances they are; a median below a thousandth of its extent is degenerate.
    lengths : (T,) float array
        Distance of two joints in each frame, NaN where one is missing.
    floor : float
        Share of the median below which a distance is not trusted.
    what : str
        What the distance is, for the error.

    Raises
    ------
    PoseError
        E_POSE_SCALE where no frame has a distance above zero.
    """
    points = pose.keypoints[pose.seen]
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    usable = lengths[np.isfinite(lengths) & (lengths > _TINY * extent)]
    if len(usable) == 0:
        raise PoseError(
            f"the {what} is missing, seen too seldom, or zero, so that the body has no scale",
            subject=pose.source,
            remedy="another --set signals.normalizer=…, or a clip in which these joints are seen",
            code="E_POSE_SCALE",
        )
    middle = float(np.median(usable))
    good = np.isfinite(lengths) & (lengths > max(floor * middle, _TINY * extent))
    return np.where(good, lengths, np.nan)
