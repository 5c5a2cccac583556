"""Whether an ISO file's edit list, which hides frames, agrees with the rest of its header.

A trimmed film hides frames on purpose, a flipped bit by accident. Trimming leaves the header consistent:
the track is as long as its edits (ISO 14496-12, sections 8.3.2 and 8.6.6), and clocks tick at rates
that writers use.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import BinaryIO

from gesture_core.video.boxes import boxes, child, movie_header

# Writers take a round number, a rate of sound, or a frame rate times a power of two that exceeds 10,000.
_ROUND = (100, 11025, 999)
_POWER, _LEAST = 512, 10_000


# Lengths of the full boxes that hold a clock or a length, by version.
_LENGTHS = {b"mvhd": (100, 112), b"tkhd": (84, 96), b"mdhd": (24, 36)}


class _Contradiction(Exception):
    """What speaks against a header."""


def doubt(file: BinaryIO, track: int) -> str:
    """Why the frames that track number ``track`` hides may not be hidden on purpose.

    Empty where the header agrees with itself. The file's position is kept.
    """
    position = file.tell()
    try:
        _check(movie_header(file), track)
    except (struct.error, IndexError):
        return "a header that cannot be read"
    except _Contradiction as found:
        return str(found)
    finally:
        file.seek(position)
    return ""


def _check(header: bytes, track: int) -> None:
    movie_clock = _fields(header, b"mvhd", ">III", ">QQI", 2)[0]
    body = _track(header, track)
    edits = child(body, b"edts", b"elst")
    if not edits:
        raise _Contradiction("frames are hidden, and no edit list hides them")
    media = child(body, b"mdia")
    clock, media_length = _fields(media, b"mdhd", ">IIII", ">QQIQ", 2, 3)
    steps = child(media, b"minf", b"stbl", b"stts")
    track_length = _fields(body, b"tkhd", ">III4xI", ">QQI4xQ", 3)[0]
    edits_length = _total(edits, ">IiI", ">QqI", lambda entry: entry[0])
    samples_length = _total(steps, ">II", ">II", lambda entry: entry[0] * entry[1])
    if abs(track_length - edits_length) > max(2, track_length // 500):
        raise _Contradiction(f"edits of {edits_length} ticks in a track of {track_length}")
    if abs(media_length - samples_length) > max(2, media_length // 50):
        raise _Contradiction(f"samples of {samples_length} ticks in a medium of {media_length}")
    for rate in (movie_clock, clock):
        usual = rate >= _LEAST and rate % _POWER == 0
        if rate > 100_000_000 or (not usual and all(rate % unit for unit in _ROUND)):
            raise _Contradiction(f"a clock of {rate} ticks a second")


def _track(header: bytes, number: int) -> bytes:
    """Content of the track with that number."""
    for kind, body in boxes(header):
        if kind == b"trak" and _fields(body, b"tkhd", ">III", ">QQI", 2)[0] == number:
            return body
    raise _Contradiction(f"no track has the number {number}")


def _fields(parent: bytes, kind: bytes, short: str, long: str, *wanted: int) -> tuple[int, ...]:
    """Numbers at the places ``wanted`` of a full box, whose version decides its field widths."""
    box = child(parent, kind)
    version = box[0]
    if version > 1 or len(box) != _LENGTHS[kind][version]:
        raise _Contradiction(f"a box {kind.decode()} of {len(box)} bytes in version {version}")
    values = struct.unpack_from(long if version else short, box, 4)
    return tuple(values[index] for index in wanted)


def _total(box: bytes, short: str, long: str, value: Callable[[tuple[int, ...]], int]) -> int:
    """Sum of ``value`` over the entries of a full box that holds a table."""
    form = long if box[0] == 1 else short
    (count,) = struct.unpack_from(">I", box, 4)
    size = struct.calcsize(form)
    count = min(count, (len(box) - 8) // size)
    return sum(value(struct.unpack_from(form, box, 8 + index * size)) for index in range(count))
