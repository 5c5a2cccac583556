"""Whether what a keypoint reader understood can be a person: one check after reading, for all readers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.signals.repair import placeholders
from gesture_core.skeletons import COCO18, SKELETONS, skeleton
from gesture_core.types import PoseSequence

# 1,150 real sequences of four networks and two depth cameras: arms of 0.6 to 2.3 torsos, a median step of at
# most 0.1 of the body's size from frame to frame, steps over several frames that are 1.4 times as long,
# and a nose below the neck in a quarter of the frames at most.
_LONGEST_ARMS = 3.0
_JUMP, _STEP, _BACK = 0.5, 0.01, 0.35
_NOTED_JUMPS, _REFUSED_JUMPS = (
    0.1,
    0.42,
)  # of OpenPose's folders one has 35 %: two people, one found at a time
_LYING, _HEAD_DOWN = 60.0, 120.0  # degrees from upright
_ALWAYS = 0.95
_FRAMES = 5
_SMALLEST, _PICTURES, _PIXELS = 2.0, 20.0, 1e5
_POINT = 1e-6
_FAR, _NO_ORDER = 6, 1.2
"""Rows, over which a movement leads further than to the next one; shuffled rows do not."""


def check_plausible(pose: PoseSequence, *, axes_stated: bool = False) -> list[str]:
    """Notes on what is odd in a sequence; what can be no person at all is refused.

    Parameters
    ----------
    pose : PoseSequence
        As a reader made it. What it assumed of axes and order (``provenance["assumed"]``) is doubted; what
        the file or the user said of them is believed.
    axes_stated : bool
        The user has said what the axes are. A file that names x and y does not say which way y points.

    Raises
    ------
    KeypointError
        E_KEYPOINTS_IMPLAUSIBLE with the figures, and the option of ``keypoints`` to try.
    """
    # A joint at 0, 0 is none, whatever its score: it is taken out later (`gesture_core.signals.repair`).
    zero = placeholders(pose)
    if zero.any() and not zero[pose.seen].all():
        pose = replace(pose, keypoints=np.where(zero[..., None], np.float32(np.nan), pose.keypoints))
    body = pose.onto("coco18")
    points = body.keypoints.astype(np.float64)
    rows = np.flatnonzero(body.seen.any(axis=1))
    points = points[rows]
    if len(points) < _FRAMES:
        return []
    assumed = {part.partition("=")[0] for part in pose.provenance.get("assumed", "").split(", ")}
    extent = _size(pose, points)
    notes = _one_person(pose, points, rows, extent)
    order = ""
    if "order" in assumed:
        joints = len(skeleton(pose.skeleton).joints)
        alike = [s.name for s in SKELETONS.values() if s.name != pose.skeleton and len(s.joints) == joints]
        order = f"--set keypoints.order={'|'.join([*alike, 'NAME,NAME,…'])}"
    hips = _middle(points[:, COCO18.index("left_hip")], points[:, COCO18.index("right_hip")])
    neck = points[:, COCO18.index("neck")]
    up = neck - hips
    torso = np.isfinite(up).all(axis=1)
    if torso.sum() < _FRAMES:
        return notes
    nose = ((points[:, COCO18.index("nose")] - neck) * up).sum(axis=1)
    nose = nose[np.isfinite(nose)]
    if order and len(nose) >= _FRAMES and (nose < 0).mean() >= _ALWAYS:
        cause = f"the nose is on the hips' side of the neck in {(nose < 0).sum()} of {len(nose)} frames"
        raise _refused(pose, cause, order)
    up = up[torso]
    _arms(pose, points, float(np.percentile(np.linalg.norm(up, axis=1), 90)), order)
    return notes + _upright(pose, up, "axes" in assumed, axes_stated, order)


def _refused(pose: PoseSequence, cause: str, *remedies: str) -> KeypointError:
    return KeypointError(
        f"read as {pose.skeleton}, {cause}",
        subject=pose.source,
        remedy=" or ".join(filter(None, remedies)),
        code="E_KEYPOINTS_IMPLAUSIBLE",
    )


def _size(pose: PoseSequence, points: np.ndarray) -> float:
    """Median over the frames of the larger side of the body; refused where no person can have it."""
    several = points[np.isfinite(points[..., 0]).sum(axis=1) > 1]
    if not len(several):
        return 0.0
    extent = float(np.median((np.nanmax(several, axis=1) - np.nanmin(several, axis=1)).max(axis=1)))
    metres = pose.provenance.get("unit") == "metres"
    away = float(np.median(np.nanmax(np.abs(several), axis=(1, 2))))  # one wrong frame refuses no clip
    if extent <= _POINT * max(1.0, away):
        raise _refused(
            pose, "all joints lie in one place", "another column for x and y, or --set keypoints.order=…"
        )
    if not metres and extent <= _SMALLEST:
        raise _refused(
            pose,
            f"the body is {extent:.2g} pixels large",
            "--set keypoints.unit=shares with --set keypoints.frame_size=WIDTHxHEIGHT",
            "--set keypoints.unit=metres, also for any other unit that is the same in x and y",
        )
    width = max(pose.frame_size) if pose.frame_size else 0
    if "scaled" in pose.provenance:
        width = max(int(word) for word in pose.provenance["scaled"].split() if word.isdigit())
    if not metres and extent > (_PICTURES * width or _PIXELS):
        times = f", {extent / width:.3g} pictures" if width else ""
        raise _refused(pose, f"the body is {extent:.3g} pixels large{times}", "--set keypoints.unit=pixels")
    return extent


def _one_person(pose: PoseSequence, points: np.ndarray, rows: np.ndarray, extent: float) -> list[str]:
    """What is odd where rows seem to belong to several people; refused where they do in turn."""
    if not extent:
        return []

    def moved(rows: int) -> np.ndarray:
        """Movement of the joints between frames that are ``rows`` apart, in sizes of the body."""
        steps = np.linalg.norm(points[rows:] - points[:-rows], axis=2)
        steps = steps[np.isfinite(steps).any(axis=1)]
        return np.asarray(np.nanmedian(steps, axis=1) / extent) if len(steps) else np.zeros(1)

    if "index" in pose.provenance.get("times", "") and (row := _cut(points, rows, extent)):
        raise _refused(
            pose,
            f"all joints of the first {row} rows lie elsewhere than those of the {len(pose) - row} below: "
            "the rows are those of two people or clips",
            "a column that tells people apart (person) or frames (frame), or one file for each",
        )
    steps = moved(1)
    usual, jumps = float(np.median(steps)), float((steps > _JUMP).mean())
    turns = [
        rows for rows in range(2, 7) if len(points) > 2 * rows and np.median(moved(rows)) < _BACK * usual
    ]
    if jumps > _REFUSED_JUMPS or (turns and usual > _STEP):
        fit = f", and by {np.median(moved(turns[0])):.0%} to the row {turns[0]} further on" if turns else ""
        raise _refused(
            pose,
            f"the joints move by {np.percentile(steps, 75):.0%} of the body's size from row to row{fit}: "
            "the rows are those of several people, or not in the order of time",
            "a column that tells people apart (person), or one file for each person",
        )
    notes = [f"the body jumps by half its size in {jumps:.0%} of the steps"] if jumps > _NOTED_JUMPS else []
    doubted = "index" in pose.provenance.get("times", "") and usual > 2 * _STEP and len(points) > 2 * _FAR
    if doubted and max(float(np.median(moved(rows))) for rows in range(2, _FAR + 1)) < _NO_ORDER * usual:
        notes.append("joints are as far from the next row as from others: rows not in the order of time?")
    return notes


def _cut(points: np.ndarray, rows: np.ndarray, extent: float) -> int:
    """The row at which everybody is elsewhere from one to the next, before and after in one place; or 0."""
    middle = np.nanmedian(points, axis=1)
    steps = np.linalg.norm(np.diff(middle, axis=0), axis=1)
    at = int(steps.argmax()) + 1
    sides = middle[:at], middle[at:]
    if (steps > _JUMP * extent).sum() != 1 or min(map(len, sides)) < _FRAMES:
        return 0
    if rows[at] - rows[at - 1] > 1:  # who was not seen meanwhile may have gone there
        return 0
    places = [np.median(side, axis=0) for side in sides]
    still = all(
        np.linalg.norm(side - place, axis=1).max() < _JUMP * extent
        for side, place in zip(sides, places, strict=True)
    )
    return int(rows[at]) if still and np.linalg.norm(places[0] - places[1]) > extent else 0


def _arms(pose: PoseSequence, points: np.ndarray, torso: float, order: str) -> None:
    arms = []
    for side in ("left", "right"):
        track = [points[:, COCO18.index(f"{side}_{joint}")] for joint in ("shoulder", "elbow", "wrist")]
        length = np.linalg.norm(track[1] - track[0], axis=1) + np.linalg.norm(track[2] - track[1], axis=1)
        if np.isfinite(length).any():
            arms.append(float(np.nanmedian(length)))
    if arms and max(arms) > _LONGEST_ARMS * torso:
        ratio = f"{max(arms) / torso:.1f} torsos" if torso else "any length, and the torso has none"
        raise _refused(
            pose,
            f"the arms are {ratio} long",
            order or "another order of the columns",
            "--set keypoints.unit=…",
        )


def _upright(pose: PoseSequence, up: np.ndarray, doubted: bool, stated: bool, order: str) -> list[str]:
    """What is odd in the direction from hips to neck; refused where other axes would set it right."""
    angles = np.degrees(np.arctan2(np.abs(up[:, 0]), -up[:, 1]))
    lying, head_down = angles > _LYING, angles > _HEAD_DOWN
    usual = float(np.median(angles))
    if head_down.mean() >= _ALWAYS:
        cause = f"the body stands on its head in {head_down.sum()} of {len(up)} frames"
        if doubted or not stated:
            believed = "--set keypoints.axes=xy to believe it"
            raise _refused(pose, cause, "--set keypoints.axes=x-y (y points up)", order, believed)
        return [cause]
    if lying.mean() < _ALWAYS:
        return []
    cause = f"the body lies on its side in {lying.sum()} of {len(up)} frames, {usual:.0f}° from upright"
    swapped = np.degrees(np.arctan2(np.abs(up[:, 1]), -up[:, 0]))
    if doubted and float(np.median(swapped)) < _LYING:
        believed = "--set keypoints.axes=xy where people do lie down"
        raise _refused(pose, cause, "--set keypoints.axes=yx (y stands first)", order, believed)
    return [cause]


def _middle(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(T, 2) middle of two joints; the one that is seen where the other is missing."""
    return np.where(np.isnan(one), other, np.where(np.isnan(other), one, (one + other) / 2))
