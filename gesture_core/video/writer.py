"""Writes H.264 videos with the frames' own times."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from gesture_core.errors import MediaError
from gesture_core.files import replacing

if TYPE_CHECKING:
    from av import AudioFrame
    from av.audio.stream import AudioStream
    from av.video.stream import VideoStream

_CLOCK = 90_000
"""Ticks in a second of the video, so that real time stamps are kept."""
_COLOURS = {"color_range": 1, "colorspace": 6, "color_primaries": 1, "color_trc": 6}
"""H.264's numbers for limited range, the matrix of BT.601, and the primaries and curve of any screen."""
_SEEKABLE = {"preset": "veryfast", "g": "6", "bf": "0", "threads": "1"}


def can_write_video() -> bool:
    """Whether PyAV, which writes H.264, is installed."""
    return importlib.util.find_spec("av") is not None


class VideoWriter:
    """An H.264 video to be written: a context manager. The file appears once it is complete.

    Parameters
    ----------
    path : path
        ``.mp4``.
    quality : int
        x264's rate factor: 0 without loss, 51 worst.
    sound : iterable of AudioFrame, optional
        Encoded as AAC after the last picture.
    rate : int
        Samples a second of ``sound``.
    seekable : bool
        A key frame every few frames and none that waits for a later one, so that a player can show any frame
        at once; written quickly.

    Raises
    ------
    MediaError
        ``E_MEDIA_WRITE`` where PyAV cannot write it, or there is no frame.
    """

    def __init__(
        self, path: Path, *, quality: int = 23, sound: Iterable[AudioFrame] | None = None,
        rate: int = 48_000, seekable: bool = False,
    ) -> None:  # fmt: skip
        self.count = 0
        self._path, self._sound, self._rate = path, sound, rate
        self._options = {"crf": str(quality)} | (_SEEKABLE if seekable else {})
        self._last = -1
        self._stream: VideoStream | None = None
        self._audio: AudioStream | None = None
        self._resources = ExitStack()

    def __enter__(self) -> Self:
        import av

        with ExitStack() as opened, self._failures():
            part = opened.enter_context(replacing(self._path))
            self._container = opened.enter_context(
                av.open(str(part), "w", format="mp4", options={"movflags": "+faststart"})
            )
            if self._sound is not None:
                self._audio = self._container.add_stream("aac", rate=self._rate)
            self._resources = opened.pop_all()
        return self

    def add(self, time: float, frame: np.ndarray) -> None:
        """Append a frame, (H, W, 3) uint8 in BGR, all of one size, at its second.

        An odd height or width loses its last line: H.264 stores colour for two by two pixels. The colours are
        BT.601 in limited range, and the file says so: players guess otherwise from the height.
        """
        import av
        import cv2

        even = np.ascontiguousarray(frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2])
        with self._failures():
            if self._stream is None:
                self._stream = self._container.add_stream("libx264", rate=30, options=self._options)
                self._stream.height, self._stream.width = even.shape[:2]
                self._stream.pix_fmt = "yuv420p"
                self._stream.time_base = self._stream.codec_context.time_base = Fraction(1, _CLOCK)
                for name, value in _COLOURS.items():
                    setattr(self._stream.codec_context, name, value)
            # FFmpeg's own conversion rounds down, which makes every picture darker.
            planes = np.asarray(cv2.cvtColor(even, cv2.COLOR_BGR2YUV_I420), np.uint8)
            picture = av.VideoFrame.from_ndarray(planes, format="yuv420p")
            self._last = max(self._last + 1, round(time * _CLOCK))
            picture.pts, picture.time_base = self._last, Fraction(1, _CLOCK)
            self._container.mux(self._stream.encode(picture))
        self.count += 1

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> None:
        if kind is not None:
            self._resources.__exit__(kind, *error)
            return
        with self._resources, self._failures():
            if self._stream is None:
                raise MediaError("no frame to write", subject=str(self._path), code="E_MEDIA_WRITE")
            self._container.mux(self._stream.encode(None))
            if self._audio is not None:
                for samples in self._sound or ():
                    self._container.mux(self._audio.encode(samples))
                self._container.mux(self._audio.encode(None))

    @contextmanager
    def _failures(self) -> Iterator[None]:
        import av

        try:
            yield
        except av.FFmpegError as error:
            raise MediaError(
                f"cannot be written as H.264: {error}",
                subject=str(self._path),
                code="E_MEDIA_WRITE",
            ) from error


def write_video(
    frames: Iterable[tuple[float, np.ndarray]], path: Path, *, quality: int = 23, seekable: bool = False
) -> int:
    """Write all of ``frames`` with a `VideoWriter`; their number."""
    with VideoWriter(path, quality=quality, seekable=seekable) as writer:
        for time, frame in frames:
            writer.add(time, frame)
    return writer.count


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
