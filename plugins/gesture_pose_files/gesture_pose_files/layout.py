"""Recognises keypoint arrays by their shape and turns them into sequences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.skeletons import BLAZEPOSE33, BODY25, COCO17, COCO18, MPI15, SKELETONS, Skeleton
from gesture_core.types import PoseSequence

BY_COUNT: Mapping[int, Skeleton] = {
    len(kind.joints): kind for kind in (MPI15, COCO17, COCO18, BODY25, BLAZEPOSE33)
}
# Width of a flat row -> (joints, values a joint); no two layouts share a width.
_FLAT = {joints * values: (joints, values) for joints in BY_COUNT for values in (2, 3, 4)}
FLAT_WIDTHS = frozenset(_FLAT)
_FORMS = "(T, J, 2|3|4) or (T, 2J|3J|4J) with J of 15, 17, 18, 25 or 33"
# MediaPipe's x and y are shares of width and height; a joint lies at most this far outside the picture.
_LARGEST_SHARE = 5.0
# Seconds from frame to frame: a gesture is over before the next frame, or these are no seconds.
_LONGEST_STEP = 1.0


@dataclass(frozen=True)
class Units:
    """What a file does not say: frames a second, and the picture that MediaPipe's shares are of."""

    fps: float = 30.0
    frame_size: tuple[int, int] = (640, 480)


def fits(shape: tuple[int, ...]) -> bool:
    """Whether an array of ``shape`` may be a sequence of keypoints."""
    if len(shape) == 3:
        return shape[1] in BY_COUNT and shape[2] in (2, 3, 4)
    return len(shape) == 2 and shape[1] in _FLAT


def sequence(
    array: np.ndarray,
    units: Units,
    *,
    source: str,
    reader: str,
    scores: np.ndarray | None = None,
    times: np.ndarray | None = None,
    numbers: np.ndarray | None = None,
    kind: str | None = None,
    frame_size: tuple[int, int] | None = None,
    person: int = 0,
) -> PoseSequence:
    """One sequence from an array of any known layout.

    Parameters
    ----------
    array : (T, J, 2|3|4) or (T, 2J|3J|4J) array
        x, y; x, y, score; or x, y, z, score. NaN, a score of zero, or without scores zero in x and y,
        where missing. With 33 joints (MediaPipe) a third value of three is a score only if all of
        them are in 0..1 and not all zero.
    units : Units
    source, reader : str
        The input as the user named it, and the plugin that reads it.
    scores : (T, J) array, optional
    times : (T,) array, optional
        Seconds; index over `units.fps` where absent.
    numbers : (T,) array, optional
        Of the frames, where their times are these over `units.fps`.
    kind : str, optional
        Name of the skeleton; by the number of joints where absent.
    frame_size : (width, height), optional
    person : int

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_SHAPE`, `E_KEYPOINTS_VALUE`, `E_KEYPOINTS_EMPTY`, `E_KEYPOINTS_TIMES`,
        `E_KEYPOINTS_SKELETON`.
    """
    array = _three_axes(array, source)
    if len(array) == 0:
        raise KeypointError("holds no frame", subject=source, code="E_KEYPOINTS_EMPTY")
    body = _body(kind, source) if kind else BY_COUNT[array.shape[1]]
    with np.errstate(over="ignore"):
        values = np.asarray(array, np.float32)
    if np.isinf(values).any():
        raise KeypointError("holds an infinite value", subject=source, code="E_KEYPOINTS_VALUE")
    points = values[..., :2]
    if scores is None:
        scores = _scores(values, body, source)
    provenance = {"reader": reader}
    assumed = []
    if times is None:
        of_what = "index" if numbers is None else "frame numbers"
        times = (np.arange(len(points)) if numbers is None else numbers) / units.fps
        provenance["times"] = f"{of_what} at {units.fps:g} frames/s"
        assumed.append(assumed_rate(units.fps))
    missing = _missing(points, scores, body)
    points = np.where(missing[..., None], np.float32(np.nan), points)
    if body is BLAZEPOSE33 and are_shares(points):
        size = frame_size or units.frame_size
        points = points * np.array(size, np.float32)
        provenance["scaled"] = f"shares of {size[0]} x {size[1]} pixels"
        if frame_size is None:
            assumed.append(assumed_picture(size))
    if assumed:
        provenance["assumed"] = ", ".join(assumed)
    return PoseSequence(
        points,
        np.ones(points.shape[:2], np.float32) if scores is None else scores,
        times,
        body.name,
        frame_size,
        person,
        source,
        provenance,
    )


def assumed_rate(fps: float) -> str:
    """What the provenance says of a file without times."""
    return f"{fps:g} frames/s (pose.fps)"


def assumed_picture(size: tuple[int, int]) -> str:
    """What the provenance says of shares of a picture whose size the file does not state."""
    return f"a picture of {size[0]} x {size[1]} (frame_size)"


def check_seconds(times: np.ndarray, source: str, *, remedy: str = "dividing milliseconds by 1000") -> None:
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


def _body(kind: str, source: str) -> Skeleton:
    if kind not in SKELETONS:
        raise KeypointError(
            f"names the skeleton {kind!r}, which is unknown",
            subject=source,
            remedy=f"one of {', '.join(SKELETONS)}",
            code="E_KEYPOINTS_SKELETON",
        )
    return SKELETONS[kind]


def _three_axes(array: np.ndarray, source: str) -> np.ndarray:
    if not fits(array.shape):
        raise KeypointError(
            f"an array of shape {array.shape} is of no known keypoint layout",
            subject=source,
            remedy=_FORMS,
            code="E_KEYPOINTS_SHAPE",
        )
    return array if array.ndim == 3 else array.reshape(len(array), *_FLAT[array.shape[1]])


def _scores(values: np.ndarray, body: Skeleton, source: str) -> np.ndarray | None:
    if values.shape[2] == 2:
        return None
    last = values[..., -1]
    low, high = (float(np.nanmin(last)), float(np.nanmax(last))) if not np.isnan(last).all() else (0.0, 0.0)
    plausible = low >= -0.01 and high <= 1.5
    if body is BLAZEPOSE33 and values.shape[2] == 3 and not (low >= 0 and 0 < high <= 1):
        return None  # x, y, z without visibility
    if not plausible:
        raise KeypointError(
            f"the last value of each joint runs from {low:g} to {high:g}, which is no score",
            subject=source,
            remedy="x, y and a score in 0..1",
            code="E_KEYPOINTS_VALUE",
        )
    return last


def _missing(points: np.ndarray, scores: np.ndarray | None, body: Skeleton) -> np.ndarray:
    """(T, J) bool: joints that were not found.

    A score of 0 means missing, wherever x and y are. Without scores, x and y of 0 do, unless they are
    centred on the neck: then the neck is at 0, 0 in every frame, others may fall on it, and, as in
    no picture, some coordinates are negative. A frame of nothing but zeros is empty either way.
    """
    zero: np.ndarray = (points == 0).all(axis=2)
    if scores is not None:
        missing: np.ndarray = (scores <= 0) | (zero & np.isnan(scores))
        return missing
    empty = np.asarray(zero.all(axis=1))
    if "neck" in body.joints and not empty.all():
        at_neck = np.asarray(zero[~empty, body.index("neck")])
        if at_neck.all() and (points < 0).any():
            return np.repeat(empty[:, None], zero.shape[1], axis=1)
    return zero


def are_shares(points: np.ndarray) -> bool:
    """Whether coordinates, NaN where missing, are shares of a picture's width and height, not pixels."""
    seen = np.abs(points[np.isfinite(points)])
    return bool(seen.size) and float(np.median(seen)) <= 1.0 and float(seen.max()) <= _LARGEST_SHARE
