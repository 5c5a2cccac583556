"""Joint names, limbs and mirrors of the skeletons that pose networks use, and their maps to COCO-18.

COCO-18, the layout of OpenPose's COCO network (Cao et al. 2017), is the canonical skeleton:
everything after the keypoint reader sees only it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
        COCO-18 joints that this skeleton lacks, each the midpoint of two of its joints, or one of them twice.
    """

    name: str
    joints: tuple[str, ...]
    limbs: tuple[tuple[str, str], ...]
    derived: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def index(self, joint: str) -> int:
        """Position of ``joint`` in the keypoint array."""
        return self.joints.index(joint)

    @property
    def has_neck(self) -> bool:
        """Whether the neck, the origin of the body, is there or can be derived."""
        return "neck" in self.joints or "neck" in self.derived

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


_MIDDLE_NECK = {"neck": ("left_shoulder", "right_shoulder")}
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
    _MIDDLE_NECK,
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
    _MIDDLE_NECK,
)  # fmt: skip

HALPE26 = Skeleton(
    "halpe26",
    (
        *COCO17.joints,
        "head_top", "neck", "mid_hip",
        "left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe", "left_heel", "right_heel",
    ),
    (*_NECK_LIMBS, ("neck", "head_top"), *_FACE),
)  # fmt: skip

H36M17 = Skeleton(
    "h36m17",
    (
        "mid_hip",
        "right_hip", "right_knee", "right_ankle",
        "left_hip", "left_knee", "left_ankle",
        "spine", "neck", "nose", "head_top",
        "left_shoulder", "left_elbow", "left_wrist",
        "right_shoulder", "right_elbow", "right_wrist",
    ),
    (*_NECK_LIMBS, ("neck", "nose"), ("nose", "head_top")),
)  # fmt: skip

# Of Kinect's joints the centre of the shoulders is what others call the neck.
KINECT20 = Skeleton(
    "kinect20",
    (
        "mid_hip", "spine", "neck", "head",
        "left_shoulder", "left_elbow", "left_wrist", "left_hand",
        "right_shoulder", "right_elbow", "right_wrist", "right_hand",
        "left_hip", "left_knee", "left_ankle", "left_foot",
        "right_hip", "right_knee", "right_ankle", "right_foot",
    ),
    (*_NECK_LIMBS, ("neck", "head")),
)  # fmt: skip

KINECT25 = Skeleton(
    "kinect25",
    (
        "mid_hip", "spine", "upper_neck", "head",
        "left_shoulder", "left_elbow", "left_wrist", "left_hand",
        "right_shoulder", "right_elbow", "right_wrist", "right_hand",
        "left_hip", "left_knee", "left_ankle", "left_foot",
        "right_hip", "right_knee", "right_ankle", "right_foot",
        "neck",
        "left_hand_tip", "left_thumb", "right_hand_tip", "right_thumb",
    ),
    (*_NECK_LIMBS, ("neck", "head")),
)  # fmt: skip

SKELETONS: Mapping[str, Skeleton] = MappingProxyType(
    {s.name: s for s in (COCO18, COCO17, BODY25, MPI15, BLAZEPOSE33, HALPE26, H36M17, KINECT20, KINECT25)}
)

# What may stand in for a joint of COCO-18 where a file has no such joint: first what is there counts.
_STAND_INS: tuple[tuple[str, tuple[str, str]], ...] = (
    ("neck", ("left_shoulder", "right_shoulder")),
    ("left_hip", ("mid_hip", "mid_hip")),
    ("right_hip", ("mid_hip", "mid_hip")),
    ("left_wrist", ("left_hand", "left_hand")),
    ("right_wrist", ("right_hand", "right_hand")),
)


def skeleton_of(joints: Sequence[str]) -> Skeleton:
    """The skeleton of a file that names its joints: a known one, or one of its own called ``named``.

    Its neck is the middle of the shoulders, and its hips the middle of the body, where it has none itself.
    """
    names = tuple(joints)
    for known in SKELETONS.values():
        if known.joints == names:
            return known
    derived = {
        joint: parents for joint, parents in _STAND_INS if joint not in names and set(parents) <= set(names)
    }
    limbs = tuple(limb for limb in (*_NECK_LIMBS, ("neck", "nose"), *_FACE) if set(limb) <= set(names))
    return Skeleton("named", names, limbs, derived)


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
