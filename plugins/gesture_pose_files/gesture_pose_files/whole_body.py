"""Layouts of body, hands and face together: which joints are the body, all that is used."""

from __future__ import annotations

from collections.abc import Mapping

from gesture_pose_files.layout import BY_COUNT

BODY_OF: Mapping[int, int] = {133: 17, 136: 26, 137: 25}
"""Joints of COCO-WholeBody, Halpe and OpenPose (body, face and hands in one list), and those of the body."""


def body_of(joints: int) -> int | None:
    """How many of the first joints in a layout of ``joints`` are the body; None for no known layout."""
    used = BODY_OF.get(joints, joints)
    return used if used in BY_COUNT else None


def known_counts() -> str:
    """The numbers of joints that are known, in words."""
    counts = sorted({*BY_COUNT, *(whole for whole, body in BODY_OF.items() if body in BY_COUNT)})
    return ", ".join(map(str, counts[:-1])) + f" or {counts[-1]}"
