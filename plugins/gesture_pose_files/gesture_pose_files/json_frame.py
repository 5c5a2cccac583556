"""One frame of OpenPose's JSON, read without trust.

The format is that of OpenPose's ``--write_json`` (versions 0.1 to 1.3): ``people[].pose_keypoints_2d``
(``pose_keypoints`` before 1.1) holds x, y, score for each joint, the score zero where it was not found;
x and y are then zero too, unless ``--keypoint_scale 4`` moved them to -1.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.interfaces import Person
from gesture_core.skeletons import BODY25, COCO18, MPI15
from gesture_pose_files.files import COPY_AGAIN, MAX_JSON_BYTES, open_keypoints

MAX_DEPTH = 24
# Possessive, and the closing quote optional: linear in whatever a hostile file holds.
_STRING = re.compile(rb'"(?:[^"\\]++|\\.)*+"?', re.DOTALL)
_OPENPOSE = {len(kind.joints): kind for kind in (COCO18, BODY25, MPI15)}
_LARGEST = 1e7


def read_frame(path: Path) -> tuple[list[Person], str | None]:
    """The people in one frame and their skeleton's name, None where there is nobody.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_JSON` (not JSON, too deep), `E_KEYPOINTS_FORMAT` (JSON of another kind),
        `E_KEYPOINTS_VALUE`, and those of `files.open_keypoints`.
    """
    name = printable(path)
    with open_keypoints(path, MAX_JSON_BYTES) as file:
        data = file.read(MAX_JSON_BYTES + 1)
    return people_in(parse(data, name), name)


def parse(data: bytes, name: str) -> Any:
    """JSON from ``data``, with a limit on its depth; NaN and Infinity are no JSON."""
    if _depth(data) > MAX_DEPTH:
        raise KeypointError(
            f"is nested deeper than {MAX_DEPTH} levels", subject=name, code="E_KEYPOINTS_JSON"
        )
    try:
        return json.loads(data, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise KeypointError(
            f"is not JSON: {error}", subject=name, remedy=COPY_AGAIN, code="E_KEYPOINTS_JSON"
        ) from error


def people_in(frame: Any, name: str) -> tuple[list[Person], str | None]:
    """The people in a parsed frame; see `read_frame`."""
    people = frame.get("people") if isinstance(frame, dict) else None
    if not isinstance(people, list):
        raise KeypointError(
            "holds no list 'people', it is not OpenPose's", subject=name, code="E_KEYPOINTS_FORMAT"
        )
    found: list[Person] = []
    kinds: set[str] = set()
    for number, person in enumerate(people):
        values = _values(person, number, name)
        if not values:
            continue
        kind = _OPENPOSE.get(len(values) // 3) if len(values) % 3 == 0 else None
        if kind is None:
            raise KeypointError(
                f"person {number} has {len(values)} values, expected three for each of 15, 18 or 25 joints",
                subject=name,
                code="E_KEYPOINTS_FORMAT",
            )
        kinds.add(kind.name)
        joints = _joints(values, number, name)
        missing = joints[:, 2] <= 0
        if not missing.all():
            points = np.where(missing[:, None], np.float32(np.nan), joints[:, :2])
            found.append(Person(points, np.clip(joints[:, 2], 0, 1)))
    if len(kinds) > 1:
        raise KeypointError(
            f"mixes skeletons: {', '.join(sorted(kinds))}", subject=name, code="E_KEYPOINTS_FORMAT"
        )
    return found, kinds.pop() if kinds else None


def _values(person: Any, number: int, name: str) -> list[Any]:
    if isinstance(person, dict):
        values = person.get("pose_keypoints_2d", person.get("pose_keypoints"))
        if isinstance(values, list):
            return values
    raise KeypointError(
        f"person {number} has no list 'pose_keypoints_2d'", subject=name, code="E_KEYPOINTS_FORMAT"
    )


def _joints(values: list[Any], number: int, name: str) -> np.ndarray:
    if any(type(value) not in (int, float) for value in values):
        raise KeypointError(
            f"person {number} has a keypoint value that is no number", subject=name, code="E_KEYPOINTS_VALUE"
        )
    # Compared in Python: an integer of a thousand digits does not fit a float.
    if not all(-_LARGEST <= value <= _LARGEST for value in values):
        raise KeypointError(
            f"person {number} has a coordinate beyond {_LARGEST:g}", subject=name, code="E_KEYPOINTS_VALUE"
        )
    return np.array(values, np.float32).reshape(-1, 3)


def _depth(data: bytes) -> int:
    codes = np.frombuffer(_STRING.sub(b"", data), np.uint8)
    steps = np.zeros(len(codes), np.int8)
    steps[(codes == 0x5B) | (codes == 0x7B)] = 1
    steps[(codes == 0x5D) | (codes == 0x7D)] = -1
    return int(np.cumsum(steps, dtype=np.int32).max(initial=0))


def _no_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is no JSON value")
