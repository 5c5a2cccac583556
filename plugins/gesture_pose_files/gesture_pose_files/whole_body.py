"""Layouts of body, hands and face together: which joints are the body, their order where all are used."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import MEDIAPIPE543, MEDIAPIPE543_FACE, OPENPOSE137, OPENPOSE137_HANDS, Skeleton
from gesture_pose_files.layout import NOT_USED, by_count, fits

BODY_OF: Mapping[int, int] = {127: 15, 130: 18, 133: 17, 136: 26, 137: 25}
"""Joints of COCO-WholeBody, Halpe and OpenPose (body, face and hands in one list), and those of the body."""

_HOLISTIC = 543
# Where MediaPipe's 33 joints lie among 543: before the face and the hands, or after the face and a hand.
_PLACES = (slice(0, 33), slice(489, 522))
_WITH_HANDS = 75
_VALUES = (2, 3, 4)
_PARTS = (*BODY_OF, _HOLISTIC, _WITH_HANDS)
_FLAT = {joints * values: (joints, values) for joints in _PARTS for values in _VALUES}
# Of MediaPipe's x, y, z, visibility, then x, y, z of hands and perhaps of the face before them.
_LANDMARKS = (1662, 258)
_MAX_PEOPLE = 32
_BOTH_HANDS = (2, 21)


def body_of(joints: int, options: ReadOptions) -> int | None:
    """How many of the first joints in a layout of ``joints`` are the body; None for no known layout."""
    if options.skeleton and len(options.skeleton.joints) == joints:
        return joints
    used = joints if options.whole else BODY_OF.get(joints, joints)
    return used if used in by_count(options) else None


def known_counts(options: ReadOptions) -> str:
    """The numbers of joints that are known, in words."""
    own = [len(options.skeleton.joints)] if options.skeleton else []
    counts = sorted({*by_count(options), *BODY_OF, *own})
    return ", ".join(map(str, counts[:-1])) + f" or {counts[-1]}"


def is_known(shape: tuple[int, ...], options: ReadOptions) -> bool:
    """Whether an array of ``shape`` may be keypoints of one or several people, of the whole body or not."""
    shape = _without_ones(shape)
    if options.whole and len(shape) == 4 and shape[1:3] == _BOTH_HANDS:
        return True
    if len(shape) == 4:
        shape = (max(shape[:2]), *shape[2:])
    if fits(shape, options):
        return True
    if len(shape) == 2:
        return shape[1] in _FLAT or shape[1] in _LANDMARKS
    return len(shape) == 3 and shape[1] in _PARTS and shape[2] in _VALUES


def is_one_frame(shape: tuple[int, ...], options: ReadOptions) -> bool:
    """Whether an array of ``shape`` holds the joints of one frame, and no sequence."""
    return len(shape) in (1, 2) and not is_known(shape, options) and is_known((2, *shape), options)


def is_one_person(shape: tuple[int, ...]) -> bool:
    """Whether an array of ``shape`` is one frame with an axis for its only person, (1, J, 2|3|4)."""
    return len(shape) == 3 and shape[0] == 1 and shape[2] in _VALUES


def people_in(
    array: np.ndarray, options: ReadOptions, source: str
) -> tuple[list[np.ndarray], tuple[str, ...]]:
    """The part of ``array`` that is the body, for each person; and what was left out.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_SHAPE` where an array of four axes does not tell people from frames, and where the body
        is not found among 543 joints.
    """
    array = array.reshape(_without_ones(array.shape))
    if options.whole and array.shape[1:3] == _BOTH_HANDS:
        array = array.reshape(len(array), -1, array.shape[3])
    if array.ndim != 4:
        body, notes = _body(array, options, source)
        return [body], notes
    axis = int(array.shape[1] < array.shape[0])
    if array.shape[0] == array.shape[1] or not 0 < array.shape[axis] <= _MAX_PEOPLE:
        raise KeypointError(
            f"an array of shape {array.shape} does not tell people from frames",
            subject=source,
            remedy="(T, J, 2 or 3) for each person",
            code="E_KEYPOINTS_SHAPE",
        )
    found = [_body(one, options, source) for one in np.moveaxis(array, axis, 0)]
    return [body for body, _ in found], found[0][1]


def _without_ones(shape: tuple[int, ...]) -> tuple[int, ...]:
    """``shape`` without axes of one; the first axis, the frames, is the last to go."""
    kept = list(shape)
    while len(kept) > 3 and 1 in kept[1:]:
        del kept[1 + kept[1:].index(1)]
    while len(kept) >= 3 and kept[0] == 1 and (len(kept) > 3 or kept[2] not in _VALUES):
        del kept[0]
    return tuple(kept)


def _body(array: np.ndarray, options: ReadOptions, source: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """The body in a whole body of one person; all of it, in its skeleton's order, where more is wanted."""
    if options.whole and options.skeleton is None and array.ndim in (2, 3):
        return _whole(array, source), ()
    if fits(array.shape, options) or array.ndim not in (2, 3):
        return array, ()
    if array.ndim == 2 and array.shape[1] in _LANDMARKS:
        return array[:, :132].reshape(-1, 33, 4), (NOT_USED,)
    if array.ndim == 2 and array.shape[1] in _FLAT:
        array = array.reshape(len(array), *_FLAT[array.shape[1]])
    if array.ndim != 3 or array.shape[2] not in _VALUES or array.shape[1] not in _PARTS:
        return array, ()
    joints = array.shape[1]
    if joints == _HOLISTIC:
        where = _holistic(array, source)
    else:
        where = slice(0, 33) if joints == _WITH_HANDS else slice(0, BODY_OF[joints])
    return array[:, where], (NOT_USED,)


def _whole(array: np.ndarray, source: str) -> np.ndarray:
    """Body, face and hands of one person in one order, whichever the file has them in."""
    if array.ndim == 2 and array.shape[1] in _LANDMARKS:
        body, rest = array[:, :132].reshape(-1, 33, 4), array[:, 132:].reshape(len(array), -1, 3)
        there = (rest[..., :2] != 0).any(axis=2, keepdims=True)
        return np.concatenate([body, np.concatenate([rest, there], axis=2)], axis=1)
    if array.ndim == 2 and array.shape[1] in _FLAT:
        array = array.reshape(len(array), *_FLAT[array.shape[1]])
    if array.ndim == 3 and array.shape[1] == _HOLISTIC and _holistic(array, source) is _PLACES[1]:
        return array[:, _order(MEDIAPIPE543_FACE, MEDIAPIPE543)]
    if array.ndim == 3 and array.shape[1] == len(OPENPOSE137.joints):
        order = min((OPENPOSE137, OPENPOSE137_HANDS), key=lambda one: _hands_off(array, one))
        return array[:, _order(order, OPENPOSE137)]
    return array


def _order(given: Skeleton, wanted: Skeleton) -> list[int]:
    return [given.index(joint) for joint in wanted.joints]


def _hands_off(array: np.ndarray, layout: Skeleton) -> float:
    """How far hands are from their arms, read as ``layout``."""
    away = [np.inf]
    for side in ("left", "right"):
        pair = array[:, [layout.index(f"{side}_{joint}") for joint in ("wrist", "hand_wrist")], :2]
        seen = (pair != 0).any(axis=2).all(axis=1) & np.isfinite(pair).all(axis=(1, 2))
        away += (
            [float(np.median(np.linalg.norm(pair[seen, 0] - pair[seen, 1], axis=1)))] if seen.any() else []
        )
    return min(away)


def _holistic(array: np.ndarray, source: str) -> slice:
    """Where the body is among 543 joints: the order differs, and a body is larger than a face or a hand."""
    heights = []
    for place in _PLACES:
        y = np.asarray(array[:, place, 1], np.float64)
        y = np.where((array[:, place, :2] == 0).all(axis=2), np.nan, y)
        y = y[~np.isnan(y).all(axis=1)]
        heights.append(float(np.median(np.nanmax(y, axis=1) - np.nanmin(y, axis=1))) if len(y) else 0.0)
    small, large = sorted(heights)
    if not large > 1.5 * small:
        raise KeypointError(
            "has 543 joints, of which neither the first 33 nor those from 489 are clearly a body",
            subject=source,
            remedy="the 33 joints of the body alone",
            code="E_KEYPOINTS_SHAPE",
        )
    return _PLACES[heights.index(large)]
