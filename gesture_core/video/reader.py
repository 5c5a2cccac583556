"""Opening a video: one small interface over PyAV and OpenCV."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
from collections.abc import Iterator
from types import TracebackType
from typing import TYPE_CHECKING, BinaryIO, Literal, Protocol

from gesture_core.errors import ConfigError, MediaError, MissingDependencyError
from gesture_core.video.clock import Clock
from gesture_core.video.info import Ledger, MediaInfo, MediaReport
from gesture_core.video.limits import Limits
from gesture_core.video.sniff import container_of, open_file, printable

if TYPE_CHECKING:
    import numpy as np

ReaderName = Literal["auto", "pyav", "opencv"]
_PYAV = 15
READERS: tuple[str, ...] = ("auto", "pyav", "opencv")


class FrameSource(Protocol):
    """What a decoder brings: stored frames with the container's stamps, damage told to a `Ledger`."""

    info: MediaInfo

    def __iter__(self) -> Iterator[tuple[float | None, np.ndarray]]: ...

    def close(self) -> None: ...


class VideoReader:
    """The frames of one video, upright, at real times. A context manager; iterate it once.

    Iterating yields ``(time, frame)``: seconds from the start of the stream, never decreasing, and
    (H, W, 3) uint8 in BGR. Every frame has the size that `info` states: where a stream changes its
    size half-way, later frames are scaled into the first size, and the report says so.

    Attributes
    ----------
    info : MediaInfo
        Known as soon as the reader is open.
    report : MediaReport
        What was read so far; after the last frame, whether that was all.
    """

    def __init__(
        self, file: BinaryIO, source: FrameSource, subject: str, limits: Limits, ledger: Ledger
    ) -> None:
        self._file = file
        self._source = source
        self._subject = subject
        self._limits = limits
        self._ledger = ledger
        self._read = 0
        self._state: Literal["new", "running", "ended"] = "new"
        self.info = source.info

    @property
    def report(self) -> MediaReport:
        """The account of what was read so far."""
        notes = self._ledger.clauses()
        if self._state != "ended":
            notes += ("not read to its end",)
        return MediaReport(
            frames_declared=self.info.frames_declared,
            frames_read=self._read,
            damaged=self._ledger.damaged,
            complete=self._state == "ended" and self._ledger.damaged == 0,
            notes=notes,
            reader=self.info.reader,
        )

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        if self._state != "new":
            raise MediaError("its reader was already used", subject=self._subject, remedy="open it again")
        self._state = "running"
        from gesture_core.video.upright import fit, upright

        info = self.info
        clock = Clock(info.fps, self._ledger)
        for stamp, stored in self._source:
            time = clock.at(stamp)
            self._check_limits(time)
            frame = upright(stored, info.rotation, info.mirrored)
            if frame.shape[:2] != (info.height, info.width):
                self._ledger.note(
                    f"picture of {frame.shape[1]} x {frame.shape[0]} scaled into {info.width} x {info.height}"
                )
                frame = fit(frame, info.width, info.height)
            self._read += 1
            yield time, frame
        self._state = "ended"

    def _check_limits(self, time: float) -> None:
        limits = self._limits
        if self._read >= limits.max_frames:
            cause = f"holds more than {limits.max_frames} frames"
            remedy = "--set limits.frames=… with a larger figure, or cut the video"
        elif time > limits.max_seconds:
            cause = f"is longer than {limits.max_seconds:g} s"
            remedy = "cut the video, or from Python a larger Limits.max_seconds"
        else:
            return
        raise MediaError(
            cause,
            subject=self._subject,
            kept=f"{self._read} frames",
            remedy=remedy,
            code="E_MEDIA_LIMIT",
        )

    def close(self) -> None:
        """Release the decoder and the file."""
        self._source.close()
        self._file.close()

    def __enter__(self) -> VideoReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_video(
    path: str | os.PathLike[str], reader: str = "auto", limits: Limits | None = None
) -> VideoReader:
    """Open a video for reading.

    Parameters
    ----------
    path : path
        Any file name, of any bytes. The first frame is decoded here, so that a file that holds none
        fails here.
    reader : {"auto", "pyav", "opencv"}
        `auto` takes PyAV where it is installed and OpenCV elsewhere; `info.reader` says which. PyAV counts
        damage; OpenCV can only compare the number of frames with a header that is believable.
    limits : Limits, optional

    Raises
    ------
    MediaError
        `E_MEDIA_MISSING`, `E_MEDIA_UNREADABLE`, `E_MEDIA_EMPTY`, `E_MEDIA_FORMAT` (no container of the
        list, a playlist), `E_MEDIA_BROKEN`, `E_MEDIA_NO_VIDEO`, `E_MEDIA_NO_FRAMES`, `E_MEDIA_CODEC`,
        `E_MEDIA_LIMIT`.
    MissingDependencyError
        Where ``reader="pyav"`` and PyAV is not installed.
    ConfigError
        Where `reader` is no reader.
    """
    limits = limits or Limits()
    chosen = reader_name(reader)
    file = open_file(path)
    try:
        container = container_of(file, path)
        ledger = Ledger()
        source: FrameSource
        if chosen == "pyav":
            from gesture_core.video.pyav_source import PyAvSource

            source = PyAvSource(file, path, container, limits, ledger)
        else:
            from gesture_core.video.opencv_source import OpenCvSource

            source = OpenCvSource(file, path, container, limits, ledger)
        return VideoReader(file, source, printable(path), limits, ledger)
    except BaseException:
        file.close()
        raise


def probe(path: str | os.PathLike[str], reader: str = "auto", limits: Limits | None = None) -> MediaInfo:
    """What the container says of a video; decodes one frame. Errors are those of `open_video`."""
    with open_video(path, reader, limits) as video:
        return video.info


def reader_name(reader: str) -> str:
    """The reader that ``reader`` stands for on this machine: ``pyav`` or ``opencv``."""
    if reader not in READERS:
        raise ConfigError(f"no reader {reader!r}", remedy=f"one of {', '.join(READERS)}", code="E_OPTION")
    lacking = _pyav_lacks()
    if reader == "pyav" and lacking:
        raise MissingDependencyError(f"reader 'pyav' needs {lacking}: pip install 'gesture-core[video]'")
    if reader == "auto":
        return "opencv" if lacking else "pyav"
    return reader


def _pyav_lacks() -> str:
    """What keeps PyAV from being used here; empty where nothing does."""
    if importlib.util.find_spec("av") is None:
        return "av"
    try:
        found = importlib.metadata.version("av")
    except importlib.metadata.PackageNotFoundError:  # built from source, and then recent
        return ""
    major = found.partition(".")[0]
    return f"av {_PYAV} or later, {found} is here," if major.isdigit() and int(major) < _PYAV else ""
