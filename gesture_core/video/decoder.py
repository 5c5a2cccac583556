"""`VideoDecoder`: what all video readers share, for built-in ones and those of third parties."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar, Literal, Self

import numpy as np

from gesture_core.errors import GestureError, MediaError
from gesture_core.files import printable
from gesture_core.plugin.registry import calling
from gesture_core.records import VideoInfo, VideoLimits, VideoReport
from gesture_core.video.containers import UNTIMED, open_container
from gesture_core.video.integrity import MAX_FPS, DamageLog

DEFAULT_FPS = 25.0
"""Frames a second where nothing tells."""
_LEAP = 3600.0
# No camera or disc has pixels that are longer than this: a broken header has.
_LONGEST_PIXEL = 8
# Intervals between frames of a variable rate: the long ones last so much longer than the short ones. Rounding
# to milliseconds, and a frame that was dropped now and then, make none. Seconds without one that are said.
_VARIABLE, _PAUSE = 1.5, 1.0


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


class VideoDecoder(ABC):
    """One open video file. A context manager; iterate it once.

    A reader's own class has a name and two methods, `start` and `frames`. Times that run backwards, pictures
    that lie on their side or change their size, pixels that are not square, limits on frames and seconds, and
    the report are handled here.

    ::

        class GrabberReader:  # registered with register_video_readers
            def open(self, path, limits):
                return GrabberVideo(path, limits)

        class GrabberVideo(VideoDecoder):
            name = "grabber"

            def start(self):
                self._clip = self.resources.enter_context(grabber.open(self.file))
                return self.describe(width=self._clip.width, height=self._clip.height, codec="h264")

            def frames(self):
                for picture in self._clip:
                    yield picture.seconds, picture.bgr

    Attributes
    ----------
    name : str
        Under which the reader is registered.
    path, limits
        As given; ``subject`` is the path as errors print it.
    file : binary file
        Open for reading, unbuffered, at its start.
    container : str
        FFmpeg's name of its container, one of `CONTAINERS`; other files get an error before `start`.
    log : DamageLog
        Receives damage and notes.
    resources : ExitStack
        Takes what must be released, as soon as it is there; closed however far the video was opened.
    info : VideoInfo
        What `start` returned.
    """

    name: ClassVar[str]

    def __init__(self, path: Path, limits: VideoLimits) -> None:
        self.path = path
        self.subject = printable(path)
        self.limits = limits
        self.log = DamageLog()
        self.resources = ExitStack()
        self._pixels = (1, 1)
        self._read = 0
        self._state: Literal["new", "running", "ended"] = "new"
        try:
            self.file, self.container = open_container(path)
            self.resources.callback(self.file.close)
            self.info = self.start()
        except BaseException:
            self.resources.close()
            raise

    @abstractmethod
    def start(self) -> VideoInfo:
        """Open the decoder, decode the first frame, describe the video (with `describe`)."""

    @abstractmethod
    def frames(self) -> Iterator[tuple[float | None, np.ndarray | LazyPicture]]:
        """The container's stamp, in seconds from its first one, or None, and the picture as it is stored:
        (H, W, 3) uint8 in BGR, or a `LazyPicture` where converting costs time. What is lost goes to ``log``.
        """

    @property
    def report(self) -> VideoReport:
        """What was read so far, and what of it was damaged."""
        notes = [f"{note} ({n} times)" if n > 1 else note for note, n in self.log.notes.items()]
        if self._state != "ended":
            notes.append("not read to its end")
        return VideoReport(
            frames_declared=self.info.frames_declared,
            frames_read=self._read,
            damaged=self.log.damaged,
            complete=self._state == "ended" and self.log.damaged == 0,
            notes=tuple(notes),
            reader=self.name,
            assumed=self._assumed,
        )

    @property
    def _assumed(self) -> str:
        """The frame rate of a stream without times, which its codec may or may not say."""
        if self.container not in UNTIMED:
            return ""
        says = ", as its codec says" if self.info.fps else ""
        return f"{self.info.fps or DEFAULT_FPS:g} frames/s{says} (video.fps)"

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        for time, convert in self.pictures():
            frame = convert()
            if frame is not None:
                yield time, frame

    def pictures(self) -> Iterator[tuple[float, Callable[[], np.ndarray | None]]]:
        """Every frame with its second, converted only where it is called: see `LazyFrames`."""
        if self._state != "new":
            raise MediaError("its reader was already used", subject=self.subject, remedy="open it again")
        self._state = "running"
        info, limits = self.info, self.limits
        clock, times = Clock(info.fps, self.log), list[float]()
        with self._blamed():
            for stamp, stored in self.frames():
                # What a demuxer makes up for a stream without times is a constant rate as well.
                untimed = self.container in UNTIMED
                time = clock.at(len(times) / (info.fps or DEFAULT_FPS) if untimed else stamp)
                times.append(time)
                kept = f"{self._read} frames"
                if self._read >= limits.max_frames:
                    remedy = "--set limits.frames=… with a larger figure, or cut the video"
                    cause = f"holds more than {limits.max_frames} frames"
                    raise self.error(cause, "E_MEDIA_LIMIT", remedy, kept)
                if time > limits.max_seconds:
                    remedy = "cut the video, or from Python a larger VideoLimits.max_seconds"
                    raise self.error(
                        f"is longer than {limits.max_seconds:g} s", "E_MEDIA_LIMIT", remedy, kept
                    )
                self._note_size(stored)
                self._read += 1
                yield time, partial(self._converted, stored, self._pixels)
        if note := variable_rate(times):
            self.log.note(note)
        self._state = "ended"

    def _note_size(self, stored: np.ndarray | LazyPicture) -> None:
        """Note a picture of another size than the first; one that exceeds the limit is an error."""
        info = self.info
        if isinstance(stored, LazyPicture):
            width, height = stored.width, stored.height
        else:
            height, width = stored.shape[:2]
        width, height = _square_size(width, height, *self._pixels)
        self.check_size(width, height)
        if info.rotation % 180:
            width, height = height, width
        if (width, height) != (info.width, info.height):
            self.log.note(f"picture of {width} x {height} scaled into {info.width} x {info.height}")

    def _converted(self, stored: np.ndarray | LazyPicture, pixels: tuple[int, int]) -> np.ndarray | None:
        """A stored picture upright, square and of the video's size, None where it cannot be converted."""
        info = self.info
        with self._blamed():
            picture = stored.convert() if isinstance(stored, LazyPicture) else stored
        if picture is None:
            self._read -= 1
            return None
        if pixels[0] != pixels[1]:
            import cv2

            stretched = _square_size(picture.shape[1], picture.shape[0], *pixels)
            picture = cv2.resize(picture, stretched, interpolation=cv2.INTER_LINEAR)
        frame = upright(picture, info.rotation, info.mirrored)
        same = frame.shape[:2] == (info.height, info.width)
        return frame if same else fit(frame, info.width, info.height)

    @contextmanager
    def _blamed(self) -> Iterator[None]:
        """Errors of a reader's own code, but for those that it is meant to raise, as errors of the plugin."""
        try:
            yield
        except (GestureError, OSError):
            raise
        except Exception:
            with calling(self):  # only now, as it reports each call to whoever watches this process
                raise

    def describe(
        self,
        *,
        width: int,
        height: int,
        codec: str,
        declared: int | None = None,
        rates: Sequence[float] = (),
        rotation: float = 0.0,
        mirrored: bool = False,
        pixel_aspect: tuple[int, int] = (1, 1),
    ) -> VideoInfo:
        """A `VideoInfo` from what the decoder knows of the stored pictures, without implausible figures.

        Parameters
        ----------
        width, height : int
            Pixels of the stored picture.
        declared : int, optional
            Frames that the header claims.
        rates : sequence of float
            What may be the frames a second, the best figure first.
        codec, rotation, mirrored
            As in `VideoInfo`; any rotation counts as the nearest quarter turn.
        pixel_aspect : (int, int)
            Width to height of one pixel. What no camera has is taken as square, which the log says.
        """
        across, down = pixel_aspect
        if across != down and not _plausible(across, down):
            self.log.note(f"pixels of {across}:{down} are implausible and taken as square")
        elif across != down and _square_size(width, height, across, down) != (width, height):
            self._pixels = across, down
            stored = f"{width} x {height}"
            width, height = _square_size(width, height, across, down)
            self.check_size(width, height)
            self.log.note(f"pixels of {across}:{down} made square: {stored} shown as {width} x {height}")
        turned = round(rotation / 90) % 4 * 90
        if turned % 180:
            width, height = height, width
        return VideoInfo(
            width=width,
            height=height,
            frames_declared=declared if declared and 0 < declared <= self.limits.max_frames else None,
            fps=next((rate for rate in rates if 0 < rate <= MAX_FPS), None),
            rotation=turned,
            codec=codec,
            container=self.container,
            reader=self.name,
            mirrored=mirrored,
        )

    def change_pixels(self, across: int, down: int) -> None:
        """Take the pixels of what follows as ``across`` to ``down``, for a reader that sees them change."""
        if _plausible(across, down) and (across, down) != self._pixels:
            self._pixels = across, down
            self.log.note(f"pixels become {across}:{down} half-way, made square")

    def check_size(self, width: float, height: float) -> None:
        """A MediaError where a picture of ``width`` x ``height`` pixels exceeds the limit.

        To be asked before memory is allocated for it.
        """
        if width * height > self.limits.max_pixels:
            cause = (
                f"its frames of {width:g} x {height:g} pixels exceed the limit of {self.limits.max_pixels}"
            )
            raise self.error(cause, "E_MEDIA_LIMIT", "--set limits.pixels=… with a larger figure")

    def error(
        self, cause: str, code: str, remedy: str = "copy it again from where it came", kept: str = ""
    ) -> MediaError:
        """A MediaError about this file; the remedy is that for damaged files unless another one is given."""
        return MediaError(cause, subject=self.subject, kept=kept, remedy=remedy, code=code)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.resources.close()


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


def variable_rate(times: Sequence[float]) -> str:
    """What to note of a video whose frame rate is variable; empty where it is constant."""
    intervals = np.diff(times)
    if len(intervals) < 2:
        return ""
    short, long = np.quantile(intervals, (0.1, 0.9))
    widest = int(np.argmax(intervals))
    if intervals[widest] > max(_PAUSE, _VARIABLE * long):
        return f"no frame for {intervals[widest]:.1f} s after {times[widest]:.1f} s, by the file's times"
    if long <= _VARIABLE * max(short, 1e-6):
        return ""
    most = f"{1 / short:.0f}" if short > 1e-6 else "more"
    return f"variable frame rate, {1 / long:.0f} to {most} frames/s; times are those of the file"


def _plausible(across: int, down: int) -> bool:
    """Whether pixels may be ``across`` wide and ``down`` high."""
    return across > 0 and down > 0 and 1 / _LONGEST_PIXEL <= across / down <= _LONGEST_PIXEL


def _square_size(width: int, height: int, across: int, down: int) -> tuple[int, int]:
    """Size of a picture whose pixels are ``across`` to ``down``, once they are square.

    The shorter side of the pixels is stretched, as players do, so that nothing that was filmed is lost.
    """
    if across > down:
        return max(1, round(width * across / down)), height
    return width, max(1, round(height * down / across))


def upright(frame: np.ndarray, rotation: int, mirrored: bool = False) -> np.ndarray:
    """Turn ``frame`` (H, W, 3) clockwise by ``rotation`` degrees (0, 90, 180, 270), then mirror it."""
    turned = frame if rotation == 0 else np.rot90(frame, k=-rotation // 90)
    return np.ascontiguousarray(turned[:, ::-1] if mirrored else turned)


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
