"""Decoding with PyAV: real time stamps, rotation and mirroring, and a full account of damage.

What counts as damage: packets that the demuxer marks corrupt, errors that the demuxer or the decoder
raises or logs, frames that the decoder marks as concealed, packets that the sample table declares and
the file lacks, and packets from which no frame came.
"""

from __future__ import annotations

import errno
import importlib.metadata
import math
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, cast

import numpy as np

from gesture_core.errors import GestureError, MediaError, MissingDependencyError
from gesture_core.plugin.interfaces import VideoInfo, VideoLimits
from gesture_core.video import DamageLog, Integrity, LazyPicture, VideoDecoder

if TYPE_CHECKING:
    from av.packet import Packet
    from av.sidedata.sidedata import SideDataContainer
    from av.video.codeccontext import VideoCodecContext
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

_OLDEST = 15
# A demuxer that fails this often in a row has lost its place for good.
_MAX_DEMUX_ERRORS = 32
_MAX_MESSAGE = 200


class PyAvReader:
    """Decodes with FFmpeg through PyAV, and counts what is damaged or lost. It has no options.

    Raises
    ------
    MissingDependencyError
        Where PyAV is too old.
    """

    def __init__(self) -> None:
        try:
            found = importlib.metadata.version("av")
        except importlib.metadata.PackageNotFoundError:  # built from source, and then recent
            return
        major = found.partition(".")[0]
        if major.isdigit() and int(major) < _OLDEST:
            raise MissingDependencyError(
                f"video reader 'pyav' needs av {_OLDEST} or later, {found} is here: "
                f"pip install 'av>={_OLDEST}'"
            )

    def open(self, path: Path, limits: VideoLimits) -> PyAvDecoder:
        """The video in the file ``path``.

        Raises
        ------
        MediaError
            `E_MEDIA_BROKEN`, `E_MEDIA_NO_VIDEO`, `E_MEDIA_CODEC`, `E_MEDIA_NO_FRAMES`, `E_MEDIA_LIMIT`,
            `E_MEDIA_MEMORY`, `E_MEDIA_UNREADABLE` where the disk fails half-way, and those of
            `gesture_core.video.open_video` for files that are no video at all.
        """
        return PyAvDecoder(path, limits)


class PyAvDecoder(VideoDecoder):
    """One file that PyAV decodes."""

    name = "pyav"

    def start(self) -> VideoInfo:
        self._integrity = Integrity(self.file, self.container, self.log)
        self._decoder_log = DecoderLog(self.error, self.log)
        self.resources.enter_context(_errors_are_logged())
        self._open()
        stream = self._stream
        self._origin = stream.start_time or 0
        decoded = self._decode()
        first = next(decoded, None)
        if first is None:
            raise self.error("holds a video stream, but not one frame of it decodes", "E_MEDIA_NO_FRAMES")
        self._decoded = chain((first,), decoded)
        frame = first[1]
        rotation, mirrored = _orientation(frame)
        ratio = self._context.sample_aspect_ratio
        return self.describe(
            width=frame.width,
            height=frame.height,
            codec=stream.codec_context.codec.canonical_name,
            declared=stream.frames or _tagged_frames(stream.metadata),
            rates=[float(rate or 0) for rate in (stream.average_rate, stream.guessed_rate)],
            rotation=rotation,
            mirrored=mirrored,
            pixel_aspect=(ratio.numerator, ratio.denominator) if ratio else (1, 1),
        )

    def _open(self) -> None:
        """Open container and decoder, with what they may cost, and choose the stream of pictures."""
        import av
        from av.video.reformatter import VideoReformatter

        with self._decoder_log.call(fatal=True):
            self._container = av.open(
                self.file,
                "r",
                format=self.container,
                metadata_errors="replace",
                io_open=_refuse,
                container_options={"max_streams": str(self.limits.max_streams)},
            )
            self.resources.callback(self._container.close)
            stream = self._container.streams.best("video")
        streams = self._container.streams
        if not len(streams):
            raise self.error("its container holds no stream at all", "E_MEDIA_BROKEN")
        if stream is None or stream.disposition & av.stream.Disposition.attached_pic:
            kinds = sorted({stream.type for stream in streams})
            raise self.error(
                f"holds no video stream ({', '.join(kinds)})", "E_MEDIA_NO_VIDEO", "leave it out"
            )
        context = stream.codec_context
        if context is None:
            raise self.error("no decoder for its codec", "E_MEDIA_CODEC", "re-encode it")
        others = {s.codec_context.name for s in streams if s is not stream and s.codec_context is not None}
        self._decoder_log.ignore(others - {context.name})
        self._stream, self._context = stream, cast("VideoCodecContext", context)
        self.check_size(self._context.width, self._context.height)
        # One converter for all frames: a new one for each computes its filters anew.
        self._converter = VideoReformatter()
        # Not when the container is opened: there PyAV before 18 crashes on containers without a header.
        # Decoders round sizes up; the exact limit is that of `check_size`.
        context.options = {"max_pixels": str(2 * self.limits.max_pixels + (1 << 20))}
        # One thread: errors belong to the packet at hand, and logs arrive on this thread.
        context.thread_count = 1
        context.thread_type = "NONE"

    def frames(self) -> Iterator[tuple[float | None, LazyPicture]]:
        fatal = True  # without its first picture there is no video
        for stamp, frame in self._decoded:
            self.check_size(frame.width, frame.height)
            yield stamp, LazyPicture(frame.width, frame.height, partial(self._convert, frame, fatal))
            fatal = False
        stream, whole = self._stream, self._container.duration
        shown = None
        if stream.duration and stream.time_base:
            shown = float(stream.duration * stream.time_base)
        self._integrity.compare_packets(
            declared=self.info.frames_declared,
            duration=whole / 1e6 if whole else None,
            shown=shown,
            track=stream.id,
            # Absent from older releases of PyAV; then a trimmed file counts as short.
            indexed=len(getattr(stream, "index_entries", ())),
            picture_streams=len(self._container.streams.video),
        )

    def _convert(self, frame: VideoFrame, fatal: bool) -> np.ndarray | None:
        """The picture of a frame, None where FFmpeg cannot convert it."""
        with self._decoder_log.call(fatal) as call:
            # Bicubic as in OpenCV, so that the two readers give the same picture.
            converted = self._converter.reformat(frame, format="bgr24", interpolation="BICUBIC")
            picture: np.ndarray = converted.to_ndarray()
        return None if call.failed else picture

    def _decode(self) -> Iterator[tuple[float | None, VideoFrame]]:
        """Decoded frames with their stamps in seconds; what passes is counted."""
        context, counts = self._context, self._integrity
        # AVI stamps packets, not pictures: the n-th picture shown has the n-th packet's stamp,
        # whatever the order in which a decoder needs them.
        stamps_packets = self.container == "avi"
        packet_stamps: deque[int | None] = deque()
        for packet in chain(self._packets(), (None,)):  # at the end, what the decoder still holds
            frames: list[VideoFrame] = []
            with self._decoder_log.call() as call:
                frames = context.decode(packet)
                if packet is not None and packet.is_corrupt:
                    call.damage = "corrupt packet"
                for frame in frames:
                    if frame.is_corrupt:
                        call.damage = call.damage or "frame with damaged parts"
            if call.failed and packet is not None:
                counts.refused += 1
            elif packet is not None and stamps_packets:
                packet_stamps.append(packet.dts)
            counts.frames += len(frames)
            for frame in frames:
                if stamps_packets:
                    frame.pts = packet_stamps.popleft() if packet_stamps else None
                stamp = None
                if frame.pts is not None:
                    base = cast("Fraction", frame.time_base or self._stream.time_base)
                    stamp = float((frame.pts - self._origin) * base)
                    counts.stamps.append(stamp)
                yield stamp, frame

    def _packets(self) -> Iterator[Packet[VideoStream]]:
        """Packets of the picture stream; after an error the demuxer is asked again where it stands."""
        counts, stream = self._integrity, self._stream
        vp8 = stream.codec_context.codec.canonical_name == "vp8"
        failures = 0
        while failures < _MAX_DEMUX_ERRORS:
            before = counts.packets
            packets = self._container.demux()
            while True:
                with self._decoder_log.call() as call:
                    packet = next(packets, None)
                if call.failed:
                    break
                if packet is None:
                    return
                if packet.size:
                    end = 0.0
                    if packet.pts is not None:
                        end = float((packet.pts + (packet.duration or 0)) * packet.time_base)
                    counts.count_bytes(packet.pos, packet.size, end)
                if packet.stream_index != stream.index:
                    continue
                if packet.size == 0:
                    # The demuxer ends with one; inside a file it means "the last picture again".
                    counts.empty += packet.dts is not None
                    continue
                counts.packets += 1
                counts.hidden += packet.is_discard
                # RFC 6386, section 9.1, show_frame: a packet that only refreshes a reference picture.
                counts.unshown += vp8 and not bytes(memoryview(packet)[:1])[0] & 0x10
                yield cast("Packet[VideoStream]", packet)
            failures = 0 if counts.packets > before else failures + 1


@dataclass
class Call:
    """One call into FFmpeg: whether it failed, and the first sign of damage."""

    failed: bool = False
    damage: str = ""


class DecoderLog:
    """What FFmpeg raises and logs, call by call: one count of damage for each call that shows any.

    Parameters
    ----------
    error : callable
        Makes a MediaError of a cause, a code and a remedy; `VideoDecoder.error`.
    log : DamageLog
        Receives the damage.
    """

    def __init__(self, error: Callable[..., MediaError], log: DamageLog) -> None:
        self._error = error
        self._log = log
        self._ignored: frozenset[str] = frozenset()
        self._early: list[tuple[int, str, str]] | None = []

    def ignore(self, names: Iterable[str]) -> None:
        """Leave out what the named codecs log: those of streams that are not decoded.

        Messages are kept until this is called, since a container must be opened to know its streams.
        """
        self._ignored = frozenset(names)
        early, self._early = self._early or [], None
        self._count(Call(), early)

    @contextmanager
    def call(self, fatal: bool = False) -> Iterator[Call]:
        """Run one call into FFmpeg.

        Raises
        ------
        MediaError
            `E_MEDIA_CODEC`, `E_MEDIA_UNREADABLE`, `E_MEDIA_MEMORY` in any case; with ``fatal``,
            `E_MEDIA_BROKEN` for whatever else FFmpeg raises.
        """
        import av

        call = Call()
        with av.logging.Capture() as messages:
            try:
                yield call
            except GestureError:
                raise
            except av.error.DecoderNotFoundError as error:
                raise self._error("no decoder for its codec", "E_MEDIA_CODEC", "re-encode it") from error
            except (av.error.FFmpegError, ValueError, OverflowError, ArithmeticError, OSError) as error:
                cause = (getattr(error, "strerror", None) or str(error) or type(error).__name__).rstrip(".")
                disk = isinstance(error, OSError) and not isinstance(error, av.error.FFmpegError)
                # A broken header sends the demuxer to a place before the file's beginning: that is EINVAL,
                # and the fault of what was read, not of the disk.
                if disk and getattr(error, "errno", None) != errno.EINVAL:
                    raise self._error(
                        f"cannot be read: {cause}", "E_MEDIA_UNREADABLE", "check the disk"
                    ) from error
                if fatal:
                    raise self._error(f"cannot be decoded: {cause}", "E_MEDIA_BROKEN") from error
                call.failed = True
                call.damage = call.damage or cause
            except MemoryError as error:
                raise self._error(
                    "not enough memory to decode it", "E_MEDIA_MEMORY", "a smaller video"
                ) from error
        if self._early is not None:
            self._early += messages
            messages = []
        self._count(call, messages)

    def _count(self, call: Call, messages: Iterable[tuple[int, str, str]]) -> None:
        """Note the first sign of damage of a call, which may be an error among the messages."""
        import av

        for level, name, message in messages:
            if level <= av.logging.ERROR and name not in self._ignored:
                call.damage = call.damage or _clause(message)
        if call.damage:
            self._log.damage(call.damage)


def _clause(message: str) -> str:
    """A message that may quote the file, as a clause that is fit for a terminal."""
    text = " ".join(message.split()).rstrip(".")[:_MAX_MESSAGE]
    return "".join(letter if letter.isprintable() else "?" for letter in text)


_levels: list[int | None] = []
_lock = threading.Lock()


@contextmanager
def _errors_are_logged() -> Iterator[None]:
    """Have FFmpeg log errors while any video is open, and restore its level after the last one."""
    import av

    with _lock:
        _levels.append(av.logging.get_level())
        if _levels[-1] is None or _levels[-1] < av.logging.ERROR:
            av.logging.set_level(av.logging.ERROR)
    try:
        yield
    finally:
        with _lock:
            first = _levels[0]
            _levels.pop()
            if not _levels:
                av.logging.set_level(first)


def _refuse(url: str, flags: int, options: object) -> NoReturn:
    """Called where FFmpeg would open a further file."""
    raise ValueError(f"a media file may not open {url!r}")


def _orientation(frame: VideoFrame) -> tuple[float, bool]:
    """Clockwise rotation in degrees, and whether to mirror after it, from the frame's display matrix.

    The matrix (a, b, c, d) shows the point (x, y) of the stored picture at (a x + c y, b x + d y);
    ISO 14496-12, section 8.2.2.
    """
    side_data = cast("SideDataContainer", frame.side_data)
    for index in range(len(side_data)):
        item = side_data[index]
        if item.type.name == "DISPLAYMATRIX":
            values = np.frombuffer(bytes(item), np.int32, 9) / 65536
            a, b, c, d = (float(values[place]) for place in (0, 1, 3, 4))
            if a * d - b * c < 0:
                return math.degrees(math.atan2(b, d)), True
            return math.degrees(math.atan2(b, a)), False
    return -float(frame.rotation), False


def _tagged_frames(metadata: dict[str, str]) -> int:
    """The number of frames among Matroska's statistics tags, 0 where there is none."""
    for key, value in metadata.items():
        if key.upper().startswith("NUMBER_OF_FRAMES") and value.isascii() and value.isdigit():
            return int(value[:12])
    return 0
