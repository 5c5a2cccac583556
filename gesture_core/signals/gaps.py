"""Gaps: frames in which a joint was not found, and what may honestly stand in for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.errors import PoseError
from gesture_core.types import PoseSequence


@dataclass(frozen=True)
class GapRule:
    """How much may be missing.

    Attributes
    ----------
    max_gap : float
        Seconds; a shorter gap is interpolated linearly over time, a longer one holds the nearest
        seen value (the first half that before the gap, the second half that after it), so that
        no motion is invented.
    min_seen : float
        Share of the frames in which a joint must be seen; otherwise it is not present at all.
    min_frames : int
        Frames with a pose that a sequence needs.
    min_pose : float
        Share of frames with a pose that a sequence needs.
    """

    max_gap: float = 0.5
    min_seen: float = 0.5
    min_frames: int = 5
    min_pose: float = 0.25


def require_pose(pose: PoseSequence, rule: GapRule) -> PoseSequence:
    """``pose`` from its first to its last frame with any joint.

    Frames before and after say nothing about the person, and held values there would only
    lengthen the signal.

    Raises
    ------
    PoseError
        E_POSE_SHORT where there are fewer frames than ``rule`` demands, E_POSE_SPARSE where fewer
        of them hold a pose.
    """
    with_pose = pose.seen.any(axis=1)
    count, frames, least = int(with_pose.sum()), len(pose), max(rule.min_frames, 1)
    if frames < least:
        raise PoseError(
            f"is only {frames} {'frame' if frames == 1 else 'frames'} long, at least {least} are needed",
            subject=pose.source,
            remedy="a longer clip, or a lower --set signals.min_frames=…",
            code="E_POSE_SHORT",
        )
    if count < least or count < rule.min_pose * frames:
        raise PoseError(
            f"a person was found in {count} of {frames} frames, "
            f"at least {least} and {rule.min_pose:.0%} are needed",
            subject=pose.source,
            remedy="another pose network, a lower --set pose.score=…, or a clip in which the person is seen",
            code="E_POSE_SPARSE",
        )
    first, last = np.flatnonzero(with_pose)[[0, -1]]
    if first == 0 and last == frames - 1:
        return pose
    return pose.part(slice(first, last + 1))


def fill_gaps(points: np.ndarray, times: np.ndarray, rule: GapRule) -> tuple[np.ndarray, np.ndarray]:
    """Fill the gaps of every joint that was seen often enough.

    Parameters
    ----------
    points : (T, J, C) float array
        NaN where a joint is missing.
    times : (T,) float64
        Seconds, ascending.
    rule : GapRule

    Returns
    -------
    filled : (T, J, C) float array
        Finite for joints that are present, all NaN for the others: a missing joint never
        becomes a coordinate.
    present : (J,) bool
    """
    seen = ~np.isnan(points).any(axis=2)
    present = (seen.mean(axis=0) >= rule.min_seen) & seen.any(axis=0)
    filled = np.full_like(points, np.nan)
    for joint in np.flatnonzero(present):
        filled[:, joint] = _fill(points[:, joint], seen[:, joint], times, rule.max_gap)
    return filled, present


def _fill(track: np.ndarray, seen: np.ndarray, times: np.ndarray, max_gap: float) -> np.ndarray:
    """One joint's (T, C) track without gaps; ``seen`` is (T,) bool with at least one True."""
    known = np.flatnonzero(seen)
    if len(known) == len(track):
        return track
    missing = np.flatnonzero(~seen)
    after = np.clip(np.searchsorted(known, missing), 0, len(known) - 1)
    before = np.clip(after - (known[after] > missing), 0, len(known) - 1)
    left, right = known[before], known[after]
    span = times[right] - times[left]
    elapsed = times[missing] - times[left]
    # Frames may share a time stamp; such a gap has no duration and takes the value before it.
    share = np.divide(elapsed, span, out=np.zeros_like(span), where=span > 0)
    share = np.where(span > max_gap, np.round(share), np.clip(share, 0, 1))
    out = track.copy()
    out[missing] = track[left] * (1 - share[:, None]) + track[right] * share[:, None]
    return out
