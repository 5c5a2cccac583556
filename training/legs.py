"""Rendered legs under a real upper body: whole people with real arms, of whom there are few pictures."""

from __future__ import annotations

import cv2
import numpy as np

from .cutout import OUTSIDE, PERSON
from .joints import HIPS, KNEES, NECK, PRESENT, WRISTS

SHRINK = 0.5  # a whole person is about twice as high as one without legs
_LEGS = (*KNEES, 10, 13)


def stand(
    rng: np.random.Generator,
    picture: np.ndarray,
    mask: np.ndarray,
    joints: np.ndarray,
    rendered: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """A real person, cut out, on the legs of a rendered one.

    Parameters
    ----------
    picture, mask, joints : a real person as `store.Store` holds it
    rendered : picture (S, S, 3), opacity (S, S) and joints (18, 3) of a rendered person

    Returns
    -------
    picture, mask, joints : new arrays, the mask PERSON and OUTSIDE alone; None where the two do not fit
    """
    body, opacity, other = rendered
    need = [NECK, *HIPS]
    if not ((joints[need, 2] == PRESENT).all() and (other[[*need, *_LEGS], 2] == PRESENT).all()):
        return None
    hip, its_hip = (j[list(HIPS), :2].mean(axis=0).astype(np.float64) for j in (joints, other))
    torso, its_torso = hip - joints[NECK, :2], its_hip - other[NECK, :2]
    height, its_height = float(np.linalg.norm(torso)), float(np.linalg.norm(its_torso))
    legs = other[[10, 13], 1].mean() - its_hip[1]
    across = [float(j[HIPS[1], 0] - j[HIPS[0], 0]) for j in (joints, other)]
    if min(height, its_height) < 20 or abs(torso[0]) > 0.35 * height or abs(its_torso[0]) > 0.35 * its_height:
        return None
    hands = other[list(WRISTS), 1].max() > its_hip[1] - 0.05 * its_height  # they would hang beside the legs
    inside = (other[list(_LEGS), :2] > 0).all() and (other[list(_LEGS), :2] < len(opacity)).all()
    if hands or not inside or legs < 1.2 * its_height or across[0] * across[1] < 0:
        return None
    size = len(mask)
    goal = np.array([size / 2, size * 0.47])
    scale = SHRINK * height / its_height * rng.uniform(0.9, 1.12)
    upper = np.array([[SHRINK, 0, goal[0] - SHRINK * hip[0]], [0, SHRINK, goal[1] - SHRINK * hip[1]]])
    lower = np.array([[scale, 0, goal[0] - scale * its_hip[0]], [0, scale, goal[1] - scale * its_hip[1]]])
    side = (size, size)
    real = cv2.warpAffine(picture, upper, side, flags=cv2.INTER_AREA)
    person = cv2.warpAffine(np.where(mask == PERSON, 255, 0).astype(np.uint8), upper, side)
    out = cv2.warpAffine(body, lower, side)
    below = cv2.warpAffine(opacity, lower, side)
    waist = int(goal[1] - 0.12 * SHRINK * height)
    below[:waist] = 0
    hem = goal[1] + rng.uniform(0.0, 0.35) * SHRINK * height  # the shirt ends somewhere below the hips
    hanging = person.copy()
    hanging[int(hem) :] = 0
    for side_, wrist in enumerate(WRISTS):  # but a hand that hangs lower stays
        if joints[wrist, 2] == PRESENT:
            hand = upper[:, :2] @ joints[wrist, :2] + upper[:, 2]
            elbow = upper[:, :2] @ joints[(3, 6)[side_], :2] + upper[:, 2]
            spot = np.zeros_like(person)
            tip = hand + 0.5 * (hand - elbow)
            ends = [tuple(int(v) for v in p) for p in (elbow, tip)]
            cv2.line(spot, ends[0], ends[1], 255, max(2, int(0.25 * SHRINK * height)))
            hanging = np.maximum(hanging, cv2.bitwise_and(spot, person))
    out = np.where(hanging[..., None] > 127, real, out)
    cover = np.where((hanging > 127) | (below > 127), PERSON, OUTSIDE).astype(np.uint8)
    new = joints.copy()
    new[:, :2] = joints[:, :2] @ upper[:, :2].T + upper[:, 2]
    new[list(_LEGS), :2] = other[list(_LEGS), :2] @ lower[:, :2].T + lower[:, 2]
    new[list(_LEGS), 2] = PRESENT
    return out, cover, new
