"""Layouts of body, hands and face together: which joints are the body, all that is used."""

from __future__ import annotations

from collections.abc import Mapping

from gesture_core.plugin.reading import ReadOptions
from gesture_pose_files.layout import BY_COUNT

BODY_OF: Mapping[int, int] = {133: 17, 136: 26, 137: 25}
"""Joints of COCO-WholeBody, Halpe and OpenPose (body, face and hands in one list), and those of the body."""


def body_of(joints: int, options: ReadOptions) -> int | None:
    """How many of the first joints in a layout of ``joints`` are the body; None for no known layout."""
    if options.skeleton and len(options.skeleton.joints) == joints:
        return joints
    used = BODY_OF.get(joints, joints)
    return used if used in BY_COUNT else None


def known_counts(options: ReadOptions) -> str:
    """The numbers of joints that are known, in words."""
    own = [len(options.skeleton.joints)] if options.skeleton else []
    counts = sorted({*BY_COUNT, *BODY_OF, *own})
    return ", ".join(map(str, counts[:-1])) + f" or {counts[-1]}"
