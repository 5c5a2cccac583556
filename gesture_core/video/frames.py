"""From a stored picture with the container's stamp to an upright frame of constant size at its second, with
square pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.errors import MediaError
from gesture_core.plugin.abilities import LazyFrames
from gesture_core.video.integrity import DamageLog

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import Video

DEFAULT_FPS = 25.0
"""Frames a second where nothing tells."""
_LEAP = 3600.0
_EARLY = 0.1
"""Of the time between two looks: how much too early a frame may come, as containers round their stamps."""

Picture = tuple[float, Callable[[], np.ndarray | None]]
"""The second of a frame, and what gives its pixels, or None where they cannot be converted."""


@dataclass(frozen=True)
class LazyPicture:
    """A decoded picture whose pixels are converted only if somebody looks at them.

    Attributes
    ----------
    width, height : int
        Pixels of the stored picture.
    convert : callable
        Gives (height, width, 3) uint8 in BGR, or None where it fails, which is then in the log.
    """

    width: int
    height: int
    convert: Callable[[], np.ndarray | None]


# No camera or disc has pixels that are longer than this: a broken header has.
_LONGEST_PIXEL = 8
# Intervals between frames of a variable rate: the long ones last so much longer than the short ones. Rounding
# to milliseconds, and a frame that was dropped now and then, make no variable rate.
_VARIABLE = 1.5


class Clock:
    """Turns the container's stamps into seconds that never decrease.

    A stamp that runs backwards, or an hour ahead, starts a new stretch, one frame after the last: what
    follows keeps its pace. An absent stamp is one frame after the last.

    Parameters
    ----------
    fps : float or None
        Frames a second for frames without a stamp; 25 where it is not known, which the log records.
    log : DamageLog
        Where repairs are noted.
    """

    def __init__(self, fps: float | None, log: DamageLog) -> None:
        self._step = 1 / (fps or DEFAULT_FPS)
        self._rate = f"{fps or DEFAULT_FPS:g} frames/s{'' if fps else ' assumed'}"
        self._log = log
        self._offset = 0.0
        self._last: float | None = None

    def at(self, stamp: float | None) -> float:
        """Seconds of the next frame, whose stamp is ``stamp`` seconds or None."""
        following = 0.0 if self._last is None else self._last + self._step
        if stamp is None or not math.isfinite(stamp):
            self._log.note(f"frame without a time stamp, placed at {self._rate}")
            time = following
        else:
            time = stamp + self._offset
            before = 0.0 if self._last is None else self._last
            if time - before > _LEAP:
                self._log.damage("time stamp more than an hour after the last")
            elif self._last is not None and time < self._last:
                self._log.note("time stamps run backwards, continued from the last")
            else:
                self._last = time
                return time
            self._offset += following - time
            time = following
        self._last = time
        return time


def plausible_aspect(across: int, down: int) -> bool:
    """Whether pixels may be ``across`` wide and ``down`` high."""
    return across > 0 and down > 0 and 1 / _LONGEST_PIXEL <= across / down <= _LONGEST_PIXEL


def square_size(width: int, height: int, across: int, down: int) -> tuple[int, int]:
    """Size of a picture whose pixels are ``across`` to ``down``, once they are square.

    The shorter side of the pixels is stretched, as players do, so that nothing that was filmed is lost.
    """
    if across > down:
        return max(1, round(width * across / down)), height
    return width, max(1, round(height * down / across))


def square(frame: np.ndarray, across: int, down: int) -> np.ndarray:
    """Stretch ``frame`` (H, W, 3), whose pixels are ``across`` to ``down``, so that they are square."""
    import cv2

    size = square_size(frame.shape[1], frame.shape[0], across, down)
    return cv2.resize(frame, size, interpolation=cv2.INTER_LINEAR)


def variable_rate(times: Sequence[float]) -> str:
    """What to note of a video whose frame rate is variable; empty where it is constant."""
    intervals = np.diff(times)
    if len(intervals) < 2:
        return ""
    short, long = np.quantile(intervals, (0.1, 0.9))
    if long <= _VARIABLE * max(short, 1e-6):
        return ""
    most = f"{1 / short:.0f}" if short > 1e-6 else "more"
    return f"variable frame rate, {1 / long:.0f} to {most} frames/s; times are those of the file"


def upright(frame: np.ndarray, rotation: int, mirrored: bool = False) -> np.ndarray:
    """Turn ``frame`` (H, W, 3) clockwise by ``rotation`` degrees (0, 90, 180, 270), then mirror it."""
    turned = frame if rotation == 0 else np.rot90(frame, k=-rotation // 90)
    if mirrored:
        turned = turned[:, ::-1]
    return np.ascontiguousarray(turned)


def fit(frame: np.ndarray, width: int, height: int) -> np.ndarray:
    """Scale ``frame`` into ``width`` x ``height`` pixels, keeping its aspect, on black.

    A recording may change its size half-way (a call that loses bandwidth, a phone that is turned).
    Coordinates of joints must not jump then, nor bodies change their shape.
    """
    import cv2

    scale = min(width / frame.shape[1], height / frame.shape[0])
    inner_width = min(width, max(1, round(frame.shape[1] * scale)))
    inner_height = min(height, max(1, round(frame.shape[0] * scale)))
    left, top = (width - inner_width) // 2, (height - inner_height) // 2
    out = np.zeros((height, width, 3), np.uint8)
    out[top : top + inner_height, left : left + inner_width] = cv2.resize(
        frame, (inner_width, inner_height), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    )
    return out


def room_around(boxes: Sequence[Sequence[float]], margin: float = 0.15) -> tuple[slice, slice]:
    """The part of a frame in which all ``boxes`` lie: left, top, right and bottom of each, in pixels.

    On each side there is ``margin`` more, as a share of the longer side of that place.
    """
    edges = np.array(boxes)
    low, high = edges[:, :2].min(axis=0), edges[:, 2:].max(axis=0)
    room = margin * float((high - low).max())
    left, top = np.maximum(low - room, 0).astype(int).tolist()
    right, bottom = np.ceil(high + room + 1).astype(int).tolist()
    return slice(top, bottom), slice(left, right)


def pictures(video: Video) -> Iterator[Picture]:
    """The frames of a video, converted only where somebody asks if it can do so (`LazyFrames`)."""
    if isinstance(video, LazyFrames):
        yield from video.pictures()
        return
    for time, frame in video:
        yield time, partial(_same, frame)


def _same(frame: np.ndarray) -> np.ndarray:
    return frame


def at_rate(pictures: Iterable[Picture], rate: float | None) -> Iterator[tuple[float, np.ndarray]]:
    """The frames that are looked at: the first of each stretch of 1/``rate`` seconds, by their time stamps.

    A video that has no more than ``rate`` frames a second has all of them. Where its own rate is a multiple
    of ``rate``, or far above it, they are evenly spaced.

    Parameters
    ----------
    pictures : iterable of (seconds, convert)
        From `pictures`.
    rate : float or None
        Frames a second; with None or 0, every frame.

    Raises
    ------
    MediaError
        ``E_MEDIA_BROKEN`` for a time that is no number, or earlier than the one before.
    """
    first, stretch, before = None, -1, -np.inf
    for time, convert in pictures:
        if not before <= time < np.inf:
            raise MediaError(
                f"its reader gives a frame the time {time} after {before}",
                remedy="another --set pose.reader=…, or --set video.fps=RATE",
                code="E_MEDIA_BROKEN",
            )
        before = time
        first = time if first is None else first
        here = int((time - first) * rate + _EARLY) if rate else stretch + 1
        if here > stretch and (frame := convert()) is not None:
            stretch = here
            yield time, frame
