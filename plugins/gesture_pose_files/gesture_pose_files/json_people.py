"""People in parsed JSON, as OpenPose, AlphaPose, COCO's tools, MMPose and Ultralytics write them.

A joint is x, y, score, the score zero where it was not found; OpenPose's x and y are then zero too, unless
``--keypoint_scale 4`` moved them to -1. ``pose_keypoints_2d`` was called ``pose_keypoints`` before 1.1.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.joint_names import joints_named
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import Person
from gesture_pose_files.layout import BY_COUNT, NOT_USED
from gesture_pose_files.whole_body import body_of, known_counts

_LARGEST = 1e7
_PEOPLE = ("people", "bodies", "instances", "instance_info", "predictions")
_KEYPOINTS = ("pose_keypoints_2d", "pose_keypoints", "keypoints", "joints", "pred_keypoints")
_LANDMARKS = ("pose_landmarks", "poseLandmarks", "landmarks", "landmark")
_SCORE_OF = ("visibility", "score", "confidence")
SCORES = ("keypoint_scores", "keypoints_scores", "keypoint_score", "kp_score", "keypoints_visible")
_REST: Mapping[str, int] = {
    "face_keypoints_2d": 70,
    "hand_left_keypoints_2d": 21,
    "hand_right_keypoints_2d": 21,
}
"""OpenPose's further lists and how many joints they have, in the order in which they follow the body."""
_BODIES = (15, 18, 25)
_IDENTITIES = ("track_id", "idx", "person_id")


@dataclass(frozen=True)
class Found:
    """The people of one frame.

    Attributes
    ----------
    people : list of Person
        With scores as the file has them, which may be above 1.
    identities : list of int or None
        Of each, None where the file tells none.
    joints : int
        Of the layout, 0 where there is nobody.
    notes : frozenset of str
        What the file holds and is not used.
    """

    people: list[Person] = field(default_factory=list)
    identities: list[int | None] = field(default_factory=list)
    joints: int = 0
    notes: frozenset[str] = frozenset()


def is_frame(tree: object) -> bool:
    """Whether a tree is one frame: an object that holds a list of people, or that list itself."""
    return _people(tree) is not None


def people_in(frame: object, name: str, options: ReadOptions) -> Found:
    """The people in a parsed frame; ``options`` may name an order of other than the known joints.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_FORMAT` (JSON of another kind), `E_KEYPOINTS_VALUE`.
    """
    people = _people(frame)
    if people is None:
        raise _refused("holds no list 'people', it is not OpenPose's", name)
    found, identities, counts, notes = [], [], Counter[int](), {*_beside(frame)}
    for number, person in enumerate(people):
        if not isinstance(person, Mapping):
            raise _refused(f"person {number} is no object with keypoints", name)
        joints = _joints(person, number, name, options)
        if joints is None:
            continue
        if options.whole and len(joints) in _BODIES and any(key in person for key in _REST):
            joints = np.concatenate([joints, _rest(person, number, name)])
        elif any(_seen(person.get(key)) for key in _REST):
            notes.add(NOT_USED)
        counts[len(joints)] += 1
        missing = ~(joints[:, 2] > 0) | np.isnan(joints[:, :2]).any(axis=1)
        if not missing.all():
            points = np.where(missing[:, None], np.float32(np.nan), joints[:, :2])
            found.append(Person(points, np.where(missing, np.float32(0), joints[:, 2])))
            identities.append(_identity(person))
    if len(counts) > 1:
        numbers = " and ".join(map(str, sorted(counts)))
        raise _refused(f"mixes skeletons: people have {numbers} joints", name)
    return Found(found, identities, next(iter(counts), 0), frozenset(notes))


def _people(frame: object) -> list[Any] | None:
    """The list of people in a frame; one person as an object is a list of one."""
    if (marks := landmarks_of(frame)) is not None:
        score = next((key for key in _SCORE_OF if marks and key in marks[0]), "")
        joints = [[mark.get("x"), mark.get("y"), mark.get(score, 1.0)] for mark in marks]
        return [{"keypoints": joints}] if joints else []
    frame = frame[0] if is_one(frame) and isinstance(frame, list) else frame
    if isinstance(frame, Mapping):
        held = next((frame[key] for key in _PEOPLE if key in frame), None)
        if isinstance(held, Mapping):
            return [held] if any(key in held for key in _KEYPOINTS) else None
        if isinstance(held, list):
            return held
        return [frame] if held is None and any(key in frame for key in _KEYPOINTS) else None
    if isinstance(frame, list) and all(isinstance(one, Mapping) for one in frame):
        return frame
    return None


def is_one(frame: object) -> bool:
    """Whether a tree is a list of nothing but one frame, as editors of poses write it."""
    return (
        isinstance(frame, list) and len(frame) == 1 and isinstance(frame[0], Mapping) and "people" in frame[0]
    )


def landmarks_of(frame: object) -> list[Any] | None:
    """The joints of a frame of one person, as MediaPipe's messages are, none of nobody; None for another."""
    while isinstance(frame, Mapping):
        key = next((key for key in (*_PEOPLE, *_LANDMARKS) if key in frame), None)
        if key not in _LANDMARKS:
            return None
        frame = frame[key] or []
    if isinstance(frame, list) and all(isinstance(one, Mapping) and {"x", "y"} <= {*one} for one in frame):
        return _by_name(frame)
    return None


def _beside(frame: object) -> Iterator[str]:
    """What a message holds beside the places of the body in the picture."""
    if not (marks := landmarks_of(frame)):
        return
    keys = [key.casefold() for key, value in frame.items() if value] if isinstance(frame, Mapping) else []
    if any("hand" in key or "face" in key for key in keys):
        yield "hands and face beside landmarks of the body are not used"
    if any("z" in mark for mark in marks):
        yield "depth (z) is not used"


def _by_name(marks: list[Any]) -> list[Any] | None:
    """Joints in the order of their body, where they have names; None where these are of no known body."""
    names = [mark.get("name", mark.get("part")) for mark in marks]
    if names.count(None) == len(names):
        return marks
    found = dict(zip(joints_named([*map(str, names)]), marks, strict=True))
    body = BY_COUNT.get(len(marks))
    return [found[joint] for joint in body.joints] if body and found.keys() == {*body.joints} else None


def _joints(person: Mapping[str, Any], number: int, name: str, options: ReadOptions) -> np.ndarray | None:
    """(J, 3) float32 of x, y, score, of the part of the layout that is used; None where there is nobody."""
    key = next((key for key in _KEYPOINTS if key in person), None)
    held = person[key] if key else None
    if isinstance(held, Mapping):  # Ultralytics: lists of x, of y, and of scores
        columns = [held.get("x"), held.get("y"), held.get("visible", held.get("confidence"))]
        if not isinstance(columns[0], list) or not isinstance(columns[1], list):
            raise _refused(f"person {number} has no lists of x and y", name)
        columns[2] = columns[2] if isinstance(columns[2], list) else [1.0] * len(columns[0])
        if len({len(column) for column in columns}) > 1:
            raise _refused(f"person {number} has lists of different lengths", name)
        held = [list(joint) for joint in zip(*columns, strict=True)]
    if not isinstance(held, list):
        raise _refused(f"person {number} has no list 'pose_keypoints_2d' or 'keypoints'", name)
    if not held:
        return None
    scores = next((person[key] for key in SCORES if isinstance(person.get(key), list)), None)
    if isinstance(held[0], list):
        width = len(held[0])
        if width not in (2, 3) or not all(isinstance(joint, list) and len(joint) == width for joint in held):
            raise _refused(f"person {number} has joints of other than two or three values", name)
        count, values = len(held), [value for joint in held for value in joint]
    else:
        width = 2 if scores is not None and len(held) == 2 * len(scores) else 3
        count, values = len(held) // width, held
    used = body_of(count, options) if len(values) == width * count else None
    if used is None:
        raise _refused(
            f"person {number} has {len(values)} values, "
            f"expected three for each of {known_counts(options)} joints",
            name,
        )
    joints = _numbers(values[: used * width], number, name).reshape(used, width)
    if scores is not None:
        if len(scores) != count:
            raise _refused(f"person {number} has {len(scores)} scores for {count} joints", name)
        return np.column_stack([joints[:, :2], _numbers(scores[:used], number, name)])
    if width == 2:
        return np.column_stack([joints, np.ones(used, np.float32)])
    return joints


def _rest(person: Mapping[str, Any], number: int, name: str) -> np.ndarray:
    """(112, 3) of the face and both hands, zero where there are none."""
    parts = []
    for key, count in _REST.items():
        held = person.get(key) or []
        if not isinstance(held, list) or len(held) not in (0, 3 * count):
            raise _refused(f"person {number} has other than {count} joints in {key}", name)
        parts.append(_numbers(held or [0] * (3 * count), number, name).reshape(count, 3))
    return np.concatenate(parts)


def _numbers(values: Sequence[Any], number: int, name: str) -> np.ndarray:
    """Float32 of ``values``; null is NaN, as tables write it."""
    plain = [math.nan if value is None else value for value in values]
    if any(type(value) not in (int, float) for value in plain):
        raise _refused(f"person {number} has a keypoint value that is no number", name, "E_KEYPOINTS_VALUE")
    # Compared in Python: an integer of a thousand digits does not fit a float.
    if any(value > _LARGEST or value < -_LARGEST for value in plain):
        raise _refused(
            f"person {number} has a coordinate beyond {_LARGEST:g}", name, code="E_KEYPOINTS_VALUE"
        )
    return np.array(plain, np.float32)


def _identity(person: Mapping[str, Any]) -> int | None:
    """The number of a tracked person; AlphaPose writes it as a float, or a list of one."""
    held = next((person[key] for key in _IDENTITIES if key in person), None)
    for _ in range(3):
        held = held[0] if isinstance(held, list) and len(held) == 1 else held
    if isinstance(held, bool) or not isinstance(held, int | float) or not 0 <= held < 1e9:
        return None
    return int(held) if held == int(held) else None


def _seen(values: object) -> bool:
    return isinstance(values, list) and any(isinstance(value, int | float) and value > 0 for value in values)


def _refused(cause: str, name: str, code: str = "E_KEYPOINTS_FORMAT") -> KeypointError:
    return KeypointError(cause, subject=name, code=code)
