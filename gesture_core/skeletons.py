"""The skeletons that files and networks use: joints, limbs, mirrors, groups, and maps between them.

COCO-18, the layout of OpenPose's COCO network (Cao et al. 2017), is the canonical body: what a chain does not
ask for by name is mapped to it. Joints of the same name are the same joint in every skeleton, so that a map
needs no table. To a body, ``+hands`` and ``+face`` in its name add the joints of these groups:
``coco18+hands``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from gesture_core.errors import KeypointError
from gesture_core.joints import (
    ARMS,
    FACE,
    FACE_LIMBS,
    FACE_POINTS,
    HAND,
    HAND_LIMBS,
    HANDS,
    HEAD,
    LEGS,
    NECK_LIMBS,
    TORSO,
    face_joints,
    group_of,
    other_side,
)

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
        Joints that this skeleton lacks, each the midpoint of two of its joints, or one of them twice.
    body : str
        Of a whole body: the skeleton that its body has alone; empty for a body.
    """

    name: str
    joints: tuple[str, ...]
    limbs: tuple[tuple[str, str], ...]
    derived: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    body: str = ""

    def index(self, joint: str) -> int:
        """Position of ``joint`` in the keypoint array."""
        return self.joints.index(joint)

    def group(self, name: str) -> tuple[str, ...]:
        """The joints of one of `GROUPS`, in the order of the keypoint array."""
        return tuple(joint for joint in self.joints if group_of(joint) == name)

    @property
    def has_neck(self) -> bool:
        """Whether the neck, the origin of the body, is there or can be derived."""
        return "neck" in self.joints or "neck" in self.derived

    @property
    def has_hands(self) -> bool:
        """Whether the wrist of a hand, the hand's origin, is there."""
        return any(f"{side}_hand_wrist" in self.joints for side in ("left", "right"))

    @property
    def mirror(self) -> tuple[int, ...]:
        """For each joint, the index of the joint on the other side of the body."""
        places = {name: index for index, name in enumerate(self.joints)}
        return tuple(places.get(other_side(name), index) for name, index in places.items())


_MIDDLE_NECK = {"neck": ("left_shoulder", "right_shoulder")}
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
    (*NECK_LIMBS, ("neck", "nose"), *HEAD),
)  # fmt: skip

COCO17 = Skeleton(
    "coco17",
    (
        "nose", "left_eye", "right_eye", "left_ear", "right_ear",
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
        "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    ),
    (*TORSO, *ARMS, *LEGS, *HEAD),
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
    (*NECK_LIMBS, ("neck", "nose"), *HEAD),
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
    (*NECK_LIMBS, ("neck", "head_top")),
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
    (*TORSO, *ARMS, *LEGS),
    _MIDDLE_NECK,
)  # fmt: skip

HALPE26 = Skeleton(
    "halpe26",
    (
        *COCO17.joints,
        "head_top", "neck", "mid_hip",
        "left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe", "left_heel", "right_heel",
    ),
    (*NECK_LIMBS, ("neck", "head_top"), *HEAD),
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
    (*NECK_LIMBS, ("neck", "nose"), ("nose", "head_top")),
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
    (*NECK_LIMBS, ("neck", "head")),
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
    (*NECK_LIMBS, ("neck", "head")),
)  # fmt: skip

# Azure's order: the spine first, then the arms, the legs and the head.
KINECT32 = Skeleton(
    "kinect32",
    (
        "mid_hip", "spine", "chest", "neck",
        "left_collar", "left_shoulder", "left_elbow", "left_wrist", "left_hand", "left_hand_tip",
        "left_thumb",
        "right_collar", "right_shoulder", "right_elbow", "right_wrist", "right_hand", "right_hand_tip",
        "right_thumb",
        "left_hip", "left_knee", "left_ankle", "left_foot",
        "right_hip", "right_knee", "right_ankle", "right_foot",
        "head", "nose", "left_eye", "left_ear", "right_eye", "right_ear",
    ),
    (*NECK_LIMBS, ("neck", "nose"), *HEAD),
)  # fmt: skip

SMPL22 = Skeleton(
    "smpl22",
    (
        "mid_hip", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2",
        "left_ankle", "right_ankle", "spine3", "left_foot", "right_foot", "neck",
        "left_collar", "right_collar", "head",
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    ),
    (*NECK_LIMBS, ("neck", "head")),
)  # fmt: skip

_LEFT, _RIGHT = HANDS[: len(HAND)], HANDS[len(HAND) :]
_WRISTS = {f"{side}_wrist": (f"{side}_hand_wrist",) * 2 for side in ("left", "right")}


def _hands(name: str, joints: tuple[str, ...]) -> Skeleton:
    wrists = {joint: pair for joint, pair in _WRISTS.items() if pair[0] in joints}
    limbs = tuple(limb for limb in HAND_LIMBS if limb[0] in joints)
    return Skeleton(name, joints, limbs, wrists, COCO18.name)


LEFT_HAND, RIGHT_HAND = _hands("left_hand21", _LEFT), _hands("right_hand21", _RIGHT)
HANDS42 = _hands("hands42", HANDS)

FACE20 = Skeleton("face20", FACE, FACE_LIMBS, {}, COCO18.name)


def _whole(name: str, body: Skeleton, *rest: str) -> Skeleton:
    """``body`` and further joints."""
    there = {*body.joints, *rest}
    limbs = (*body.limbs, *(limb for limb in (*HAND_LIMBS, *FACE_LIMBS) if there.issuperset(limb)))
    return Skeleton(name, (*body.joints, *rest), limbs, body.derived, body.name)


def _with_feet(joints: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{side}_{joint}" for side in ("left", "right") for joint in joints)


_TOES = _with_feet(("big_toe", "small_toe", "heel"))
COCO133 = _whole("coco133", COCO17, *_TOES, *face_joints(68), *HANDS)
HALPE136 = _whole("halpe136", HALPE26, *face_joints(68), *HANDS)
# OpenPose keeps its parts in lists of their own; files that join them have the face first or last.
OPENPOSE137 = _whole("openpose137", BODY25, *face_joints(70), *HANDS)
OPENPOSE137_HANDS = _whole("openpose137-hands", BODY25, *HANDS, *face_joints(70))
OPENPOSE130 = _whole("openpose130", COCO18, *face_joints(70), *HANDS)
OPENPOSE127 = _whole("openpose127", MPI15, *face_joints(70), *HANDS)
MEDIAPIPE75 = _whole("mediapipe75", BLAZEPOSE33, *HANDS)


# The body's own corners of the eyes and the mouth are rougher than those of the face.
_ROUGH = tuple(
    f"{joint.partition('_')[0]}_pose_{joint.partition('_')[2]}" if joint in FACE_POINTS else joint
    for joint in BLAZEPOSE33.joints
)
_MP543 = replace(BLAZEPOSE33, joints=_ROUGH)
MEDIAPIPE543 = _whole("mediapipe543", _MP543, *face_joints(468), *HANDS)
# The order of tables: the face, the left hand, the body, the right hand.
MEDIAPIPE543_FACE = replace(
    MEDIAPIPE543, name="mediapipe543-face", joints=(*face_joints(468), *_LEFT, *_ROUGH, *_RIGHT)
)

SKELETONS: Mapping[str, Skeleton] = MappingProxyType(
    {
        s.name: s
        for s in (
            COCO18, COCO17, BODY25, MPI15, BLAZEPOSE33, HALPE26, H36M17, KINECT20, KINECT25, KINECT32, SMPL22,
            LEFT_HAND, RIGHT_HAND, HANDS42, COCO133, HALPE136, OPENPOSE137, OPENPOSE137_HANDS, OPENPOSE130,
            OPENPOSE127, MEDIAPIPE75, MEDIAPIPE543, MEDIAPIPE543_FACE,
        )
    }
)  # fmt: skip


def is_fine(joint: str) -> bool:
    """Whether a joint is one of the 21 of a hand, or of the many of a face."""
    return joint in HANDS or (group_of(joint) == "face" and joint not in BLAZEPOSE33.joints)


# What may stand in for a joint of COCO-18 where a file has no such joint: first what is there counts.
_STAND_INS: tuple[tuple[str, tuple[str, str]], ...] = (
    ("neck", ("left_shoulder", "right_shoulder")),
    ("left_hip", ("mid_hip", "mid_hip")),
    ("right_hip", ("mid_hip", "mid_hip")),
    ("left_wrist", ("left_hand", "left_hand")),
    ("right_wrist", ("right_hand", "right_hand")),
    ("left_ankle", ("left_foot", "left_foot")),
    ("right_ankle", ("right_foot", "right_foot")),
    ("left_wrist", ("left_hand_wrist", "left_hand_wrist")),
    ("right_wrist", ("right_hand_wrist", "right_hand_wrist")),
)


def skeleton_of(joints: Sequence[str]) -> Skeleton:
    """The skeleton of a file that names its joints: a known one, or one of its own called ``named``.

    Its neck is the middle of the shoulders, and its hips the middle of the body, where it has none itself.
    """
    names = tuple(joints)
    for known in SKELETONS.values():
        if known.joints == names:
            return known
    derived: dict[str, tuple[str, str]] = {}
    for joint, parents in _STAND_INS:
        if joint not in names and set(parents) <= set(names):
            derived.setdefault(joint, parents)
    limbs = tuple(limb for limb in (*NECK_LIMBS, ("neck", "nose"), *HEAD) if set(limb) <= set(names))
    return Skeleton("named", names, limbs, derived)


@cache
def skeleton(name: str) -> Skeleton:
    """The skeleton called ``name``, a key of `SKELETONS` or one with ``+hands`` and ``+face`` behind it.

    Raises
    ------
    KeypointError
        `E_SKELETON` for any other; it lists the known names.
    """
    if name == FACE20.name:  # of a network; no file has it
        return FACE20
    base, *parts = name.split("+")
    if base not in SKELETONS or parts not in ([], ["hands"], ["face"], ["hands", "face"]):
        raise KeypointError(
            f"unknown skeleton {name!r}",
            remedy=f"one of {', '.join(SKELETONS)}, a body with +hands or +face behind it",
            code="E_SKELETON",
        )
    body = SKELETONS[base]
    more = [joint for part in parts for joint in (HANDS if part == "hands" else FACE)]
    return _whole(name, body, *(joint for joint in more if joint not in body.joints)) if parts else body


def with_parts(body: str, parts: Collection[str]) -> Skeleton:
    """The skeleton ``body`` with those of ``parts``, keys of `PARTS`, that are beyond the body."""
    return skeleton("+".join([body, *(part for part in ("hands", "face") if part in parts)]))


def mapped(
    keypoints: np.ndarray, scores: np.ndarray, source: Skeleton, target: Skeleton
) -> tuple[np.ndarray, np.ndarray]:
    """Reorder keypoints of one skeleton into another, by the names of the joints.

    Parameters
    ----------
    keypoints : (T, J, C) array
        NaN where missing.
    scores : (T, J) array
    source, target : Skeleton
        The layout of both arrays, and the wanted one.

    Returns
    -------
    keypoints : (T, K, C) float32
        Joints that the source lacks are NaN; a derived joint (the neck as the midpoint of the
        shoulders) is NaN where either parent is.
    scores : (T, K) float32
        Zero for joints that the source lacks; the lower parent's score for derived joints.
    """
    import numpy as np

    frames, joints = len(keypoints), len(target.joints)
    out = np.full((frames, joints, *keypoints.shape[2:]), np.nan, np.float32)
    out_scores = np.zeros((frames, joints), np.float32)
    places = {joint: place for place, joint in enumerate(source.joints)}
    for column, joint in enumerate(target.joints):
        if joint in places:
            out[:, column] = keypoints[:, places[joint]]
            out_scores[:, column] = scores[:, places[joint]]
        elif joint in source.derived:
            a, b = (places[parent] for parent in source.derived[joint])
            out[:, column] = (keypoints[:, a] + keypoints[:, b]) / 2
            out_scores[:, column] = np.minimum(scores[:, a], scores[:, b])
    return out, out_scores
