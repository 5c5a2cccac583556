"""Arrays whose number of joints two skeletons have: refused where they clearly lie as those of the other."""

from __future__ import annotations

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.skeletons import BODY25, COCO17, H36M17, KINECT25, Skeleton

_RIVALS = {COCO17.name: H36M17, BODY25.name: KINECT25}
_LEVELS = ("shoulder", "hip", "knee", "ankle")
_FRAMES = 64
_FEWEST = 8
_ODD, _CLEARLY = 0.3, 0.2
"""How uneven a body may be, as a logarithm, and by how much more the one that is assumed."""


def check_assumed(points: np.ndarray, assumed: Skeleton, source: str) -> None:
    """Refuse (T, J, 2) points, NaN where missing, that are a body in the rival's order alone.

    One has arms and legs that are even, and shoulders, hips, knees and ankles one below the other, or above.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_SKELETON`.
    """
    rival = _RIVALS.get(assumed.name)
    if rival is None or len(points) < _FEWEST:
        return
    some = points[:: -(-len(points) // _FRAMES)]
    other = _odd(some, rival)
    if other < _ODD and _in_line(some, rival) and other + _CLEARLY < _odd(some, assumed) < np.inf:
        raise KeypointError(
            f"its {len(assumed.joints)} joints lie as those of {rival.name}, not of {assumed.name}",
            subject=source,
            remedy=f"--set keypoints.order={rival.name}, or {assumed.name} where that is wrong",
            code="E_KEYPOINTS_SKELETON",
        )


def _in_line(points: np.ndarray, body: Skeleton) -> bool:
    """Whether shoulders, hips, knees and ankles follow each other from one end to the other."""
    pairs = [[body.index(f"{side}_{joint}") for side in ("left", "right")] for joint in _LEVELS]
    levels = [places[np.isfinite(places)] for places in (points[:, pair, 1] for pair in pairs)]
    ways = np.sign(np.diff([float(seen.mean()) for seen in levels if len(seen)]))
    return len(ways) > 0 and bool((ways == ways[0]).all())


def _odd(points: np.ndarray, body: Skeleton) -> float:
    """How far left limbs are from as long as right ones, upper arms as forearms, and thighs as shins.

    Infinite where no two of them are seen.
    """

    def length(side: str, one: str, two: str) -> float:
        steps = points[:, body.index(f"{side}_{one}")] - points[:, body.index(f"{side}_{two}")]
        seen = np.linalg.norm(steps[np.isfinite(steps).all(axis=1)], axis=1)
        return float(np.log(max(np.percentile(seen, 75), 1e-6))) if len(seen) else np.nan

    upper, lower = (
        np.array([[length(side, *limb) for side in ("left", "right")] for limb in limbs])
        for limbs in ((("shoulder", "elbow"), ("hip", "knee")), (("elbow", "wrist"), ("knee", "ankle")))
    )
    off = np.concatenate([(upper - lower).ravel(), np.diff(upper).ravel(), np.diff(lower).ravel()])
    off = np.minimum(np.abs(off[np.isfinite(off)]), 3.0)
    return float(off.mean()) if len(off) else np.inf
