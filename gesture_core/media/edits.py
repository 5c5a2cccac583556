"""Whether an ISO file's edit list, which hides frames, agrees with the rest of its header.

A trimmed film hides frames on purpose, a flipped bit by accident. Trimming leaves the header consistent:
the track is as long as its edits (ISO 14496-12, sections 8.3.2 and 8.6.6), and clocks tick at rates
that writers use.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import BinaryIO

from gesture_core.media.boxes import boxes, child, movie_header

# Writers take a round number, a rate of sound, or a frame rate times a power of two that exceeds 10,000.
_ROUND = (100, 11025, 999)
_POWER, _LEAST = 512, 10_000


@dataclass(frozen=True)
class Edits:
    """Clocks and lengths that a track's header states; lengths in ticks of the movie's clock."""

    movie_clock: int
    media_clock: int
    track_length: int
    edits_length: int
    media_length: int
    samples_length: int

    @property
    def doubt(self) -> str:
        """What contradicts what; empty where all agrees."""
        if abs(self.track_length - self.edits_length) > max(2, self.track_length // 500):
            return f"edits of {self.edits_length} ticks in a track of {self.track_length}"
        if abs(self.media_length - self.samples_length) > max(2, self.media_length // 50):
            return f"samples of {self.samples_length} ticks in a medium of {self.media_length}"
        for clock in (self.movie_clock, self.media_clock):
            usual = clock >= _LEAST and clock % _POWER == 0
            if clock > 100_000_000 or (not usual and all(clock % unit for unit in _ROUND)):
                return f"a clock of {clock} ticks a second"
        return ""


def read_edits(file: BinaryIO, track: int) -> Edits | None:
    """The edits of track number ``track``; None where the header holds none or cannot be parsed.

    The file's position is kept.
    """
    position = file.tell()
    try:
        header = movie_header(file)
        return _edits(header, track) if header else None
    except (struct.error, IndexError):
        return None
    finally:
        file.seek(position)


def _edits(header: bytes, track: int) -> Edits | None:
    movie = child(header, b"mvhd")
    for kind, body in boxes(header):
        if kind != b"trak":
            continue
        number, length = _fields(child(body, b"tkhd"), ">III4xI", ">QQI4xQ", 2, 3)
        edits = child(body, b"edts", b"elst")
        if number != track or not edits:
            continue
        clock, media_length = _fields(child(body, b"mdia", b"mdhd"), ">IIII", ">QQIQ", 2, 3)
        steps = child(body, b"mdia", b"minf", b"stbl", b"stts")
        return Edits(
            movie_clock=_fields(movie, ">III", ">QQI", 2)[0],
            media_clock=clock,
            track_length=length,
            edits_length=_total(edits, ">IiI", ">QqI", lambda entry: entry[0]),
            media_length=media_length,
            samples_length=_total(steps, ">II", ">II", lambda entry: entry[0] * entry[1]),
        )
    return None


def _fields(box: bytes, short: str, long: str, *wanted: int) -> tuple[int, ...]:
    """Numbers at the places ``wanted`` of a full box, whose version decides its field widths."""
    values = struct.unpack_from(long if box[0] == 1 else short, box, 4)
    return tuple(values[index] for index in wanted)


def _total(box: bytes, short: str, long: str, value: Callable[[tuple[int, ...]], int]) -> int:
    """Sum of ``value`` over the entries of a full box that holds a table."""
    form = long if box[0] == 1 else short
    (count,) = struct.unpack_from(">I", box, 4)
    size = struct.calcsize(form)
    count = min(count, (len(box) - 8) // size)
    return sum(value(struct.unpack_from(form, box, 8 + index * size)) for index in range(count))
