"""Motion captures in Biovision's form (``.bvh``): a tree of bones, and in each frame how these are turned."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.joint_names import words_of
from gesture_core.types import PoseSequence
from gesture_pose_files.files import COPY_AGAIN, MAX_CSV_BYTES, MAX_FRAMES, head_of, open_keypoints
from gesture_pose_files.in_front import seen_from_in_front
from gesture_pose_files.reader import OneClipReader
from gesture_pose_files.table import numbers_of, rows_of

_MOST_JOINTS = 1000
_AXES = "XYZ"
_CHANNELS = frozenset(f"{axis}{what}" for axis in _AXES for what in ("POSITION", "ROTATION"))
# A bone begins at the joint that it is turned around: what some call the forearm others call the elbow.
_BEGINS_AT = {
    "up_leg": "hip", "upper_leg": "hip", "thigh": "hip",
    "leg": "knee", "low_leg": "knee", "lower_leg": "knee", "shin": "knee", "calf": "knee",
    "foot": "ankle", "toe": "big_toe", "toe_base": "big_toe", "ball": "big_toe",
    "arm": "shoulder", "up_arm": "shoulder", "upper_arm": "shoulder",
    "fore_arm": "elbow", "low_arm": "elbow", "lower_arm": "elbow", "hand": "wrist", "clavicle": "collar",
}  # fmt: skip
_ONE_WORD = {"upperarm": "upper_arm", "forearm": "fore_arm", "lowerarm": "lower_arm", "upleg": "up_leg"}
# A root lies on the floor in some files.
_MIDDLE = {
    "neck": "neck",
    "neck_01": "neck",
    "head": "head",
    "hip": "mid_hip",
    "hips": "mid_hip",
    "pelvis": "mid_hip",
    "root": "(root)",
}
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}
_RIGS = frozenset(("mixamorig", "bip", "bip01", "bip001", "skel", "character"))


@dataclass
class _Tree:
    """The joints of a file, the ends of its last bones among them, each behind its parent."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[np.ndarray] = field(default_factory=list)
    channels: list[list[str]] = field(default_factory=list)

    def places(self, motion: np.ndarray) -> np.ndarray:
        """(T, N, 3) where the joints are, by the (T, C) values of all channels."""
        out: np.ndarray = np.zeros((len(motion), len(self.names), 3))
        turns: list[np.ndarray] = []
        column = 0
        for joint, (parent, offset) in enumerate(zip(self.parents, self.offsets, strict=True)):
            step: np.ndarray = np.tile(offset, (len(motion), 1))
            turn: np.ndarray = np.broadcast_to(np.eye(3), (len(motion), 3, 3))
            for channel in self.channels[joint]:
                axis, values = _AXES.index(channel[0]), motion[:, column]
                column += 1
                if channel.endswith("POSITION"):
                    step[:, axis] = values
                else:
                    turn = turn @ _rotations(axis, np.radians(values))
            if parent >= 0:
                step = out[:, parent] + (turns[parent] @ step[:, :, None])[..., 0]
                turn = turns[parent] @ turn
            out[:, joint] = step
            turns.append(turn)
        return out


class BvhReader(OneClipReader):
    """Reads ``.bvh``, seen from in front, in sizes of the figure in its first frame, as files name no unit.

    Joints are known by their own names or by those of the bones that begin there, as Mixamo, MotionBuilder,
    Poser, 3ds Max and Unreal call them. Fingers are not read. The option ``order`` is for names of your
    own, those of ends left out.
    """

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.bvh`` and begins with ``HIERARCHY``."""
        return path.suffix.lower() == ".bvh" and b"HIERARCHY" in head_of(path, 64).upper()

    def refusal(self, path: Path) -> str:
        """What it begins with."""
        return f"it does not begin with HIERARCHY, but with {head_of(path, 12)!r}"

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The figure in the file."""
        with open_keypoints(path, MAX_CSV_BYTES) as file:
            rows = rows_of(file, source, " ")
            try:
                tree = _tree(rows)
                frames, step = (float(next(rows, ["its header is cut"])[-1]) for _ in range(2))
            except (ValueError, IndexError) as error:
                raise KeypointError(
                    f"is no motion capture: {error}",
                    subject=source,
                    remedy=COPY_AGAIN,
                    code="E_KEYPOINTS_FORMAT",
                ) from error
            width = sum(map(len, tree.channels))
            motion, _ = numbers_of(_whole(rows, width), width, range(width), (), MAX_FRAMES, source)
        if not len(motion):
            raise KeypointError("holds no frame", subject=source, code="E_KEYPOINTS_EMPTY")
        joints = [number for number, name in enumerate(tree.names) if name]
        points = tree.places(motion)[:, joints]
        size = float(np.ptp(points[0], axis=0).max())
        pose = seen_from_in_front(
            joint_names([tree.names[joint] for joint in joints]),
            points / (size if size > 0 else 1.0),
            np.arange(len(points)) * step,
            "m",
            self.options,
            source=source,
            reader="bvh",
            announced=frames,
            notes=["it names no unit: sizes are those of the figure in its first frame"],
        )
        return [pose]


def joint_names(names: list[str]) -> list[str]:
    """What joints are called here that files call after the bones that begin there; others as they are.

    >>> joint_names(["mixamorig:LeftShoulder", "mixamorig:LeftArm", "lowerarm_l", "Bip01 R Hand", "Tail"])
    ['left_collar', 'left_shoulder', 'left_elbow', 'right_wrist', 'Tail']
    """
    parts = []
    for name in names:
        words = [word for word in words_of(name) if word not in _RIGS]
        while words and words[0].isdigit():
            words.pop(0)
        sides = [word for word in words if word in _SIDES]
        rest = "_".join(word for word in words if word not in _SIDES)
        parts.append((_SIDES[sides[0]] if len(sides) == 1 else "", _ONE_WORD.get(rest, rest)))
    bones = any(part in ("arm", "up_arm", "upper_arm") for side, part in parts if side)
    out = []
    for name, (side, part) in zip(names, parts, strict=True):
        begins = "collar" if bones and part == "shoulder" else _BEGINS_AT.get(part, part)
        out.append(f"{side}_{begins}" if side else _MIDDLE.get(part, name))
    return out


def _tree(rows: Iterator[list[str]]) -> _Tree:
    """The joints above the line ``MOTION``; a ValueError where they are none."""
    tree = _Tree()
    open_ones: list[int] = []
    for cells in rows:
        for word, *rest in _statements(cells):
            key = word.upper()
            if key == "MOTION":
                if open_ones or not any(tree.channels):
                    raise ValueError("its tree of joints is not whole")
                return tree
            if key in ("ROOT", "JOINT", "END"):
                tree.names.append("" if key == "END" else " ".join(rest))
                tree.parents.append(open_ones[-1] if open_ones else -1)
                tree.offsets.append(np.zeros(3))
                tree.channels.append([])
                if len(tree.names) > _MOST_JOINTS:
                    raise ValueError(f"it has more than {_MOST_JOINTS} joints")
            elif key == "{":
                open_ones.append(len(tree.names) - 1)
            elif key == "}":
                open_ones.pop()
            elif key == "OFFSET":
                tree.offsets[open_ones[-1]] = np.array([float(cell) for cell in rest[:3]]).reshape(3)
            elif key == "CHANNELS":
                found = [cell.upper() for cell in rest[1:]]
                if int(rest[0]) != len(found) or not _CHANNELS.issuperset(found):
                    raise ValueError(f"the channels {' '.join(rest)[:60]!r} are none")
                tree.channels[open_ones[-1]] = found
            elif key != "HIERARCHY":
                raise ValueError(f"{word[:40]!r} is no word of it")
    raise ValueError("it ends before MOTION")


def _statements(cells: list[str]) -> Iterator[list[str]]:
    """Those of a line, on which braces may stand behind a name."""
    for part in re.split(r"([{}])", " ".join(cells)):
        if words := part.split():
            yield words


def _whole(rows: Iterator[list[str]], width: int) -> Iterator[list[str]]:
    """``rows`` without a last one that is cut."""
    last: list[str] = []
    for row in rows:
        if last:
            yield last
        last = row
    if len(last) >= width:
        yield last


def _rotations(axis: int, angles: np.ndarray) -> np.ndarray:
    """(T, 3, 3) around one axis."""
    out: np.ndarray = np.tile(np.eye(3), (len(angles), 1, 1))
    one, two = (axis + 1) % 3, (axis + 2) % 3
    out[:, one, one] = out[:, two, two] = np.cos(angles)
    out[:, two, one] = np.sin(angles)
    out[:, one, two] = -out[:, two, one]
    return out
