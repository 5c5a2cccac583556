"""Which of several streams of pictures is the clip, and not a preview, a cover or depth beside it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.stream import VideoStream

Lengths = Mapping[int, tuple[int, float]]
"""Frames and seconds of streams, by their index."""
# Packets that are looked at where a container says nothing of the length of its streams.
_COUNTED = 20_000
_ASIDE = re.compile(r"\b(depth|disparity|infra-?red|ir|thermal|previews?|thumbnails?)\b", re.IGNORECASE)
_DURATION = re.compile(r"(\d+):(\d+):(\d+(?:\.\d+)?)")


def choose_stream(container: InputContainer, count: Callable[[], Lengths]) -> tuple[VideoStream | None, str]:
    """The stream that is read, and where there are several, which one it is.

    Never a single picture where another stream moves; then colour before grey and before what is named
    depth, infrared or preview, then what is not much shorter or smaller than the longest or largest one,
    then the container's default, the longest, the largest, and the first.

    Parameters
    ----------
    container : InputContainer
    count : callable
        Frames and seconds of its streams, counted; asked where the container does not say.

    Returns
    -------
    stream : VideoStream or None
        None where there is none but cover art.
    note : str
    """
    streams = list(container.streams.video)
    moving = [stream for stream in streams if not _is_cover(stream)]
    if not moving:
        return None, ""
    if len(streams) == 1:
        return moving[0], ""
    lengths = {stream.index: _declared(stream) for stream in moving}
    if len(moving) > 1 and any(not frames or not seconds for frames, seconds in lengths.values()):
        counted = count()
        lengths = {
            index: (frames or counted.get(index, (0, 0.0))[0], seconds or counted.get(index, (0, 0.0))[1])
            for index, (frames, seconds) in lengths.items()
        }
    longest = max(seconds for _, seconds in lengths.values()) or 1.0
    largest = max((_pixels(stream) for stream in moving if lengths[stream.index][0] != 1), default=0)
    chosen = max(moving, key=lambda stream: _rank(stream, *lengths[stream.index], longest, largest))
    others = ", ".join(_described(stream, lengths) for stream in streams if stream is not chosen)
    return chosen, f"{len(streams)} video streams: {_described(chosen, lengths)} is read, not {others}"


def count_packets(container: InputContainer) -> Lengths:
    """Packets and seconds of the streams of pictures, in the first packets of a file that may be broken."""
    found: dict[int, tuple[int, float]] = {}
    for number, packet in enumerate(container.demux(container.streams.video)):
        if number >= _COUNTED:
            break
        if packet.size:
            frames, seconds = found.get(packet.stream_index, (0, 0.0))
            end = float((packet.pts + (packet.duration or 0)) * packet.time_base) if packet.pts else 0.0
            found[packet.stream_index] = frames + 1, max(seconds, end)
    return found


def tagged_frames(stream: VideoStream) -> int:
    """The number of frames among Matroska's statistics tags, 0 where there is none."""
    for key, value in stream.metadata.items():
        if key.upper().startswith("NUMBER_OF_FRAMES") and value.isascii() and value.isdigit():
            return int(value[:12])
    return 0


def _is_cover(stream: VideoStream) -> bool:
    from av.stream import Disposition

    return bool(stream.disposition & (Disposition.attached_pic | Disposition.timed_thumbnails))


def _declared(stream: VideoStream) -> tuple[int, float]:
    """Frames and seconds by the container, 0 where it does not say."""
    seconds = 0.0
    if stream.duration and stream.time_base:
        seconds = float(stream.duration * stream.time_base)
    for key, value in stream.metadata.items():
        if key.upper().startswith("DURATION") and (match := _DURATION.match(value)):
            hours, minutes, rest = match.groups()
            seconds = seconds or 3600 * float(hours) + 60 * float(minutes) + float(rest)
    return stream.frames or tagged_frames(stream), seconds


def _pixels(stream: VideoStream) -> int:
    return stream.codec_context.width * stream.codec_context.height if stream.codec_context else 0


def _rank(
    stream: VideoStream, frames: int, seconds: float, longest: float, largest: float
) -> tuple[float, ...]:
    """The greatest is read."""
    from av.stream import Disposition

    context = stream.codec_context
    if context is None:
        return (0.0,)
    named = " ".join(stream.metadata.get(key, "") for key in ("title", "handler_name", "comment"))
    return (
        1,
        frames != 1,
        not (context.pix_fmt or "").startswith("gray"),
        not _ASIDE.search(named),
        seconds >= longest / 2 and _pixels(stream) >= largest / 4,
        bool(stream.disposition & Disposition.default),
        round(seconds / longest, 1),
        _pixels(stream),
        -stream.index,
    )


def _described(stream: VideoStream, lengths: Lengths) -> str:
    context = stream.codec_context
    size = f"{context.width} x {context.height}" if context else "no decoder"
    frames, seconds = lengths.get(stream.index, (0, 0.0))
    length = "cover art" if stream.index not in lengths else "1 frame" if frames == 1 else f"{seconds:.1f} s"
    return f"number {stream.index} ({size}, {length})"
