"""Decoding with PyAV: real time stamps, rotation and mirroring, and an honest account of damage.

What counts as damage: packets that the demuxer marks corrupt, errors that the demuxer or the decoder
raises or logs, frames that the decoder marks as concealed, packets that the sample table promises and
the file lacks, and packets from which no frame came.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np

from gesture_core.video.account import Account
from gesture_core.video.edits import doubt
from gesture_core.video.elements import Blocks, read_blocks
from gesture_core.video.fragments import read_chain
from gesture_core.video.info import SQUARE, MediaInfo
from gesture_core.video.limits import MAX_FPS
from gesture_core.video.pyav_ear import Ear, refuse
from gesture_core.video.source import AGAIN, Source
from gesture_core.video.upright import display_matrix, orientation

# A demuxer that fails this often in a row has lost its place for good.
_MAX_DEMUX_ERRORS = 32
# Bytes of a fragmented file's media data that may be padding.
_UNREAD = 64
# Containers without a count of frames, whose header is written last and holds the duration, and by how
# many frames the last packet may miss it: FLV does not say how long packets last.
_DURATION_HOLDS = {"matroska": 0.6, "flv": 2.5}


class PyAvSource(Source):
    """The frames of one open file through PyAV.

    Parameters are those of `Source`.

    Raises
    ------
    MediaError
        `E_MEDIA_BROKEN`, `E_MEDIA_NO_VIDEO`, `E_MEDIA_CODEC`, `E_MEDIA_NO_FRAMES`, `E_MEDIA_LIMIT`,
        `E_MEDIA_MEMORY`, `E_MEDIA_UNREADABLE` where the disk fails half-way.
    """

    name = "pyav"

    def _start(self) -> MediaInfo:
        self._account = Account()
        self._ear = Ear(self._subject, self._ledger)
        self._opened.callback(self._ear.close)
        self._open()
        self._origin = self._stream.start_time or 0
        # AVI stamps packets, not pictures: the n-th picture shown has the n-th packet's stamp,
        # whatever the order in which a decoder needs them.
        self._stamps_packets = self._format == "avi"
        self._packet_stamps: deque[int | None] = deque()
        self._frames = self._decode()
        self._first = next(self._frames, None)
        if self._first is None:
            raise self._no_frame()
        return self._describe(self._first)

    def _open(self) -> None:
        import av
        from av.video.reformatter import VideoReformatter

        with self._ear.hear(fatal=True):
            self._container: Any = av.open(
                self._file,
                "r",
                format=self._format,
                metadata_errors="replace",
                io_open=refuse,
                container_options={"max_streams": str(self._limits.max_streams)},
            )
            self._opened.callback(self._container.close)
            self._stream: Any = self._container.streams.best("video")
        if not len(self._container.streams):
            raise self._error("its container holds no stream at all", "E_MEDIA_BROKEN", AGAIN)
        if self._stream is None or self._stream.disposition & av.stream.Disposition.attached_pic:
            kinds = sorted({stream.type for stream in self._container.streams})
            raise self._error(
                f"holds no video stream ({', '.join(kinds)})",
                "E_MEDIA_NO_VIDEO",
                "leave it out",
            )
        self._ear.ignore(_others(self._container.streams, self._stream))
        context = self._stream.codec_context
        if context is None:
            raise self._error("no decoder for its codec", "E_MEDIA_CODEC", "re-encode it")
        self._check_size(context.width, context.height)
        # One converter for all frames: a new one for each computes its filters anew.
        self._converter = VideoReformatter()
        # Not when the container is opened: there PyAV before 18 crashes on containers without a header.
        # Decoders round sizes up; the exact limit is `_check_size`'s.
        context.options = {"max_pixels": str(2 * self._limits.max_pixels + (1 << 20))}
        # One thread: errors belong to the packet at hand, and logs arrive on this thread.
        context.thread_count = 1
        context.thread_type = "NONE"

    def _describe(self, first: Any) -> MediaInfo:
        stream = self._stream
        rotation, mirrored = orientation(display_matrix(first), first.rotation)
        rates = [float(rate) for rate in (stream.average_rate, stream.guessed_rate) if rate]
        ratio = stream.codec_context.sample_aspect_ratio
        if ratio and ratio != 1:
            self._ledger.note(SQUARE.format(ratio.numerator, ratio.denominator))
        width, height = first.width, first.height
        if rotation % 180:
            width, height = height, width
        return MediaInfo(
            width=width,
            height=height,
            frames_declared=self._declared(),
            fps=next((rate for rate in rates if 0 < rate <= MAX_FPS), None),
            rotation=rotation,
            codec=stream.codec_context.codec.canonical_name,
            container=self._format,
            reader=self.name,
            mirrored=mirrored,
        )

    def _declared(self) -> int | None:
        frames = self._stream.frames or _tagged_frames(self._stream.metadata)
        return frames if 0 < frames <= self._limits.max_frames else None

    def _duration(self, cut: bool) -> float | None:
        """Seconds that the header promises; elsewhere than here the figure is a guess or often wrong."""
        stream, whole = self._stream, self._container.duration
        if cut:
            return float(stream.duration * stream.time_base) if stream.duration else None
        return whole / 1e6 if whole and self._format in _DURATION_HOLDS else None

    def __iter__(self) -> Iterator[tuple[float | None, np.ndarray]]:
        first, self._first = self._first, None
        if first is not None:
            with self._ear.hear(fatal=True):
                picture = self._picture(first)
            yield self._stamp(first), picture
        for frame in self._frames:
            with self._ear.hear() as step:
                picture = self._picture(frame)
            if not step.failed:
                yield self._stamp(frame), picture
        self._settle()

    def _settle(self) -> None:
        """Compare what came with what was promised, once the file has ended."""
        declared = self.info.frames_declared
        if self._format == "mov":
            # Absent from older releases of PyAV; then a trimmed file counts as short.
            index = len(getattr(self._stream, "index_entries", ()))
            self._account.trimmed = max(0, declared - index) if declared and index else 0
            declared = self._check_fragments(declared)
        whole = False
        if self._format == "matroska":
            whole = self._check_blocks().closed
        if self._format == "flv" and len(self._container.streams.video) > 1:
            self._ledger.damage("pictures of a second codec, for which FLV has no room")
        cut = self._account.cut and self._format == "mov"
        if cut:
            contradiction = doubt(self._file, self._stream.id)
            if contradiction:
                self._ledger.damage(f"frames hidden by a header that contradicts itself: {contradiction}")
        self._account.settle(
            self._ledger,
            declared=declared,
            # Sound may end before the header says; a file that is all there has lost nothing for it.
            duration=None if whole else self._duration(cut),
            tolerance=_DURATION_HOLDS.get(self._format, 0.6),
        )

    def _check_fragments(self, declared: int | None) -> int | None:
        """Frames that the movie header and the fragments promise together."""
        chain = read_chain(self._file)
        if chain.fault:
            self._ledger.damage(f"broken chain of fragments: {chain.fault}")
        unread = chain.payload - self._account.size
        if unread > max(_UNREAD, chain.payload // 50):
            self._ledger.damage(f"{unread} bytes of media data belong to no packet")
        return (declared or 0) + chain.samples.get(self._stream.id, 0) or None

    def _check_blocks(self) -> Blocks:
        blocks = read_blocks(self._file)
        if blocks.fault:
            self._ledger.damage(f"broken chain of elements: {blocks.fault}")
        lost = blocks.count - self._account.places
        if lost > 0:
            self._ledger.damage(f"blocks that gave no packet: {lost}", lost)
        self._account.holes += blocks.voids
        return blocks

    def _stamp(self, frame: Any) -> float | None:
        if frame.pts is None:
            return None
        base = frame.time_base or self._stream.time_base
        return float((frame.pts - self._origin) * base)

    def _picture(self, frame: Any) -> np.ndarray:
        self._check_size(frame.width, frame.height)
        # Bicubic as in OpenCV, so that the two readers give the same picture.
        converted = self._converter.reformat(frame, format="bgr24", interpolation="BICUBIC")
        picture: np.ndarray = converted.to_ndarray()
        return picture

    def _decode(self) -> Iterator[Any]:
        context = self._stream.codec_context
        for packet in self._packets():
            yield from self._step(context, packet)
        yield from self._step(context, None)

    def _packets(self) -> Iterator[Any]:
        failures = 0
        while failures < _MAX_DEMUX_ERRORS:
            before = self._account.packets
            packets = self._container.demux()
            while True:
                with self._ear.hear() as step:
                    packet = next(packets, None)
                if step.failed:
                    break
                if packet is None:
                    return
                if packet.size:
                    self._account.passed(packet.pos, packet.size, self._end_of(packet))
                if packet.stream_index != self._stream.index:
                    continue
                if packet.size == 0:
                    # The demuxer ends with one; inside a file it means "the last picture again".
                    self._account.empty += packet.dts is not None
                    continue
                self._account.packets += 1
                self._account.hidden += packet.is_discard
                self._account.unshown += self._unshown(packet)
                yield packet
            failures = 0 if self._account.packets > before else failures + 1

    def _end_of(self, packet: Any) -> float:
        if packet.pts is None:
            return 0.0
        return float((packet.pts + (packet.duration or 0)) * packet.time_base)

    def _unshown(self, packet: Any) -> bool:
        """Whether a VP8 packet only refreshes a reference picture (RFC 6386, section 9.1: show_frame)."""
        if self._stream.codec_context.codec.canonical_name != "vp8":
            return False
        return not bytes(memoryview(packet)[:1])[0] & 0x10

    def _step(self, context: Any, packet: Any) -> list[Any]:
        frames: list[Any] = []
        with self._ear.hear() as step:
            frames = context.decode(packet)
            if packet is not None and packet.is_corrupt:
                step.damage("corrupt packet")
            if any(frame.is_corrupt for frame in frames):
                step.damage("frame with damaged parts")
        if step.failed and packet is not None:
            self._account.refused += 1
        elif packet is not None and self._stamps_packets:
            self._packet_stamps.append(packet.dts)
        if self._stamps_packets:
            for frame in frames:
                frame.pts = self._packet_stamps.popleft() if self._packet_stamps else None
        self._account.frames += len(frames)
        self._account.stamps += [stamp for frame in frames if (stamp := self._stamp(frame)) is not None]
        return frames


def _others(streams: Any, chosen: Any) -> set[str]:
    """Names of the codecs that only other streams than ``chosen`` use."""
    names = {s.codec_context.name for s in streams if s is not chosen and s.codec_context is not None}
    return names - ({chosen.codec_context.name} if chosen.codec_context is not None else set())


def _tagged_frames(metadata: dict[str, str]) -> int:
    """The number of frames among Matroska's statistics tags, 0 where there is none."""
    for key, value in metadata.items():
        if key.upper().startswith("NUMBER_OF_FRAMES") and value.isascii() and value.isdigit():
            return int(value[:12])
    return 0
