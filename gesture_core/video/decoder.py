"""`VideoDecoder`: what all video readers share, for built-in ones and those of third parties."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import ClassVar, Literal, Self

import numpy as np

from gesture_core.errors import GestureError, MediaError
from gesture_core.files import printable
from gesture_core.plugin.registry import calling
from gesture_core.records import VideoInfo, VideoLimits, VideoReport
from gesture_core.video.containers import UNTIMED, open_container
from gesture_core.video.frames import (
    DEFAULT_FPS,
    Clock,
    LazyPicture,
    fit,
    plausible_aspect,
    square,
    square_size,
    upright,
    variable_rate,
)
from gesture_core.video.integrity import MAX_FPS, DamageLog


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
        width, height = square_size(width, height, *self._pixels)
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
            picture = square(picture, *pixels)
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
        if across != down and not plausible_aspect(across, down):
            self.log.note(f"pixels of {across}:{down} are implausible and taken as square")
        elif across != down:
            self._pixels = across, down
            stored = f"{width} x {height}"
            width, height = square_size(width, height, across, down)
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
        if plausible_aspect(across, down) and (across, down) != self._pixels:
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
