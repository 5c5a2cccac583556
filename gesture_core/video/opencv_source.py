"""Decoding with OpenCV: the built-in fallback where PyAV is not installed.

OpenCV says "no more frames" at a damaged packet exactly as at the end, so this reader asks again a
few times, and compares what came with what the header promised where the promise is believable.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, BinaryIO

import numpy as np

from gesture_core.errors import MediaError
from gesture_core.video.elements import read_blocks
from gesture_core.video.fragments import picture_tracks, read_chain
from gesture_core.video.info import SQUARE, MediaInfo
from gesture_core.video.limits import MAX_FPS
from gesture_core.video.sniff import CONTAINERS
from gesture_core.video.source import AGAIN, Source
from gesture_core.video.upright import quarter_turns

# Reads after a refused one before it counts as the end of the file.
_RETRIES = 16
# Containers with a table of samples; elsewhere OpenCV's frame count is duration times average rate.
_COUNTED = frozenset({"mov", "avi", "gif"})
# Containers whose header holds a duration that is worth something.
_TIMED = frozenset({"matroska", "flv"})
# Seconds by which sound commonly outlasts the picture.
_OVERHANG = 0.25
_MIN_BYTES_PER_FRAME = 8
# What marks a picture track in the header of a container, and what marks other tracks.
_PICTURE_TRACKS = {"mov": (b"vide", b"soun subt text"), "matroska": (b"V_", b"A_ S_")}
_SEARCHED = 4 << 20
# Streams without a container have no time stamps; OpenCV says 0 of each frame.
_UNTIMED = frozenset({"h264", "hevc", "mpegvideo", "mjpeg"})
_OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"


class OpenCvSource(Source):
    """The frames of one open file through OpenCV.

    Parameters are those of `Source`, errors those of `PyAvSource`. What this reader cannot do: see
    mirrored display matrices; keep the aspect of a picture that changes its size half-way (OpenCV
    stretches it into the first size); tell damage, but for frames that are missing from a believable
    count.
    """

    name = "opencv"

    def _start(self) -> MediaInfo:
        self._size = os.fstat(self._file.fileno()).st_size
        self._count = 0
        self._stamps: list[float] = []
        self._tracks = picture_tracks(self._file) if self._format == "mov" else {}
        self._capture = _capture(self._file, self._path)
        self._opened.callback(self._capture.release)
        if not self._capture.isOpened():
            raise self._unopened()
        self._first = self._open()
        return self._describe(self._first[1])

    def _open(self) -> tuple[float | None, np.ndarray]:
        import cv2

        self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        self._check_size(self._get(cv2.CAP_PROP_FRAME_WIDTH), self._get(cv2.CAP_PROP_FRAME_HEIGHT))
        first = self._next()
        if first is None:
            raise self._no_frame()
        return first

    def _unopened(self) -> MediaError:
        """OpenCV does not say why it fails; a container that names no picture track is told apart here."""
        mark, kinds = _PICTURE_TRACKS.get(self._format, (b"", b""))
        head = os.pread(self._file.fileno(), _SEARCHED, 0) if hasattr(os, "pread") else b""
        tail = os.pread(self._file.fileno(), _SEARCHED, max(0, self._size - _SEARCHED)) if head else b""
        if mark and mark not in head + tail and any(kind in head + tail for kind in kinds.split()):
            return self._error("holds no video stream", "E_MEDIA_NO_VIDEO", "leave it out")
        return self._error(
            "OpenCV finds no video stream that it can decode",
            "E_MEDIA_BROKEN",
            "pip install 'gesture-core[video]', whose reader names the cause",
        )

    def _describe(self, first: np.ndarray) -> MediaInfo:
        import cv2

        rotation = quarter_turns(self._get(cv2.CAP_PROP_ORIENTATION_META))
        across, down = self._get(cv2.CAP_PROP_SAR_NUM), self._get(cv2.CAP_PROP_SAR_DEN)
        if across > 0 and down > 0 and across != down:
            self._ledger.note(SQUARE.format(int(across), int(down)))
        height, width = first.shape[:2]
        if rotation % 180:
            width, height = height, width
        fps = self._get(cv2.CAP_PROP_FPS)
        return MediaInfo(
            width=width,
            height=height,
            frames_declared=self._declared(),
            fps=fps if 0 < fps <= MAX_FPS else None,
            rotation=rotation,
            codec=_fourcc(self._get(cv2.CAP_PROP_FOURCC)),
            container=self._format,
            reader=self.name,
        )

    def _declared(self) -> int | None:
        """The header's frame count where there is one and rate and file size make it believable."""
        import cv2

        count, fps = self._get(cv2.CAP_PROP_FRAME_COUNT), self._get(cv2.CAP_PROP_FPS)
        believable = (
            self._format in _COUNTED
            and (self._format != "mov" or any(self._tracks.values()))
            and 0 < count <= self._limits.max_frames
            and 0 < fps <= MAX_FPS
            and count * _MIN_BYTES_PER_FRAME <= self._size
        )
        return int(count) if believable else None

    def _duration(self) -> float | None:
        """Seconds that the header promises; OpenCV tells them only as frames at the average rate."""
        import cv2

        count, fps = self._get(cv2.CAP_PROP_FRAME_COUNT), self._get(cv2.CAP_PROP_FPS)
        return count / fps if self._format in _TIMED and 0 < count < 1e9 and fps > 0 else None

    def __iter__(self) -> Iterator[tuple[float | None, np.ndarray]]:
        yield self._first
        while (item := self._next()) is not None:
            self._count += 1
            yield item
        self._settle(self._count + 1)

    def _next(self) -> tuple[float | None, np.ndarray] | None:
        import cv2

        for attempt in range(_RETRIES):
            try:
                found, frame = self._capture.read()
            except (cv2.error, MemoryError) as error:
                raise self._error(f"cannot be decoded: {error}", "E_MEDIA_BROKEN", AGAIN) from error
            if found and frame is not None:
                if attempt:
                    self._ledger.damage("packet that OpenCV could not decode")
                self._check_size(frame.shape[1], frame.shape[0])
                return self._stamp(), _three_channels(frame)
        return None

    def _stamp(self) -> float | None:
        import cv2

        seconds = self._get(cv2.CAP_PROP_POS_MSEC) / 1000
        if self._format in _UNTIMED or abs(seconds) >= 1e12:
            return None
        self._stamps.append(seconds)
        return seconds

    def _settle(self, count: int) -> None:
        declared, duration = self.info.frames_declared, self._duration()
        if self._format == "mov":
            chain = read_chain(self._file)
            if chain.fault:
                self._ledger.damage(f"broken chain of fragments: {chain.fault}")
            if chain.samples and self._tracks:
                track, own = next(iter(self._tracks.items()))
                declared = own + chain.samples.get(track, 0)
        if self._format == "matroska" and (fault := read_blocks(self._file).fault):
            self._ledger.damage(f"broken chain of elements: {fault}")
        if declared is not None:
            absent = declared - count
            if absent > 0:
                self._ledger.damage(
                    f"{absent} of {declared} declared frames did not come: lost, or cut by an edit list",
                    absent,
                )
        elif duration is not None and len(self._stamps) > 1:
            step = float(np.median(np.diff(self._stamps)))
            end = max(self._stamps) + step
            # Sound may run on after the picture.
            if duration - end > max(2 * step, 0.05 * duration, _OVERHANG):
                self._ledger.damage(f"ends at {end:.2f} of {duration:.2f} declared seconds")
        else:
            self._ledger.note(
                "the header promises nothing believable; this reader cannot tell whether frames are lost"
            )

    def _get(self, prop: int) -> float:
        value = float(self._capture.get(prop))
        return value if np.isfinite(value) else 0.0


def _capture(file: BinaryIO, path: str | os.PathLike[str]) -> Any:
    import cv2

    # By descriptor: OpenCV dies of a file name that is not UTF-8, and FFmpeg reads "a:b" as a protocol.
    if sys.platform.startswith("linux"):
        name = f"/proc/self/fd/{file.fileno()}"
    elif os.name == "posix":
        name = f"/dev/fd/{file.fileno()}"
    else:
        name = os.path.abspath(os.fsdecode(path))  # noqa: PTH100 - the file need not be resolved
    with _silent(), _restricted():
        return cv2.VideoCapture(name, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])


@contextmanager
def _silent() -> Iterator[None]:
    """Keep OpenCV from printing what becomes an error or a note anyway."""
    import cv2

    # The functions moved between releases 4.12 and 4.13.
    place: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
    level = place.getLogLevel()
    place.setLogLevel(0)
    try:
        yield
    finally:
        place.setLogLevel(level)


@contextmanager
def _restricted() -> Iterator[None]:
    """Let FFmpeg inside OpenCV open the listed containers from plain files, and nothing else.

    OpenCV takes FFmpeg's options from the environment only; what the user has set there stays and
    is followed by the restriction.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    before = os.environ.get(_OPTIONS)
    demuxers = ",".join(CONTAINERS)
    ours = f"format_whitelist;{demuxers}|protocol_whitelist;file"
    os.environ[_OPTIONS] = f"{before}|{ours}" if before else ours
    try:
        yield
    finally:
        if before is None:
            del os.environ[_OPTIONS]
        else:
            os.environ[_OPTIONS] = before


def _fourcc(value: float) -> str:
    code = int(value) & 0xFFFFFFFF
    text = code.to_bytes(4, "little").decode("ascii", "replace").strip("\0 ")
    return text if text.isprintable() else ""


def _three_channels(frame: np.ndarray) -> np.ndarray:
    if frame.ndim == 2:
        return np.repeat(frame[..., None], 3, axis=2)
    return frame[..., :3]
