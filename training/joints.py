"""COCO-18 as numbers: order, mirror image, and what MoveNet's seventeen joints are in it."""

from __future__ import annotations

import numpy as np

from gesture_core.skeletons import COCO17, COCO18

NAMES = COCO18.joints
COUNT = len(NAMES)
NOSE, NECK = NAMES.index("nose"), NAMES.index("neck")
SHOULDERS = (NAMES.index("right_shoulder"), NAMES.index("left_shoulder"))
ELBOWS = (NAMES.index("right_elbow"), NAMES.index("left_elbow"))
WRISTS = (NAMES.index("right_wrist"), NAMES.index("left_wrist"))
HIPS = (NAMES.index("right_hip"), NAMES.index("left_hip"))
KNEES = (NAMES.index("right_knee"), NAMES.index("left_knee"))
EARS = (NAMES.index("right_ear"), NAMES.index("left_ear"))
FACE = tuple(i for i, n in enumerate(NAMES) if n.endswith(("nose", "eye", "ear")))


MIRROR = np.array(COCO18.mirror)
"""(18,) index of the joint on the other side."""

FROM_COCO17 = np.array([COCO17.joints.index(n) if n in COCO17.joints else -1 for n in NAMES])
"""(18,) index into COCO-17, -1 for the neck."""

PRESENT, ABSENT, IGNORED = 1, 0, -1
"""What is known of a joint: here, not in the picture, or not known."""


def body_scale(points: np.ndarray, seen: np.ndarray) -> float:
    """Shoulder width in pixels, or what it would be where the person stands sideways.

    A side view shortens the shoulders but neither the trunk nor the head; the largest of the three
    estimates is taken, so that "a share of the shoulder width" keeps its meaning.

    Parameters
    ----------
    points : (18, 2) pixels
    seen : (18,) bool

    Returns
    -------
    float
        Zero where none of the three can be measured.
    """
    sizes = [0.0]
    if seen[list(SHOULDERS)].all():
        sizes.append(float(np.linalg.norm(points[SHOULDERS[0]] - points[SHOULDERS[1]])))
    if seen[NECK] and seen[list(HIPS)].any():
        hips = points[[h for h in HIPS if seen[h]]].mean(axis=0)
        sizes.append(0.55 * float(np.linalg.norm(points[NECK] - hips)))
    if seen[list(EARS)].all():
        sizes.append(1.6 * float(np.linalg.norm(points[EARS[0]] - points[EARS[1]])))
    return max(sizes)
