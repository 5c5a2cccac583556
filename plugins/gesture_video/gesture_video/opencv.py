"""Decoding with OpenCV: the built-in fallback where PyAV is not installed.

OpenCV returns "no more frames" at a damaged packet exactly as at the end, so this reader asks again a
few times, and compares what came with what the header declares where that is plausible.
"""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from gesture_core.errors import MediaError
from gesture_core.records import VideoInfo, VideoLimits
from gesture_core.video import CONTAINERS, UNTIMED, Integrity, VideoDecoder

if TYPE_CHECKING:
    import cv2

# Reads after a refused one before it counts as the end of the file.
_RETRIES = 16
# What marks a picture track in the header of a container, and what marks other tracks.
_PICTURE_TRACKS = {
    "avi": (rb"strh.{4}vids", rb"strh.{4}auds"),
    "asf": (rb"\xc0\xef\x19\xbc\x4d\x5b\xcf\x11", rb"\x40\x9e\x69\xf8\x4d\x5b\xcf\x11"),
    "ogg": (rb"\x80theora|BBCD\0|OVP80", rb"\x01vorbis|OpusHead|\x7fFLAC|Speex   "),
}
_SEARCHED = 4 << 20
# The map of a programme in a transport stream, and the codecs of pictures: ISO 13818-1, section 2.4.4.8.
_MAP = re.compile(rb"\x47[\x40-\x5f].[\x10-\x1f]\0(\x02[\xb0-\xbf].{180})", re.DOTALL)
_PICTURE_TYPES = frozenset(b"\x01\x02\x10\x1b\x20\x24\x33\x42\xd1\xea")
# Pictures among which one differs from the first, if only by noise. What OpenCV cannot convert, as interlaced
# pictures in some releases, it gives as the memory of the picture was.
_MOVED_IN = 8
_REMEDY = "pip install 'gesture-core[video]', whose reader "
_OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"


class OpenCvReader:
    """Decodes with the FFmpeg inside OpenCV. It has no options.

    What it cannot do: keep the aspect of a picture that changes its size half-way (stretched into the
    first size); see pixels that change their shape half-way; choose among several video streams, or see the
    frame rate in a stream without times (it notes both); show interlaced pictures, in some releases, which is
    an error; notice damage, but for frames that are missing from a plausible count.
    """

    def open(self, path: Path, limits: VideoLimits) -> OpenCvDecoder:
        """The video in the file ``path``; errors are those of `PyAvReader.open`."""
        return OpenCvDecoder(path, limits)


class OpenCvDecoder(VideoDecoder):
    """One file that OpenCV decodes."""

    name = "opencv"

    def start(self) -> VideoInfo:
        import cv2

        self._integrity = Integrity(self.file, self.container, self.log)
        self._capture = _capture(self.file, self.path, self.container)
        self.resources.callback(self._capture.release)
        if not self._capture.isOpened():
            raise self._unopened()
        self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        self.check_size(self._get(cv2.CAP_PROP_FRAME_WIDTH), self._get(cv2.CAP_PROP_FRAME_HEIGHT))
        first = self._next()
        if first is None:
            raise self.error("holds a video stream, but not one frame of it decodes", "E_MEDIA_NO_FRAMES")
        self._first = first
        fps = self._get(cv2.CAP_PROP_FPS)
        across, down = int(self._get(cv2.CAP_PROP_SAR_NUM)), int(self._get(cv2.CAP_PROP_SAR_DEN))
        code = int(self._get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        codec = code.to_bytes(4, "little").decode("ascii", "replace").strip("\0 ")
        height, width = first[1].shape[:2]
        # OpenCV turns pictures that are mirrored as if they were not.
        mirrored = self._integrity.mirrored_rotation() if self.container == "mov" else None
        return self.describe(
            width=width,
            height=height,
            codec=codec if codec.isprintable() else "",
            declared=self._integrity.plausible_count(self._get(cv2.CAP_PROP_FRAME_COUNT), fps),
            # Of a stream without times OpenCV knows the demuxer's default only.
            rates=[] if self.container in UNTIMED else [fps],
            rotation=self._get(cv2.CAP_PROP_ORIENTATION_META) if mirrored is None else mirrored,
            mirrored=mirrored is not None,
            pixel_aspect=(across, down) if across > 0 and down > 0 else (1, 1),
        )

    def _unopened(self) -> MediaError:
        """The error for a file that OpenCV, which gives no reasons, does not open."""
        pictures, others = self._tracks()
        if others and not pictures:
            return self.error("holds no video stream", "E_MEDIA_NO_VIDEO", "leave it out")
        return self.error(
            "OpenCV finds no video stream that it can decode",
            "E_MEDIA_BROKEN",
            _REMEDY + "names the cause",
        )

    def _tracks(self) -> tuple[int, int]:
        """Number of picture tracks and of others; where it has no list of them, as far as marks tell."""
        if self.container in ("mov", "matroska"):
            types = self._integrity.track_types()
            return types.count(1), len(types) - types.count(1)
        place = self.file.tell()
        self.file.seek(0)
        searched = self.file.read(_SEARCHED)
        self.file.seek(place)
        if self.container == "mpegts":
            return _programmes(searched)
        marks = _PICTURE_TRACKS.get(self.container, (rb"(?!)", rb"(?!)"))
        pictures, others = (len(re.findall(mark, searched, re.DOTALL)) for mark in marks)
        return pictures, others

    def frames(self) -> Iterator[tuple[float | None, np.ndarray]]:
        import cv2

        several = self._tracks()[0]
        if several > 1:
            self.log.note(
                f"{several} video streams, of which OpenCV reads the first; the reader pyav chooses"
            )
        yield self._first
        still, first = True, self._first[1]
        while (item := self._next()) is not None:
            still = still and np.array_equal(item[1], first)
            yield item
        found = self._integrity.frames
        if several > 1 and found == 1:
            cause = f"the first of its {several} video streams is a picture, and OpenCV cannot read another"
            raise self.error(cause, "E_MEDIA_NO_FRAMES", _REMEDY + "chooses")
        if still and found >= _MOVED_IN:
            cause = f"its {found} pictures are one: nothing moves, or it is interlaced and OpenCV shows none"
            raise self.error(cause, "E_MEDIA_NO_FRAMES", _REMEDY + "shows it")
        # Where the header has no count, OpenCV makes one of its duration and the average rate.
        count, fps = self._get(cv2.CAP_PROP_FRAME_COUNT), self._get(cv2.CAP_PROP_FPS)
        duration = count / fps if 0 < count < 1e9 and fps > 0 else None
        self._integrity.compare_frames(declared=self.info.frames_declared, duration=duration)

    def _next(self) -> tuple[float | None, np.ndarray] | None:
        """The next frame and its stamp in seconds."""
        import cv2

        for attempt in range(_RETRIES):
            try:
                found, frame = self._capture.read()
            except (cv2.error, MemoryError) as error:
                raise self.error(f"cannot be decoded: {error}", "E_MEDIA_BROKEN") from error
            if found and frame is not None:
                if attempt:
                    self.log.damage("packet that OpenCV could not decode")
                self.check_size(frame.shape[1], frame.shape[0])
                self._integrity.frames += 1
                stamp = self._get(cv2.CAP_PROP_POS_MSEC) / 1000
                timed = self.container not in UNTIMED and abs(stamp) < 1e12
                if timed:
                    self._integrity.stamps.append(stamp)
                if frame.ndim == 2:
                    frame = np.repeat(frame[..., None], 3, axis=2)
                return stamp if timed else None, frame[..., :3]
        return None

    def _get(self, prop: int) -> float:
        value = float(self._capture.get(prop))
        return value if math.isfinite(value) else 0.0


def _programmes(searched: bytes) -> tuple[int, int]:
    """Streams of pictures and others that the maps of a transport stream list."""
    streams: dict[tuple[bytes, bytes], bool] = {}
    for section in _MAP.findall(searched):
        end, at = 3 + _twelve(section, 1) - 4, 12 + _twelve(section, 10)
        while at + 5 <= min(end, len(section)):
            streams[section[3:5], section[at + 1 : at + 3]] = section[at] in _PICTURE_TYPES
            at += 5 + _twelve(section, at + 3)
    pictures = sum(streams.values())
    return pictures, len(streams) - pictures


def _twelve(data: bytes, at: int) -> int:
    """The number of twelve bits behind four others."""
    return int.from_bytes(data[at : at + 2], "big") & 0xFFF


def _capture(file: BinaryIO, path: Path, container: str) -> cv2.VideoCapture:
    import cv2

    # By descriptor: OpenCV dies of a file name that is not UTF-8, and FFmpeg reads "a:b" as a protocol.
    if sys.platform.startswith("linux"):
        name = f"/proc/self/fd/{file.fileno()}"
    elif os.name == "posix":
        name = f"/dev/fd/{file.fileno()}"
    else:
        name = str(path.absolute())
    with _restricted(container):
        return cv2.VideoCapture(name, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])


@contextmanager
def _restricted(container: str) -> Iterator[None]:
    """Let FFmpeg inside OpenCV open that container from plain files, and nothing else, silently.

    OpenCV takes FFmpeg's options from the environment only; what the user has set there stays and
    is followed by the restriction. What OpenCV would print becomes an error or a note anyway.
    """
    import cv2

    # The functions moved between releases 4.12 and 4.13.
    logging: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
    level = logging.getLogLevel()
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    before = os.environ.get(_OPTIONS)
    ours = f"input_format;{container}|format_whitelist;{','.join(CONTAINERS)}|protocol_whitelist;file"
    os.environ[_OPTIONS] = f"{before}|{ours}" if before else ours
    logging.setLogLevel(0)
    try:
        yield
    finally:
        logging.setLogLevel(level)
        if before is None:
            del os.environ[_OPTIONS]
        else:
            os.environ[_OPTIONS] = before
