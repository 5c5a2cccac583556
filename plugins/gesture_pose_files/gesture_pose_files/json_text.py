"""JSON read without trust: its size, its depth and its numbers are limited before anything is made of it."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_pose_files.files import COPY_AGAIN, head_of, open_keypoints

MAX_DEPTH = 24
# Possessive, and the closing quote optional: linear in whatever a hostile file holds.
_HEAD_BYTES = 1 << 20
_IMAGE_FIRST = re.compile(rb'\{\s*"[^"\\]{1,200}\.[A-Za-z]{3,4}"\s*:\s*\{')
_STRING = re.compile(rb'"(?:[^"\\]++|\\.)*+"?', re.DOTALL)


def load(path: Path, max_bytes: int) -> Any:
    """The tree in the JSON file ``path``; NaN, which Python's own writer writes, is taken as it is.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_JSON` (not JSON, too deep), and those of `files.open_keypoints`.
    """
    with open_keypoints(path, max_bytes) as file:
        return _parsed(file.read(max_bytes + 1), printable(path))


def load_head(path: Path) -> Any:
    """The tree of what the JSON file ``path`` begins with, closed behind the last item that is whole.

    Raises
    ------
    KeypointError
        As `load`.
    """
    data = head_of(path, _HEAD_BYTES)
    return _parsed(_closed(data) if len(data) == _HEAD_BYTES else data, printable(path))


def _closed(data: bytes) -> bytes:
    """The beginning of a JSON text up to its last comma that is not deep inside, and what closes it there."""
    codes = np.frombuffer(_STRING.sub(lambda found: b" " * len(found[0]), data), np.uint8)
    steps = _steps(codes)
    commas = np.flatnonzero((codes == 0x2C) & (np.cumsum(steps, dtype=np.int32) <= 2))
    if not len(commas):
        return data
    still_open = bytearray()
    for place in np.flatnonzero(steps[: commas[-1]]):
        if steps[place] > 0:
            still_open.append(codes[place] + 2)  # of both kinds
        elif still_open:
            still_open.pop()
    return data[: commas[-1]] + bytes(reversed(still_open))


def load_lines(path: Path, max_bytes: int, *, head: bool = False) -> list[Any]:
    """The trees in the lines of the file ``path``, those that are blank left out; of its ``head`` alone.

    Raises
    ------
    KeypointError
        As `load`, for the first line that is not JSON.
    """
    if head:
        data = head_of(path, _HEAD_BYTES)
        lines = data.splitlines()[: -1 if len(data) == _HEAD_BYTES else None]
    else:
        with open_keypoints(path, max_bytes) as file:
            lines = file.read(max_bytes + 1).splitlines()
    if lines:
        lines[0] = lines[0].removeprefix(b"\xef\xbb\xbf")
    name = printable(path)
    return [_parsed(line, name, f"line {n} ") for n, line in enumerate(lines, 1) if line.strip()]


def _parsed(data: bytes, name: str, where: str = "") -> Any:
    if _depth(data) > MAX_DEPTH:
        raise KeypointError(
            f"{where}is nested deeper than {MAX_DEPTH} levels", subject=name, code="E_KEYPOINTS_JSON"
        )
    try:
        return json.loads(data, parse_constant=_constant)
    except (ValueError, RecursionError) as error:
        raise KeypointError(
            f"{where}is not JSON: {error}", subject=name, remedy=COPY_AGAIN, code="E_KEYPOINTS_JSON"
        ) from error


def kind_of(path: Path) -> Literal["frame", "list", "other"]:
    """What a JSON file holds, by its first bytes: the people of one frame, or those of a whole clip.

    Raises
    ------
    KeypointError
        As `files.head_of`.
    """
    head = head_of(path, _HEAD_BYTES).lstrip(b"\xef\xbb\xbf \t\r\n")

    def has(*keys: str) -> bool:
        return all(b'"%s"' % key.encode() in head for key in keys)

    people = has("people") or has("bodies")
    if head.startswith(b"["):
        # A clip in which nobody was found is an empty list, but not by the name of a frame.
        nobody = head.strip() in (b"[]", b"[ ]") and not path.name.lower().endswith("_keypoints.json")
        if has("image_id", "keypoints") or has("frame_id", "instances") or nobody:
            return "list"
        one = has("keypoints", "keypoint_scores") or has("keypoints", "class") or has("keypoints", "bbox")
        return "frame" if one else "other"
    if not head.startswith(b"{"):
        return "other"
    if _IMAGE_FIRST.match(head):
        return "list" if people else "other"
    if has("keypoints", "images", "annotations") or has("frame_id", "instances", "instance_info"):
        return "list"
    return "frame" if people or has("instances") or has("instance_info") or has("keypoints") else "other"


def described(path: Path) -> str:
    """What a JSON file begins with, for a message."""
    head = head_of(path, 4096).lstrip(b"\xef\xbb\xbf \t\r\n").decode("utf-8", "replace")
    if not head:
        return "it is empty"
    if head[0] not in "[{":
        return f"it is not JSON, it begins with {head[:20]!r}"
    keys = list(dict.fromkeys(re.findall(r'"([^"\\]{1,40})"\s*:', head)))
    what = "a list" if head[0] == "[" else "an object"
    more = ", …" if keys[6:] else ""
    named = f" with {', '.join(map(repr, keys[:6]))}{more}" if keys else ""
    return f"it is {what}{named}"


def _depth(data: bytes) -> int:
    steps = _steps(np.frombuffer(_STRING.sub(b"", data), np.uint8))
    return int(np.cumsum(steps, dtype=np.int32).max(initial=0))


def _steps(codes: np.ndarray) -> np.ndarray:
    """1 where a bracket opens, -1 where one closes."""
    steps = np.zeros(len(codes), np.int8)
    steps[(codes == 0x5B) | (codes == 0x7B)] = 1
    steps[(codes == 0x5D) | (codes == 0x7D)] = -1
    return steps


def _constant(text: str) -> float:
    if text != "NaN":
        raise ValueError(f"{text} is no JSON value")
    return math.nan
