"""A real person whose arm is moved: the arm is cut out, turned about shoulder and elbow, and put back.

Pictures of real people show the arms where people like to have them. A student that sees nothing else
reports a hanging hand wherever it is in doubt; here the same sleeve and the same hand turn up anywhere.
"""

from __future__ import annotations

import cv2
import numpy as np

from .cutout import PERSON
from .joints import ELBOWS, HIPS, PRESENT, SHOULDERS, WRISTS, body_scale

HAND = 0.55  # of a forearm that a hand goes beyond the wrist


def _capsule(
    shape: tuple[int, ...], start: np.ndarray, end: np.ndarray, first: float, last: float
) -> np.ndarray:
    """(S, S) uint8, 255 within a limb whose radius goes from ``first`` to ``last``."""
    out = np.zeros(shape[:2], np.uint8)
    for share in np.linspace(0, 1, 12):
        spot = start + share * (end - start)
        radius = max(1, round(first + share * (last - first)))
        cv2.circle(out, (round(float(spot[0])), round(float(spot[1]))), radius, 255, -1)
    return out


def _about(pivot: np.ndarray, angle: float, goal: np.ndarray, along: np.ndarray, shrink: float) -> np.ndarray:
    """(2, 3) matrix: shorten along a direction, turn about ``pivot``, and move that to ``goal``."""
    unit = along / max(float(np.linalg.norm(along)), 1e-6)
    squeeze = np.eye(2) + (shrink - 1) * np.outer(unit, unit)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = turn @ squeeze
    return np.column_stack([linear, goal - linear @ pivot])


def swing(
    rng: np.random.Generator, picture: np.ndarray, mask: np.ndarray, joints: np.ndarray, side: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The person with one arm elsewhere.

    Parameters
    ----------
    picture : (S, S, 3) uint8
    mask : (S, S) uint8 as `cutout.cut_out` gives it
    joints : (18, 3)
    side : int
        0 for the right arm, 1 for the left.

    Returns
    -------
    picture, mask, joints : new arrays; None where the arm is not all known or too short to be turned
    """
    joint = (SHOULDERS[side], ELBOWS[side], WRISTS[side])
    if not (joints[list(joint), 2] == PRESENT).all():
        return None
    seen = joints[:, 2] == PRESENT
    scale = body_scale(joints[:, :2], seen)
    shoulder, elbow, wrist = (joints[j, :2].astype(np.float64) for j in joint)
    upper, lower = elbow - shoulder, wrist - elbow
    if min(np.linalg.norm(upper), np.linalg.norm(lower)) < 0.4 * scale or scale < 15:
        return None
    person = np.where(mask == PERSON, 255, 0).astype(np.uint8)
    tip = wrist + HAND * lower
    thick = 0.19 * scale
    fore = cv2.bitwise_and(_capsule(person.shape, elbow, tip, thick * 0.85, thick * 0.95), person)
    arm = cv2.bitwise_and(_capsule(person.shape, shoulder, elbow, thick, thick * 0.9), person)
    trunk = _trunk(joints, seen, scale, person.shape)
    # what the arm hid: cloth of the trunk beside it, or nothing at all
    gone = cv2.bitwise_or(fore, arm)
    hidden = cv2.bitwise_and(gone, trunk)
    clean = picture
    if hidden.any():
        # what is known of the trunk bleeds into what the arm covered
        around = cv2.dilate(hidden, np.ones((3, 3), np.uint8))
        clean = _fill(picture, around, cv2.bitwise_and(person, cv2.bitwise_not(gone)))
    left = np.where((gone > 0) & (trunk == 0), 0, person).astype(np.uint8)
    new_upper = rng.normal(0, 0.35) if rng.random() < 0.6 else rng.uniform(-1.2, 1.2)
    bend = rng.uniform(-np.pi, np.pi)
    shrinks = rng.uniform(0.75, 1.02), float(np.clip(1.1 - abs(rng.normal(0, 0.35)), 0.35, 1.05))
    first = _about(shoulder, new_upper, shoulder, upper, shrinks[0])
    elbow_now = first[:, :2] @ elbow + first[:, 2]
    second = _about(elbow, bend, elbow_now, lower, shrinks[1])
    size = (person.shape[1], person.shape[0])
    out, cover = clean.copy(), left
    for part, matrix in ((arm, first), (fore, second)):
        moved = cv2.warpAffine(picture, matrix, size, flags=cv2.INTER_LINEAR)
        soft = cv2.warpAffine(part, matrix, size, flags=cv2.INTER_LINEAR)
        share = (soft.astype(np.float32) / 255)[..., None]
        out = (out + (moved.astype(np.float32) - out) * share).astype(np.uint8)
        cover = np.maximum(cover, np.where(soft > 127, 255, 0).astype(np.uint8))
    new = joints.copy()
    new[joint[1], :2] = elbow_now
    new[joint[2], :2] = second[:, :2] @ wrist + second[:, 2]
    fresh = np.where(cover > 0, PERSON, np.where(mask == PERSON, 1, mask)).astype(np.uint8)
    return out, fresh, new


def _fill(picture: np.ndarray, hole: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Blurred neighbours that belong to ``source``, in the hole."""
    weight = (source > 0).astype(np.float32)
    total = cv2.boxFilter(picture.astype(np.float32) * weight[..., None], -1, (41, 41), normalize=False)
    count = cv2.boxFilter(weight, -1, (41, 41), normalize=False)
    good = (hole > 0) & (count > 4)
    out = picture.copy()
    out[good] = (total[good] / count[good][:, None]).astype(np.uint8)
    return out


def _trunk(joints: np.ndarray, seen: np.ndarray, scale: float, shape: tuple[int, ...]) -> np.ndarray:
    """(S, S) uint8: where the trunk must be, also behind an arm; down to the picture's end without hips."""
    points = joints[:, :2]
    out = np.zeros(shape[:2], np.uint8)
    if not seen[list(SHOULDERS)].all():
        return out
    right, left = (points[s] for s in SHOULDERS)
    hips = [points[h] if seen[h] else None for h in HIPS]
    low = [
        hip if hip is not None else shoulder + np.array([0, 2.2 * scale])
        for hip, shoulder in zip(hips, (right, left), strict=True)
    ]
    wide = 0.12 * (low[1] - low[0])
    corners = np.stack([right, left, low[1] + wide, low[0] - wide])
    cv2.fillConvexPoly(out, cv2.convexHull(corners.round().astype(np.int32)), 255)
    return out
