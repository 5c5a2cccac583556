"""Which pixels of a crop show the person: GrabCut (Rother et al. 2004), started from the skeleton."""

from __future__ import annotations

import cv2
import numpy as np

from gesture_core.skeletons import COCO18

from .joints import NECK, NOSE, body_scale

PERSON, SCENE, OUTSIDE = 255, 128, 0
"""Values of a stored mask: the person, the rest of the picture, beyond the picture's border."""

_LIMBS = tuple((COCO18.index(a), COCO18.index(b)) for a, b in COCO18.limbs)


def cut_out(crop: np.ndarray, points: np.ndarray, seen: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Mask of the person in a crop.

    Parameters
    ----------
    crop : (S, S, 3) uint8
    points : (18, 2) pixels of the crop
    seen : (18,) bool
    inside : (S, S) bool, False beyond the border of the picture

    Returns
    -------
    (S, S) uint8 of PERSON, SCENE and OUTSIDE
    """
    half = 0.5
    size = int(crop.shape[0] * half)
    small = cv2.resize(crop, (size, size), interpolation=cv2.INTER_AREA)
    places = points * half
    scale = body_scale(places, seen)
    labels = np.full((size, size), cv2.GC_BGD, np.uint8)
    for value, width in ((cv2.GC_PR_BGD, 0.95), (cv2.GC_PR_FGD, 0.45), (cv2.GC_FGD, 0.12)):
        _draw(labels, places, seen, scale, value, width)
    labels[cv2.resize(inside.astype(np.uint8), (size, size)) == 0] = cv2.GC_BGD
    background, foreground = np.zeros((1, 65)), np.zeros((1, 65))
    if (labels == cv2.GC_FGD).any() and (labels == cv2.GC_BGD).any():
        cv2.setRNGSeed(1)
        cv2.grabCut(small, labels, None, background, foreground, 3, cv2.GC_INIT_WITH_MASK)
    person = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8)
    # hands and hair are what GrabCut loses: a little more is better than a wrist without a hand
    person = cv2.dilate(person, np.ones((3, 3), np.uint8))
    person = cv2.resize(person * 255, crop.shape[1::-1], interpolation=cv2.INTER_LINEAR) > 127
    return np.where(inside, np.where(person, PERSON, SCENE), OUTSIDE).astype(np.uint8)


def _draw(
    labels: np.ndarray, places: np.ndarray, seen: np.ndarray, scale: float, value: int, width: float
) -> None:
    """Limbs, trunk and head in ``value``, ``width`` shoulder widths thick."""
    thick = max(1, int(width * scale))
    spots = [tuple(int(v) for v in np.clip(p, -4000, 4000)) for p in places]
    for a, b in _LIMBS:
        if seen[a] and seen[b]:
            cv2.line(labels, spots[a], spots[b], value, thick)
    trunk = [spots[j] for j in (2, 5, 11, 8) if seen[j]]
    if len(trunk) >= 3:
        hull = cv2.convexHull(np.array(trunk, np.int32))
        cv2.fillConvexPoly(labels, hull, value)
        if width > 0.3:
            cv2.polylines(labels, [hull], True, value, thick)
    for end, start in ((4, 3), (7, 6)):  # a hand continues the forearm
        if seen[end] and seen[start]:
            hand = places[end] + 0.4 * (places[end] - places[start])
            cv2.line(labels, spots[end], tuple(int(v) for v in hand), value, thick)
    if seen[NOSE]:
        radius = 0.75 if value == cv2.GC_PR_BGD else 0.45 if value == cv2.GC_PR_FGD else 0.2
        cv2.circle(labels, spots[NOSE], max(1, int(radius * scale)), value, -1)
    if seen[2] and seen[5] and not seen[[8, 11]].any() and seen[NECK]:  # a portrait: the trunk goes down
        for shoulder in (2, 5):
            down = (spots[shoulder][0], spots[shoulder][1] + int(2 * scale))
            cv2.line(labels, spots[shoulder], down, value, thick)
        middle = (spots[NECK][0], spots[NECK][1] + int(2 * scale))
        cv2.line(labels, spots[NECK], middle, value, int(max(thick, 0.7 * scale)))
