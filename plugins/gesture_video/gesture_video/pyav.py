"""Decoding with PyAV: real time stamps, rotation and mirroring, and a full account of damage.

What counts as damage: packets that the demuxer marks corrupt, errors that the demuxer or the decoder
raises or logs, frames that the decoder marks as concealed, packets that the sample table declares and
the file lacks, and packets from which no frame came.
"""

from __future__ import annotations

import importlib.metadata
import math
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from functools import cache, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NoReturn, cast

import numpy as np

from gesture_core.errors import MediaError, MissingDependencyError
from gesture_core.records import VideoInfo, VideoLimits
from gesture_core.video import UNTIMED, Integrity, LazyPicture, VideoDecoder
from gesture_video.decoder_log import DecoderLog, errors_are_logged

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.packet import Packet
    from av.sidedata.sidedata import SideDataContainer
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

    from gesture_video.streams import Lengths

_OLDEST = 17
# A demuxer that fails this often in a row has lost its place for good.
_MAX_DEMUX_ERRORS = 32


@cache
def _version() -> str:
    """Of PyAV, looked up once; empty where it was built from source, and then is recent."""
    try:
        return importlib.metadata.version("av")
    except importlib.metadata.PackageNotFoundError:
        return ""


class PyAvReader:
    """Decodes with FFmpeg through PyAV, and counts what is damaged or lost. It has no options.

    Raises
    ------
    MissingDependencyError
        Where PyAV is too old.
    """

    def __init__(self) -> None:
        found = _version()
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
        self.resources.enter_context(errors_are_logged())
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
        rates = [stream.average_rate, stream.guessed_rate]
        if self.container in UNTIMED:  # the demuxer makes up a rate, the stream may have one
            rates = [self._context.framerate]
        # As players do: the container's figure, else that of the stream, which may change half-way.
        self._ratio = self._context.sample_aspect_ratio
        ratio = stream.sample_aspect_ratio or self._ratio
        return self.describe(
            width=frame.width,
            height=frame.height,
            codec=stream.codec_context.codec.canonical_name,
            declared=stream.frames or self._tagged(),
            rates=[float(rate or 0) for rate in rates],
            rotation=rotation,
            mirrored=mirrored,
            pixel_aspect=(ratio.numerator, ratio.denominator) if ratio else (1, 1),
        )

    def _tagged(self) -> int:
        """The number of frames where the container has no room for it, but perhaps a tag."""
        from gesture_video.streams import tagged_frames

        return tagged_frames(self._stream)

    def _opened(self, file: BinaryIO) -> InputContainer:
        import av

        return av.open(
            file,
            "r",
            format=self.container,
            metadata_errors="replace",
            io_open=_refuse,
            container_options={"max_streams": str(self.limits.max_streams)},
        )

    def _chosen(self) -> tuple[VideoStream | None, str]:
        """The stream that is the clip, and a note where there are several."""
        from av.stream import Disposition

        streams = self._container.streams.video
        if len(streams) == 1 and not streams[0].disposition & ~Disposition.default:
            return streams[0], ""
        from gesture_video.streams import choose_stream

        return choose_stream(self._container, self._lengths)

    def _lengths(self) -> Lengths:
        """Frames and seconds of the streams, counted; what is damaged is found when they are decoded."""
        import av

        from gesture_video.streams import count_packets

        damage = (av.error.FFmpegError, ValueError, ArithmeticError, OSError)
        with (
            av.logging.Capture(),
            suppress(*damage),
            self.path.open("rb", buffering=0) as file,
            self._opened(file) as container,
        ):
            return count_packets(container)
        return {}

    def _open(self) -> None:
        """Open container and decoder, with what they may cost, and choose the stream of pictures."""
        from av.video.reformatter import VideoReformatter

        try:
            with self._decoder_log.call(fatal=True):
                self._container = self._opened(self.file)
                self.resources.callback(self._container.close)
        except MediaError as error:
            if self.container == "mov" and error.code == "E_MEDIA_BROKEN" and self._integrity.headless():
                cause = "has no index (moov): its recording was broken off, or it is a segment of a stream"
                remedy = "repair it with a whole video of the same camera, or join the segments"
                raise self.error(cause, "E_MEDIA_BROKEN", remedy) from error
            raise
        streams = self._container.streams
        if not len(streams):
            raise self.error("its container holds no stream at all", "E_MEDIA_BROKEN")
        with self._decoder_log.call(fatal=True):
            stream, note = self._chosen()
        if note:
            self.log.note(note)
        if stream is None:
            kinds = sorted({stream.type for stream in streams})
            raise self.error(
                f"holds no video stream ({', '.join(kinds)})", "E_MEDIA_NO_VIDEO", "leave it out"
            )
        context = stream.codec_context
        if context is None:
            raise self.error("no decoder for its codec", "E_MEDIA_CODEC", "re-encode it")
        others = {s.codec_context.name for s in streams if s is not stream and s.codec_context is not None}
        self._decoder_log.ignore(others - {context.name})
        self._stream, self._context = stream, context
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
            self._follow_pixels()
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
            # One thread, as in decoding: handing over to more costs more than it saves.
            converted = self._converter.reformat(frame, format="bgr24", interpolation="BICUBIC", threads=1)
            picture: np.ndarray = converted.to_ndarray()
        return None if call.failed else picture

    def _follow_pixels(self) -> None:
        """A broadcast changes from 4:3 to 16:9 without another size of its pictures."""
        ratio = self._context.sample_aspect_ratio
        if ratio is None or ratio == self._ratio:
            return
        self._ratio = ratio
        self.change_pixels(ratio.numerator, ratio.denominator)

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
                    stamp = _seconds(frame.pts - self._origin, base)
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
                        end = _seconds(packet.pts + (packet.duration or 0), packet.time_base)
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


def _seconds(ticks: int, base: Fraction) -> float:
    """``ticks * base`` to the last bit, without a fraction for each packet."""
    return ticks * base.numerator / base.denominator


def _refuse(url: str, flags: int, options: object) -> NoReturn:
    """Called where FFmpeg would open a further file."""
    raise ValueError(f"a media file may not open {url!r}")


def _orientation(frame: VideoFrame) -> tuple[float, bool]:
    """Clockwise rotation in degrees, and whether to mirror after it, from the frame's display matrix.

    The matrix (a, b, c, d) shows the point (x, y) of the stored picture at (a x + c y, b x + d y);
    ISO 14496-12, section 8.2.2.
    """
    side_data = _side_data(frame)
    if "DISPLAYMATRIX" not in side_data:
        return -float(frame.rotation), False
    values = np.frombuffer(bytes(side_data["DISPLAYMATRIX"]), np.int32, 9) / 65536
    a, b, c, d = (float(values[place]) for place in (0, 1, 3, 4))
    if a * d - b * c < 0:
        return math.degrees(math.atan2(b, d)), True
    return math.degrees(math.atan2(b, a)), False


def _side_data(frame: VideoFrame) -> SideDataContainer:
    """Side data of a frame, with the kinds that FFmpeg knows and this release of PyAV does not.

    One of these, such as the view of a spatial video or the EXIF of a camera, has PyAV refuse all.
    """
    try:
        return cast("SideDataContainer", frame.side_data)
    except ValueError:
        from av.sidedata.sidedata import Type

        def unknown(kind: type[Type], value: int) -> Type:
            member = object.__new__(kind)
            vars(member).update(_name_=f"UNKNOWN_{value}", _value_=value)
            return member

        Type._missing_ = classmethod(unknown)  # type: ignore[assignment, method-assign]
        try:
            return cast("SideDataContainer", frame.side_data)
        finally:
            del Type._missing_
