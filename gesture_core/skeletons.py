"""Joint names, limbs and mirrors of the skeletons that pose networks use, and their maps to COCO-18.

COCO-18, the layout of OpenPose's COCO network (Cao et al. 2017), is the canonical skeleton:
everything after the keypoint reader sees only it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from gesture_core.errors import KeypointError

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Skeleton:
    """A named set of joints.

    Attributes
    ----------
    name : str
    joints : tuple of str
        Joint names in the order of the keypoint array's second axis.
    limbs : tuple of (str, str)
        Pairs of joints to draw as bones.
    derived : mapping
        COCO-18 joints that this skeleton lacks, each the midpoint of two of its joints.
    """

    name: str
    joints: tuple[str, ...]
    limbs: tuple[tuple[str, str], ...]
    derived: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def index(self, joint: str) -> int:
        """Position of ``joint`` in the keypoint array."""
        return self.joints.index(joint)

    @property
    def mirror(self) -> tuple[int, ...]:
        """For each joint, the index of the joint on the other side of the body."""
        return tuple(self.joints.index(other_side(name)) for name in self.joints)


def other_side(name: str) -> str:
    """Name of a joint or channel on the other side of the body; itself on the body's middle line."""
    if name.startswith("left_"):
        return "right_" + name.removeprefix("left_")
    if name.startswith("right_"):
        return "left_" + name.removeprefix("right_")
    return name


def _mid_neck() -> dict[str, tuple[str, str]]:
    return {"neck": ("left_shoulder", "right_shoulder")}


_ARMS = (
    ("right_shoulder", "right_elbow"),
    ("right_elbow", "right_wrist"),
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
)
_LEGS = (
    ("right_hip", "right_knee"),
    ("right_knee", "right_ankle"),
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
)
_NECK_LIMBS = (
    ("neck", "right_shoulder"),
    ("neck", "left_shoulder"),
    *_ARMS,
    ("neck", "right_hip"),
    ("neck", "left_hip"),
    *_LEGS,
)
_FACE = (
    ("nose", "right_eye"),
    ("right_eye", "right_ear"),
    ("nose", "left_eye"),
    ("left_eye", "left_ear"),
)
_TORSO = (
    ("left_shoulder", "right_shoulder"),
    ("left_shoulder", "left_hip"),
    ("right_shoulder", "right_hip"),
    ("left_hip", "right_hip"),
)

COCO18 = Skeleton(
    "coco18",
    (
        "nose", "neck",
        "right_shoulder", "right_elbow", "right_wrist",
        "left_shoulder", "left_elbow", "left_wrist",
        "right_hip", "right_knee", "right_ankle",
        "left_hip", "left_knee", "left_ankle",
        "right_eye", "left_eye", "right_ear", "left_ear",
    ),
    (*_NECK_LIMBS, ("neck", "nose"), *_FACE),
)  # fmt: skip

COCO17 = Skeleton(
    "coco17",
    (
        "nose", "left_eye", "right_eye", "left_ear", "right_ear",
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
        "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    ),
    (*_TORSO, *_ARMS, *_LEGS, *_FACE),
    _mid_neck(),
)  # fmt: skip

BODY25 = Skeleton(
    "body25",
    (
        "nose", "neck",
        "right_shoulder", "right_elbow", "right_wrist",
        "left_shoulder", "left_elbow", "left_wrist",
        "mid_hip",
        "right_hip", "right_knee", "right_ankle",
        "left_hip", "left_knee", "left_ankle",
        "right_eye", "left_eye", "right_ear", "left_ear",
        "left_big_toe", "left_small_toe", "left_heel",
        "right_big_toe", "right_small_toe", "right_heel",
    ),
    (*_NECK_LIMBS, ("neck", "nose"), *_FACE),
)  # fmt: skip

MPI15 = Skeleton(
    "mpi15",
    (
        "head_top", "neck",
        "right_shoulder", "right_elbow", "right_wrist",
        "left_shoulder", "left_elbow", "left_wrist",
        "right_hip", "right_knee", "right_ankle",
        "left_hip", "left_knee", "left_ankle",
        "chest",
    ),
    (*_NECK_LIMBS, ("neck", "head_top")),
)  # fmt: skip

BLAZEPOSE33 = Skeleton(
    "blazepose33",
    (
        "nose",
        "left_eye_inner", "left_eye", "left_eye_outer",
        "right_eye_inner", "right_eye", "right_eye_outer",
        "left_ear", "right_ear", "left_mouth", "right_mouth",
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
        "left_pinky", "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb",
        "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
        "left_heel", "right_heel", "left_foot_index", "right_foot_index",
    ),
    (*_TORSO, *_ARMS, *_LEGS),
    _mid_neck(),
)  # fmt: skip

SKELETONS: Mapping[str, Skeleton] = MappingProxyType(
    {s.name: s for s in (COCO18, COCO17, BODY25, MPI15, BLAZEPOSE33)}
)


def skeleton(name: str) -> Skeleton:
    """The skeleton called ``name``; a KeypointError lists the known names otherwise."""
    try:
        return SKELETONS[name]
    except KeyError:
        raise KeypointError(
            f"unknown skeleton {name!r}", remedy=f"one of {', '.join(SKELETONS)}", code="E_SKELETON"
        ) from None


def to_coco18(keypoints: np.ndarray, scores: np.ndarray, source: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Reorder keypoints of any known skeleton into COCO-18.

    Parameters
    ----------
    keypoints : (T, J, 2) array
        NaN where missing.
    scores : (T, J) array
    source : Skeleton
        The layout of both arrays.

    Returns
    -------
    keypoints : (T, 18, 2) float32
        Joints that the source lacks are NaN; a derived joint (the neck as the midpoint of the
        shoulders) is NaN where either parent is.
    scores : (T, 18) float32
        Zero for joints that the source lacks; the lower parent's score for derived joints.
    """
    import numpy as np

    frames = keypoints.shape[0]
    out = np.full((frames, len(COCO18.joints), 2), np.nan, np.float32)
    out_scores = np.zeros((frames, len(COCO18.joints)), np.float32)
    for target, joint in enumerate(COCO18.joints):
        if joint in source.joints:
            column = source.index(joint)
            out[:, target] = keypoints[:, column]
            out_scores[:, target] = scores[:, column]
        elif joint in source.derived:
            a, b = (source.index(parent) for parent in source.derived[joint])
            out[:, target] = (keypoints[:, a] + keypoints[:, b]) / 2
            out_scores[:, target] = np.minimum(scores[:, a], scores[:, b])
    return out, out_scores
