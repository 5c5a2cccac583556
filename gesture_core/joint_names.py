"""Names of joints as files write them: ``LShoulder``, ``shoulder_l`` and ``LEFT SHOULDER`` are one joint."""

from __future__ import annotations

import re
from collections.abc import Sequence

from gesture_core.skeletons import SKELETONS

__all__ = ["joint_named", "joints_named", "words_of"]

_BETWEEN = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])")
_SIDES = {"left": "left", "l": "left", "lt": "left", "right": "right", "r": "right", "rt": "right"}
_KNOWN = {
    joint
    for body in SKELETONS.values()
    for joint in body.joints
    if not joint.startswith("face_") and "_pose_" not in joint
}
_SIDED = {joint.removeprefix("left_") for joint in _KNOWN if joint.startswith("left_")}
_MIDDLE = {joint for joint in _KNOWN if not joint.startswith(("left_", "right_"))}
_ALIASES = {
    "shldr": "shoulder", "sho": "shoulder", "shoulders": "neck", "mid_shoulder": "neck", "thorax": "neck",
    "shoulder_center": "neck", "shoulder_centre": "neck", "center_shoulder": "neck", "spine_shoulder": "neck",
    "shoulders_center": "neck", "mid_shoulders": "neck", "neck_base": "neck",
    "elb": "elbow", "wri": "wrist", "kne": "knee", "ank": "ankle",
    "hip_center": "mid_hip", "hip_centre": "mid_hip", "center_hip": "mid_hip", "mid_hips": "mid_hip",
    "pelvis": "mid_hip", "root": "mid_hip", "spine_base": "mid_hip", "hips": "mid_hip",
    "hips_center": "mid_hip", "pelvis_center": "mid_hip",
    "top_head": "head_top", "top_of_head": "head_top", "headtop": "head_top",
    "inner_eye": "eye_inner", "outer_eye": "eye_outer", "bigtoe": "big_toe", "smalltoe": "small_toe",
    "midhip": "mid_hip", "hipcenter": "mid_hip", "shouldercenter": "neck", "spineshoulder": "neck",
    "spinebase": "mid_hip", "hand_tip": "hand_tip", "handtip": "hand_tip", "spine_mid": "spine",
    "spine_middle": "spine", "mid_spine": "spine", "spine_1": "spine1", "spine_2": "spine2",
    "spine_3": "spine3", "spine_navel": "spine", "spine_chest": "chest", "clavicle": "collar",
}  # fmt: skip


def words_of(name: str) -> list[str]:
    """The words and numbers of a name, lower case: ``LShoulder.x`` is l, shoulder, x."""
    parts = _BETWEEN.sub(" ", name.strip())
    return [word.casefold() for word in re.split(r"[^0-9A-Za-z]+", parts) if word]


def joint_named(name: str) -> str | None:
    """The joint, as `gesture_core.skeletons` calls it, that a file calls ``name``; None for no known one.

    Examples
    --------
    >>> [joint_named(name) for name in ("LShoulder", "shoulder_r", "Left Eye Inner", "MidHip", "tail")]
    ['left_shoulder', 'right_shoulder', 'left_eye_inner', 'mid_hip', None]
    """
    words = [word for word in words_of(name) if word != "finger"]  # MediaPipe's INDEX_FINGER_TIP
    sides = [word for word in words if word in _SIDES]
    if len(sides) == 1 and len(words) > 1:
        words.remove(sides[0])
        return _sided(_SIDES[sides[0]], "_".join(words))
    whole = "_".join(words)
    middle = _ALIASES.get(whole, whole)
    if middle in _MIDDLE:
        return middle
    for prefix, side in sorted(_SIDES.items(), key=lambda item: -len(item[0])):
        for rest in (whole.removeprefix(prefix), whole.removesuffix(prefix)):
            if rest != whole and (found := _sided(side, rest.strip("_"))):
                return found
    return None


def joints_named(names: Sequence[str]) -> list[str | None]:
    """The joint that each of ``names`` is; what is called the neck lies above it where another is its base.

    Examples
    --------
    >>> joints_named(["Neck", "SpineShoulder"]), joints_named(["Neck", "SpineMid"])
    (['upper_neck', 'neck'], ['neck', 'spine'])
    """
    found = [joint_named(name) for name in names]
    called = ["neck" in words_of(name) for name in names]
    based = ("neck", False) in zip(found, called, strict=True)
    return [
        "upper_neck" if based and own and joint == "neck" else joint
        for joint, own in zip(found, called, strict=True)
    ]


def _sided(side: str, part: str) -> str | None:
    part = _ALIASES.get(part, part)
    return f"{side}_{part}" if part in _SIDED else None
