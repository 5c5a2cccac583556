"""Places in three dimensions, as a camera in front of the person sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.named import Named, joints_among, people_of

_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}


def seen_from_in_front(
    names: Sequence[str],
    points: np.ndarray,
    times: np.ndarray | None,
    unit: str,
    options: ReadOptions,
    *,
    source: str,
    reader: str,
    announced: float = 0,
    notes: Sequence[str] = (),
) -> PoseSequence:
    """A person by the (T, N, 3) places of N ``names``, in whatever axes, NaN where missing.

    Which way is up is what leads from the hips to the neck. Three dimensions are projected onto the plane
    that the shoulders span on average, so that a gesture looks as to a camera before the person; ``options``
    say whether the third one, away from the camera, is kept.

    Parameters
    ----------
    unit : str
        ``m``, ``cm`` or ``mm``; anything else is none.
    announced : float
        Frames that the file says it has; where it holds fewer, the row is degraded.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_SKELETON` where the names, or shoulders and hips, tell no person or no front.
    """
    named = joints_among(names, options, source)
    points, named = points[:, named.columns], replace(named, columns=list(range(len(named.columns))))
    flat, done = _from_in_front(points, named, source, depth=options.depth)
    (pose,) = people_of(
        named,
        flat[None] * _LENGTHS.get(unit, 1.0),
        None,
        replace(options, axes=None),  # the body itself has shown which way is up
        source=source,
        reader=reader,
        times=times,
        unit="metres" if unit in _LENGTHS else "pixels",
        notes=[*notes, *done],
    )
    if len(points) < announced:
        lost = f"it ends after {len(points)} of {announced:g} frames"
        pose = replace(pose, provenance={**pose.provenance, "lost": lost})
    return pose


def _from_in_front(
    points: np.ndarray, named: Named, source: str, *, depth: bool
) -> tuple[np.ndarray, list[str]]:
    """(T, J, 2), x to the right of who looks and y down, of (T, J, 3) in whatever axes; and what was done.

    With ``depth`` (T, J, 3), z away from who looks, where there is one.
    """
    if not np.isfinite(points).any():
        return points[..., :2], []
    up = _between(points, named, ("mid_hip", "left_hip", "right_hip"), ("neck", "left_shoulder"))
    spread = np.nanmax(points, axis=(0, 1)) - np.nanmin(points, axis=(0, 1))
    if not spread[2] > 0:
        if up is None or up[1] <= 0:
            return points[..., :2], []
        return points[..., :2] * [1, -1], ["y points up and was turned round"]
    across = _between(points, named, ("right_shoulder", "right_hip"), ("left_shoulder", "left_hip"))
    if up is None or across is None:
        raise KeypointError(
            "has three dimensions, and no hips and shoulders that would tell which way it faces",
            subject=source,
            remedy="a file with markers of both shoulders and the hips",
            code="E_KEYPOINTS_SKELETON",
        )
    vertical = int(np.argmax(np.abs(up)))
    across[vertical] = 0
    across = (across / max(float(np.linalg.norm(across)), 1e-9)).astype(points.dtype)
    sides = [points @ across, -np.sign(up[vertical]) * points[..., vertical]]
    if depth:
        down = -np.sign(up[vertical]) * np.eye(3, dtype=points.dtype)[vertical]
        sides.append(points @ np.cross(across, down))
    flat = np.stack(sides, axis=2)
    return flat, ["three dimensions, seen from in front"]


def _between(
    points: np.ndarray, named: Named, one: tuple[str, ...], two: tuple[str, ...]
) -> np.ndarray | None:
    """The median vector from the first joint of ``one`` that is there to the first of ``two``."""
    starts, ends = ([j for j in joints if j in named.body.joints] for joints in (one, two))
    if not starts or not ends:
        return None
    start, end = (named.body.index(joint) for joint in (starts[0], ends[0]))
    steps = points[:, end] - points[:, start]
    steps = steps[np.isfinite(steps).all(axis=1)]
    return np.asarray(np.median(steps, axis=0)) if len(steps) else None
