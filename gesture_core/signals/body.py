"""What normalizers share: joints by name, distances that may serve as a scale."""

from __future__ import annotations

import numpy as np

from gesture_core.errors import PoseError
from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence

# Below this share of the picture (or of the pose's own extent) a distance is noise of the network.
_TINY = 1e-3


def joint(pose: PoseSequence, name: str) -> np.ndarray:
    """(T, 2) float64 track of a COCO-18 joint, NaN where missing."""
    return pose.keypoints[:, COCO18.index(name)].astype(np.float64)


def relative_to_neck(pose: PoseSequence) -> np.ndarray:
    """(T, 18, 2) float64 coordinates with each frame's neck at the origin.

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
            remedy="another normalizer (signals.normalizer), or a clip in which the neck is seen",
            code="E_POSE_SCALE",
        )
    relative: np.ndarray = points - neck
    return relative


def mid_hip(pose: PoseSequence) -> np.ndarray:
    """(T, 2) midpoint of the hips; the one that is seen where the other is missing."""
    both = np.stack([joint(pose, "right_hip"), joint(pose, "left_hip")])
    count = (~np.isnan(both)).sum(axis=0)
    total = np.nansum(both, axis=0)
    middle: np.ndarray = np.full_like(total, np.nan)
    np.divide(total, count, out=middle, where=count > 0)
    return middle


def trusted(pose: PoseSequence, lengths: np.ndarray, floor: float, what: str) -> np.ndarray:
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
            remedy="another normalizer (signals.normalizer), or a clip in which these joints are seen",
            code="E_POSE_SCALE",
        )
    middle = float(np.median(usable))
    good = np.isfinite(lengths) & (lengths > max(floor * middle, _TINY * extent))
    return np.where(good, lengths, np.nan)
