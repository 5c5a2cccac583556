"""Motion captures in Biovision's form (``.bvh``): a tree of bones, and in each frame how these are turned."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.joint_names import words_of
from gesture_core.types import PoseSequence
from gesture_pose_files.files import COPY_AGAIN, MAX_CSV_BYTES, MAX_FRAMES, head_of, open_keypoints
from gesture_pose_files.in_front import seen_from_in_front
from gesture_pose_files.reader import OneClipReader
from gesture_pose_files.table import number_in, numbers_of, rows_of

_MOST_JOINTS = 1000
_AXES = "XYZ"
_CHANNELS = frozenset(f"{axis}{what}" for axis in _AXES for what in ("POSITION", "ROTATION"))
# A bone begins at the joint that it is turned around: what some call the forearm others call the elbow.
_BEGIN_AT = {
    "hip": "hip upleg upperleg thigh thighbend femur",
    "knee": "knee leg lowleg lowerleg shin calf shank tibia",
    "ankle": "ankle foot",
    "big_toe": "toe toes toebase ball",
    "collar": "collar clavicle",
    "shoulder": "arm uparm upperarm uarm humerus shldr shldrbend",
    "elbow": "elbow forearm lowarm lowerarm farm radius forearmbend",
    "wrist": "wrist hand",
    "neck": "neck necklower lowerneck necktwist",
    "head": "head",
    "mid_hip": "hip hips pelvis",
    "the root": "root",  # it lies on the floor in some files
}
_MIDDLE = {
    bone: joint for joint in ("neck", "head", "mid_hip", "the root") for bone in _BEGIN_AT[joint].split()
}
_SIDED = {bone: joint for joint, bones in list(_BEGIN_AT.items())[:8] for bone in bones.split()}
_SIDED["shoulder"] = "shoulder"  # the collar where there is an arm
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}
_ENDS_AT = {"elbow": "wrist", "knee": "ankle"}
_MOST_WORDS = 4
"""Of a bone, behind what its rig is called."""
_BLOCK = 4096
"""Frames whose turns are held at a time."""


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
    Poser, 3ds Max, Unreal and others call them; a forearm or a shin without a hand or foot behind it ends in
    one. Fingers are not read. The option ``order`` is for names of your own, those of ends left out.
    """

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.bvh`` and has ``HIERARCHY`` near its begin."""
        return path.suffix.lower() == ".bvh" and b"HIERARCHY" in head_of(path, 1024).upper()

    def refusal(self, path: Path) -> str:
        """What it begins with."""
        return f"it does not begin with HIERARCHY, but with {head_of(path, 12)!r}"

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The figure in the file."""
        with open_keypoints(path, MAX_CSV_BYTES) as file:
            rows = rows_of(file, source, " ")
            try:
                tree, said = _tree(rows)
            except (ValueError, IndexError) as error:
                cause = error if isinstance(error, ValueError) else "its tree of joints is not whole"
                raise KeypointError(
                    f"is no motion capture: {cause}",
                    subject=source,
                    remedy=COPY_AGAIN,
                    code="E_KEYPOINTS_FORMAT",
                ) from error
            frames, step, rows = _announced(said, rows)
            width = sum(map(len, tree.channels))
            motion, _ = numbers_of(_whole(rows, width), width, range(width), (), MAX_FRAMES, source)
        if not len(motion):
            raise KeypointError("holds no frame", subject=source, code="E_KEYPOINTS_EMPTY")
        joints = [number for number, name in enumerate(tree.names) if name]
        names = joint_names([tree.names[joint] for joint in joints])
        if self.options.skeleton is None or len(self.options.skeleton.joints) != len(names):
            for end, name in _ends(tree, dict(zip(joints, names, strict=True))):
                joints.append(end)
                names.append(name)
        points: np.ndarray = np.empty((len(motion), len(joints), 3), np.float32)
        for first in range(0, len(motion), _BLOCK):
            points[first : first + _BLOCK] = tree.places(motion[first : first + _BLOCK])[:, joints]
        del motion
        size = float(np.ptp(points[0], axis=0).max())
        pose = seen_from_in_front(
            names,
            points / (size if size > 0 else 1.0),
            np.arange(len(points)) * step if step else None,
            "m",
            self.options,
            source=source,
            reader="bvh",
            announced=frames,
            notes=["it names no unit: sizes are those of the figure in its first frame"],
        )
        return [pose]


def joint_names(names: Sequence[str]) -> list[str]:
    """What joints are called here that files call after the bones that begin there; others as they are.

    What stands before a bone is that of a rig, and numbers behind it tell those of one name apart, of which
    the first counts.

    >>> joint_names(["mixamorig:LeftShoulder", "mixamorig:LeftArm", "lowerarm_l", "Bip01 R Hand", "Tail"])
    ['left_collar', 'left_shoulder', 'left_elbow', 'right_wrist', 'Tail']
    """
    plain = [re.split("[:|]", name)[-1] or name for name in names]
    bones = [_bone(words_of(name)) for name in plain]
    arms = any(side and _SIDED[bone] == "shoulder" != bone for side, bone, _ in bones)
    out: list[str] = []
    for name, (side, bone, numbered) in zip(plain, bones, strict=True):
        joint = (_SIDED if side else _MIDDLE).get(bone, name)
        if arms and bone == "shoulder":
            joint = "collar"
        elif bone == "arm" and numbered and f"{side}_shoulder" in out:
            joint = "elbow"  # of RArm and RArm1
        joint = f"{side}_{joint}" if side else joint
        out.append(name if joint in out else joint)
    return out


def _ends(tree: _Tree, named: Mapping[int, str]) -> Iterator[tuple[int, str]]:
    """Ends of bones that are a wrist or an ankle, where no bone begins there."""
    for number, parent in enumerate(tree.parents):
        side, _, joint = named.get(parent, "").partition("_")
        end = f"{side}_{_ENDS_AT.get(joint, '')}"
        if not tree.names[number] and joint in _ENDS_AT and end not in named.values():
            yield number, end


def _bone(words: list[str]) -> tuple[str, str, bool]:
    """Side and bone, empty where there is none, and whether a number stands behind it."""
    sides = [word for word in words if word in _SIDES]
    rest = [word for word in words if word not in _SIDES]
    numbered = False
    while rest and (rest[-1].isdigit() or rest[-1] == "jnt"):
        numbered |= rest.pop().isdigit()
    whole = "".join(rest)
    if not sides and whole[:1] in _SIDES and whole[1:] in _SIDED:  # lfemur, LUArm
        return _SIDES[whole[0]], whole[1:], numbered
    known = _SIDED if sides else _MIDDLE
    last = rest[-_MOST_WORDS:]
    tails = ("".join(last[begin:]) for begin in range(len(last)))
    bone = next((tail for tail in tails if tail in known), "")
    return (_SIDES[sides[0]] if len(sides) == 1 and bone else ""), bone if len(sides) < 2 else "", numbered


def _tree(rows: Iterator[list[str]]) -> tuple[_Tree, str]:
    """The joints above the word ``MOTION``, and what follows on its line; an error where they are none."""
    tree = _Tree()
    open_ones: list[int] = []
    for cells in rows:
        for word, *rest in _statements(cells):
            key = word.upper()
            if key == "MOTION":
                if open_ones or not any(tree.channels):
                    raise ValueError("its tree of joints is not whole")
                return tree, " ".join(rest)
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
                tree.offsets[open_ones[-1]] = np.array(list(map(number_in, rest[:3])), float).reshape(3)
            elif key == "CHANNELS":
                found = [cell.upper() for cell in rest[1:]]
                if int(rest[0]) != len(found) or not _CHANNELS.issuperset(found):
                    raise ValueError(f"the channels {' '.join(rest)[:60]!r} are none")
                tree.channels[open_ones[-1]] = found
            elif key != "HIERARCHY":
                raise ValueError(f"{word[:40]!r} is no word of it")
    raise ValueError("it ends before MOTION")


def _announced(said: str, rows: Iterator[list[str]]) -> tuple[float, float, Iterator[list[str]]]:
    """Frames, the seconds between them, 0 where nothing is said, and the rows of numbers."""
    for cells in rows:
        if cells and cells[0][0] in "+-.0123456789":
            rows = chain([cells], rows)
            break
        said += " " + " ".join(cells)
    found = re.findall(r"\b(Frames|Frame Time)[: ]+(\S+)", said, re.IGNORECASE)
    values = {name.casefold(): number_in(value) or 0.0 for name, value in found}
    return values.get("frames", 0.0), values.get("frame time", 0.0), rows


def _statements(cells: list[str]) -> Iterator[list[str]]:
    """Those of a line, on which braces may stand behind a name, and a remark behind all."""
    for part in re.split(r"([{}])", re.sub(r"(^|\s)(#|//).*", "", " ".join(cells))):
        if words := part.split():
            yield words


def _whole(rows: Iterator[list[str]], width: int) -> Iterator[list[str]]:
    """``rows`` without a last one that is cut."""
    last: list[str] = []
    for row in filter(None, rows):
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
