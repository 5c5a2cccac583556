"""The names of the joints of bodies, hands and faces: sides, groups, and lines between them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import cache


def other_side(name: str) -> str:
    """Name of a joint or channel on the other side of the body; itself on the body's middle line."""
    if name.startswith("left_"):
        return "right_" + name.removeprefix("left_")
    if name.startswith("right_"):
        return "left_" + name.removeprefix("right_")
    return name


GROUPS = ("body", "feet", "left_hand", "right_hand", "face", "spine")
"""What joints belong to."""
PARTS: Mapping[str, tuple[str, ...]] = {
    "body": ("body", "feet", "spine"),
    "hands": ("left_hand", "right_hand"),
    "face": ("face",),
}
"""The groups of what can be asked for by name."""
FINGERS = ("thumb", "index", "middle", "ring", "pinky")
_KNUCKLES = {finger: ("mcp", "pip", "dip", "tip") for finger in FINGERS} | {
    "thumb": ("cmc", "mcp", "ip", "tip")
}
HAND = ("hand_wrist", *(f"{finger}_{place}" for finger in FINGERS for place in _KNUCKLES[finger]))
HANDS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in HAND)
HAND_LIMBS = tuple(
    (f"{side}_{one}", f"{side}_{other}")
    for side in ("left", "right")
    for one, other in (
        *(("hand_wrist", f"{finger}_{_KNUCKLES[finger][0]}") for finger in FINGERS),
        *(
            (f"{finger}_{one}", f"{finger}_{other}")
            for finger in FINGERS
            for one, other in itertools.pairwise(_KNUCKLES[finger])
        ),
        *((f"{one}_mcp", f"{other}_mcp") for one, other in itertools.pairwise(FINGERS[1:])),
    )
)
# Points of a face that have a name: where the 68 of Multi-PIE have them (Gross et al. 2010; the first of the
# 70 of OpenPose and the 68 of COCO-WholeBody and Halpe), and where the 468 of MediaPipe.
FACE_POINTS: Mapping[str, tuple[int, int]] = {
    "right_brow_outer": (17, 70), "right_brow_middle": (19, 105), "right_brow_inner": (21, 107),
    "left_brow_inner": (22, 336), "left_brow_middle": (24, 334), "left_brow_outer": (26, 300),
    "right_eye_outer": (36, 33), "right_eye_inner": (39, 133),
    "left_eye_inner": (42, 362), "left_eye_outer": (45, 263),
    "right_lid_upper": (37, 159), "right_lid_lower": (41, 145),
    "left_lid_upper": (44, 386), "left_lid_lower": (46, 374),
    "right_mouth": (48, 61), "left_mouth": (54, 291),
    "upper_lip": (62, 13), "lower_lip": (66, 14), "nose_tip": (30, 1), "chin": (8, 152),
}  # fmt: skip
FACE = tuple(FACE_POINTS)
FACE_LIMBS = (
    *((f"{side}_brow_{one}", f"{side}_brow_{two}")
      for side in ("left", "right") for one, two in (("outer", "middle"), ("middle", "inner"))),
    *((f"{side}_{one}", f"{side}_{two}") for side in ("left", "right") for one, two in (
        ("eye_outer", "lid_upper"), ("lid_upper", "eye_inner"), ("eye_inner", "lid_lower"),
        ("lid_lower", "eye_outer"), ("mouth", "upper_lip"), ("mouth", "lower_lip"))),
)  # fmt: skip
_FEET = ("ankle", "foot", "heel", "big_toe", "small_toe", "foot_index")
_SPINE = {"mid_hip", "spine", "spine1", "spine2", "spine3", "chest", "upper_neck", "left_collar"}
_SPINE |= {"right_collar"}
_OWN_HAND = {"hand", "hand_tip", "thumb", "index", "pinky", *HAND}


@cache
def group_of(joint: str) -> str:
    """The one of `GROUPS` that a joint belongs to."""
    part = joint.removeprefix("left_").removeprefix("right_")
    if joint in _SPINE:
        return "spine"
    if part in _FEET[1:]:
        return "feet"
    if part in _OWN_HAND and joint != part:
        return f"{joint.removesuffix(part)}hand"
    return "face" if joint in FACE_POINTS or joint.startswith("face_") else "body"


def face_joints(count: int) -> tuple[str, ...]:
    """Names of the points of a face of so many; those that have none are numbered."""
    named = {places[count > 70]: name for name, places in FACE_POINTS.items()}
    return tuple(named.get(place, f"face_{place}") for place in range(count))


ARMS = (
    ("right_shoulder", "right_elbow"),
    ("right_elbow", "right_wrist"),
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
)
LEGS = (
    ("right_hip", "right_knee"),
    ("right_knee", "right_ankle"),
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
)
NECK_LIMBS = (
    ("neck", "right_shoulder"),
    ("neck", "left_shoulder"),
    *ARMS,
    ("neck", "right_hip"),
    ("neck", "left_hip"),
    *LEGS,
)
HEAD = (
    ("nose", "right_eye"),
    ("right_eye", "right_ear"),
    ("nose", "left_eye"),
    ("left_eye", "left_ear"),
)
TORSO = (
    ("left_shoulder", "right_shoulder"),
    ("left_shoulder", "left_hip"),
    ("right_shoulder", "right_hip"),
    ("left_hip", "right_hip"),
)
