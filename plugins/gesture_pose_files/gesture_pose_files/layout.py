"""Recognises keypoint arrays by their shape and turns them into sequences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.joints import group_of
from gesture_core.plugin.reading import Axes, ReadOptions, Unit
from gesture_core.skeletons import (
    BLAZEPOSE33,
    BODY25,
    COCO17,
    COCO18,
    HALPE26,
    HANDS42,
    MPI15,
    SKELETONS,
    Skeleton,
    mapped,
    with_parts,
)
from gesture_core.types import PoseSequence
from gesture_pose_files.rivals import check_assumed
from gesture_pose_files.scores import in_unit

BY_COUNT: Mapping[int, Skeleton] = {
    len(kind.joints): kind for kind in (MPI15, COCO17, COCO18, BODY25, HALPE26, BLAZEPOSE33)
}
WHOLE: Mapping[int, Skeleton] = {
    **BY_COUNT,
    **{
        len(SKELETONS[name].joints): SKELETONS[name]
        for name in ("right_hand21", "hands42", "mediapipe75", "coco133", "halpe136", "openpose137",
                     "openpose130", "openpose127", "mediapipe543")
    },
}  # fmt: skip
"""The same where hands or the face are wanted."""
# Width of a flat row -> (joints, values a joint); no two layouts of bodies share a width.
_VALUES = (2, 3, 4)
_FLAT = {joints * values: (joints, values) for joints in BY_COUNT for values in _VALUES}
_WHOLE_FLAT = {joints * values: (joints, values) for joints in WHOLE for values in _VALUES}
NOT_USED = "hands and face are not used (--preset hands uses hands)"
_NOT_USED = {
    ("hands", "face"): NOT_USED,
    ("hands",): "hands are not used (--preset hands uses them)",
    ("face",): "the face is not used (keypoints.parts)",
}
_FORMS = "(T, J, 2|3|4) or (T, 2J|3J|4J) with J of 15, 17, 18, 25, 26 or 33"
# Of shares of width and height: a joint lies at most this far outside the picture, and few lie left of it
# or above it: none in half of MediaPipe's files, 3 % in the worst; 36 % or more where the neck is the origin.
_HANDS_ALONE = ("left_hand21", "right_hand21", "hands42")
_LARGEST_SHARE, _MOSTLY = 5.0, 95
_LARGEST_NEGATIVE = 0.2
_PERCENT = 100.0
# Seconds from frame to frame: a gesture is over before the next frame, or these are no seconds.
_LONGEST_STEP = 1.0
_COARSE = 0.25
"""Seconds between the times of a clock that several frames share, from which on it is none."""


def by_count(options: ReadOptions) -> Mapping[int, Skeleton]:
    """The layouts that are told by the number of their joints, of those that ``options`` want."""
    return WHOLE if options.whole else BY_COUNT


def fits(shape: tuple[int, ...], options: ReadOptions) -> bool:
    """Whether an array of ``shape`` may be a sequence of keypoints."""
    if len(shape) == 3:
        joints = by_count(options) if options.skeleton is None else {len(options.skeleton.joints)}
        return shape[1] in joints and shape[2] in _VALUES
    return len(shape) == 2 and shape[1] in flat_widths(options)


def flat_widths(options: ReadOptions) -> Mapping[int, tuple[int, int]]:
    """(joints, values a joint) by the width of a flat row."""
    if options.skeleton is None:
        return _WHOLE_FLAT if options.whole else _FLAT
    joints = len(options.skeleton.joints)
    return {joints * values: (joints, values) for values in _VALUES}


def sequence(
    array: np.ndarray,
    options: ReadOptions,
    *,
    source: str,
    reader: str,
    scores: np.ndarray | None = None,
    depth: np.ndarray | None = None,
    times: np.ndarray | None = None,
    numbers: np.ndarray | None = None,
    clock: np.ndarray | None = None,
    body: Skeleton | None = None,
    axes: Axes | None = None,
    unit: Unit | None = None,
    frame_size: tuple[int, int] | None = None,
    own: bool = False,
    person: int = 0,
    notes: Sequence[str] = (),
) -> PoseSequence:
    """One sequence from an array of any known layout, in what the file and the options say it is.

    Parameters
    ----------
    array : (T, J, 2|3|4) or (T, 2J|3J|4J) array
        x, y; x, y, score; or x, y, z, score. NaN, a score of zero, or without scores zero in x and y,
        where missing. With 33 joints (MediaPipe) a third value of three is a score only if all of
        them are in 0..1 and not all zero; in metres it is a depth.
    options : ReadOptions
        What counts where the file does not say it.
    source, reader : str
        The input as the user named it, and the plugin that reads it.
    scores : (T, J) array, optional
    depth : (T, J) array, optional
        Third coordinates, where they are not in ``array``.
    times : (T,) array, optional
        Seconds; index over the rate where absent.
    numbers : (T,) array, optional
        Of the frames, where their times are these over the rate.
    clock : array, optional
        The same of all people, who come and go.
    body, axes, frame_size : optional
        What the file itself says of its joints, the order of coordinates, and the picture.
    unit : "pixels", "shares" or "metres", optional
        What the reader found, where it has seen more than this one person; or metres, as the file says.
    own : bool
        A file that this package wrote, or one in its form: pixels, or shares where they look so.
    person : int
    notes : sequence of str
        What the reader left out or put right.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_SHAPE`, `E_KEYPOINTS_VALUE`, `E_KEYPOINTS_EMPTY`, `E_KEYPOINTS_TIMES`.
    """
    array = _three_axes(array, options, body, source)
    if len(array) == 0:
        raise KeypointError("holds no frame", subject=source, code="E_KEYPOINTS_EMPTY")
    joints = body or options.skeleton or by_count(options)[array.shape[1]]
    with np.errstate(over="ignore"):
        values = np.asarray(array, np.float32)
    if np.isinf(values).any():
        raise KeypointError("holds an infinite value", subject=source, code="E_KEYPOINTS_VALUE")
    said = axes or options.axes or "xy"
    points = values[..., 1::-1] if said == "yx" else values[..., :2]
    if options.depth and depth is None:
        depth = _depth(values, scores, joints, options, source)
    if scores is None:
        scores = _scores(values, joints, options)
        if scores is not None:  # -1, -1 with a score of -1
            scores = np.where(_nowhere(points) & (scores < 0), 0, scores)
    if scores is not None:
        scores, note = in_unit(scores, np.where((scores > 0)[..., None], points, np.nan), source)
        notes = [*notes, note] if note else notes
    provenance = {"reader": reader}
    remedy = "a heading that says the unit, such as time_ms, or dividing milliseconds by 1000"
    if times is not None:
        check_clock(times, source, "frames")
    else:
        of_what = "index" if numbers is None else "frame numbers"
        times = (np.arange(len(points)) if numbers is None else numbers) / options.rate
        clock = times if clock is None else clock / options.rate
        remedy = "frame numbers that count frames, or --set keypoints.fps=…"
        provenance["times"] = f"{of_what} at {options.rate:g} frames/s"
    _check_seconds(times if clock is None else clock, source, remedy)
    missing = _missing(points, scores, joints)
    points = np.where(missing[..., None], np.float32(np.nan), points)
    if not (body or options.order):
        check_assumed(points, joints, source)
    if said == "x-y" or (options.axes == "x-y" and not own):  # names of x and y do not say where y points
        points = points * np.array([1, -1], np.float32)
    judged: Unit = "shares" if are_shares(points) else "pixels"
    seen = points[np.isfinite(points)]
    percent = bool(seen.size) and seen.min() >= 0 and _PERCENT / 5 < seen.max() <= _PERCENT
    if percent and options.unit == "shares":
        points, notes = points / np.float32(_PERCENT), [*notes, "shares are percent"]
    elif percent and not (unit or own or options.unit):
        notes = [*notes, "no coordinate is above 100: --set keypoints.unit=shares where they are percent"]
    stated, unit = unit == "metres", unit or (judged if own else options.unit or judged)
    size = frame_size or options.picture if unit == "shares" else None
    if size:
        points = points * np.array(size, np.float32)
        depth = None if depth is None else depth * np.float32(size[0])  # as MediaPipe measures it
        provenance["scaled"] = f"shares of {size[0]} x {size[1]} pixels"
    if unit == "metres":
        provenance["unit"] = unit
        if values.shape[2] > 2 and not options.depth:
            notes = [*notes, "the third coordinate is not used (--preset depth uses it)"]
    provenance["assumed"] = options.assumed(
        order="" if body else joints.name,
        axes="" if axes else said,
        unit="" if stated or (own and unit == "pixels") else unit,
        frame_size=None if frame_size else size,
        fps=options.rate if "times" in provenance else math.nan,
    )
    if scores is None:
        scores = np.ones(points.shape[:2], np.float32)
    if depth is not None:
        points = np.concatenate([points, depth[..., None]], axis=2)
    if joints.name not in SKELETONS or joints.body:
        # Of the file's own choice, or a whole body: what lies beyond the wanted parts is not compared.
        target = with_parts(joints.body or COCO18.name, options.parts)
        notes = [*notes, *_unused(joints, np.asarray(np.isfinite(points[..., 0]).any(axis=0)), options)]
        points, scores = mapped(points, scores, joints, target)
        joints = target
    notes = [*notes, *_not_compared(joints, np.asarray(np.isfinite(points[..., 0]).any(axis=0)))]
    if notes:
        provenance["notes"] = "; ".join(notes)
    return PoseSequence(points, scores, times, joints.name, frame_size, person, source, provenance)


def _unused(joints: Skeleton, seen: np.ndarray, options: ReadOptions) -> list[str]:
    """A clause about hands and a face that are there, (J,) bool, and not wanted."""
    there = {joint for joint, one in zip(joints.joints, seen, strict=True) if one} - {*BLAZEPOSE33.joints}
    kinds = {"hands" if joint in HANDS42.joints else group_of(joint) for joint in there} & {"hands", "face"}
    unused = [kind for kind in ("hands", "face") if kind in kinds - {*options.parts}]
    return [_NOT_USED[tuple(unused)]] if unused else []


def _not_compared(joints: Skeleton, seen: np.ndarray) -> list[str]:
    """A clause about feet and a spine that are there, (J,) bool: no normalizer has them."""
    there = {joint for joint, one in zip(joints.joints, seen, strict=False) if one} - {"mid_hip"}
    parts = sorted({"feet", "spine"} & set(map(group_of, there)))
    return [f"{' and '.join(parts)}: read and not compared"] if parts else []


def check_clock(times: np.ndarray, source: str, what: str) -> None:
    """Refuse times that stand still, or go on by whole seconds only: E_KEYPOINTS_TIMES."""
    different = np.unique(times[np.isfinite(times)])
    coarse = (
        len(different) == 1 or float(np.median(np.diff(different))) > _COARSE if len(different) else False
    )
    if len(times) > 2 * len(different) and coarse:
        raise KeypointError(
            f"its {len(times)} {what} share {len(different)} time{'s'[len(different) == 1 :]}: "
            "a clock that stands still, or of whole seconds",
            subject=source,
            remedy="finer times, or none and --set keypoints.fps=…",
            code="E_KEYPOINTS_TIMES",
        )


def _check_seconds(times: np.ndarray, source: str, remedy: str) -> None:
    """Refuse times, in any order, that can be no seconds: E_KEYPOINTS_TIMES."""
    given = np.asarray(times, np.float64)
    steps = np.diff(np.unique(given[np.isfinite(given)]))
    usual = float(np.median(steps)) if len(steps) else 0.0
    if usual > _LONGEST_STEP:
        raise KeypointError(
            f"its frames are {usual:g} s apart, which shows no movement; times are in seconds",
            subject=source,
            remedy=remedy,
            code="E_KEYPOINTS_TIMES",
        )


def skeleton_called(name: str, source: str) -> Skeleton:
    """The skeleton that a file names; E_KEYPOINTS_SKELETON for an unknown one."""
    if name not in SKELETONS:
        raise KeypointError(
            f"names the skeleton {name!r}, which is unknown",
            subject=source,
            remedy=f"one of {', '.join(SKELETONS)}",
            code="E_KEYPOINTS_SKELETON",
        )
    return SKELETONS[name]


def _three_axes(array: np.ndarray, options: ReadOptions, body: Skeleton | None, source: str) -> np.ndarray:
    if (
        body
        and array.ndim == 3
        and array.shape[1:] == (len(body.joints), array.shape[2])
        and 2 <= array.shape[2] <= 4
    ):
        return array
    if not fits(array.shape, options):
        order = options.skeleton
        wanted = _FORMS if order is None else f"(T, {len(order.joints)}, 2|3|4), as keypoints.order says"
        named = [name for name, one in SKELETONS.items() if array.shape[1:2] == (len(one.joints),)]
        raise KeypointError(
            f"an array of shape {array.shape} is of no known keypoint layout",
            subject=source,
            remedy=f"{wanted}, or --set keypoints.order={' or '.join(named) or '…'} with its joints",
            code="E_KEYPOINTS_SHAPE",
        )
    return array if array.ndim == 3 else array.reshape(len(array), *flat_widths(options)[array.shape[1]])


def _depth(
    values: np.ndarray, scores: np.ndarray | None, body: Skeleton, options: ReadOptions, source: str
) -> np.ndarray:
    """(T, J) third coordinate: the third of four values, or of three of which none is a score.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_SHAPE` where there is none.
    """
    if values.shape[2] == 4 or (
        values.shape[2] == 3 and (scores is not None or _scores(values, body, options) is None)
    ):
        return values[..., 2]
    raise KeypointError(
        "has no third coordinate that is kept",
        subject=source,
        remedy="arrays of x, y, z (--set keypoints.unit=metres) or of x, y, z, score; columns nose_z, …; or "
        "--set keypoints.depth=false with another preset",
        code="E_KEYPOINTS_SHAPE",
    )


def _scores(values: np.ndarray, body: Skeleton, options: ReadOptions) -> np.ndarray | None:
    """The last value of each joint, where it is one of three or four and no depth."""
    if values.shape[2] == 2 or (values.shape[2] == 3 and options.unit == "metres"):
        return None
    last = values[..., -1]
    low, high = (float(np.nanmin(last)), float(np.nanmax(last))) if not np.isnan(last).all() else (0.0, 0.0)
    landmarks = body is BLAZEPOSE33 or body.name.startswith("mediapipe") or body.name in _HANDS_ALONE
    if landmarks and values.shape[2] == 3 and not (low >= 0 and 0 < high <= 1):
        return None  # x, y, z without visibility
    # Of eyes and mouth a body has its own, unless there is a face.
    own = () if body.body and body.group("face")[6:] else BLAZEPOSE33.joints
    rest = [
        n
        for n, j in enumerate(body.joints)
        if j in HANDS42.joints or (group_of(j) == "face" and j not in own)
    ]
    if landmarks and rest and not (last[:, rest] > 0).any():  # MediaPipe has none of hands and face
        last = last.copy()
        last[:, rest] = (values[:, rest, :2] != 0).any(axis=2)
    return last


def _missing(points: np.ndarray, scores: np.ndarray | None, body: Skeleton) -> np.ndarray:
    """(T, J) bool: joints that were not found.

    A score of 0 means missing, wherever x and y are, and so does a negative number in their place. Without
    scores, x and y of 0 do, unless they are centred on the neck: then the neck is at 0, 0 in every frame,
    others may fall on it, and, as in no picture, some coordinates are negative. A frame of nothing but
    zeros is empty either way.
    """
    zero: np.ndarray = (points == 0).all(axis=2)
    nowhere = _nowhere(points)
    if scores is not None:
        missing: np.ndarray = (scores <= 0) | (zero & np.isnan(scores)) | nowhere
        return missing
    zero |= nowhere
    empty = np.asarray(zero.all(axis=1))
    if "neck" in body.joints and not empty.all():
        at_neck = np.asarray(zero[~empty, body.index("neck")])
        if at_neck.all() and (points < 0).any():
            return np.repeat(empty[:, None], zero.shape[1], axis=1)
    return zero


def _nowhere(points: np.ndarray) -> np.ndarray:
    """(T, J) bool: at one negative number in x and y, as -1 or -9999, where nothing else is negative."""
    out: np.ndarray = np.zeros(points.shape[:2], bool)
    below = points < 0
    if below.any():
        value = points[below].min()
        same: np.ndarray = (points == value).all(axis=2)
        if not (below & ~same[..., None]).any() and value == np.round(value):
            return same
    return out


def are_shares(points: np.ndarray, *, centred: bool = False) -> bool:
    """Whether coordinates, NaN where missing, are shares of a picture's width and height, not pixels.

    Shares lie in 0..1, and a little outside for joints beyond the picture's edge; what lies around zero is
    some body's own unit, unless ``centred`` says that the shares may be those from the picture's middle.
    """
    seen = points[np.isfinite(points)]
    if not seen.size or not (centred or float((seen < 0).mean()) <= _LARGEST_NEGATIVE):
        return False
    usual, largest = np.percentile(np.abs(seen), (50, _MOSTLY))  # a few wrong values decide nothing
    return bool(usual <= 1.0 and largest <= _LARGEST_SHARE)
