"""ISO files (mp4, mov, 3gp): their boxes, their fragments, and their edit lists, read without trust.

Boxes: ISO 14496-12, section 4.2. A fragmented file has no table of all samples: it is a chain of boxes, and
a decoder ends where the chain does. FFmpeg skips a broken link, and an end in the middle of one, without an
error. An edit list hides frames: that of a trimmed video on purpose, a flipped bit by accident. Trimming
leaves the header consistent: the track is as long as its edits (sections 8.3.2 and 8.6.6), and clocks have
rates that writers use.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import BinaryIO

_MAX_BOXES = 200_000
_MAX_HEADER = 64 << 20
_MAX_FRAGMENT = 16 << 20
_TOP = frozenset(
    b"ftyp styp moov moof mdat sidx ssix mfra free skip wide uuid emsg prft meta pdin udta".split()
)
# Writers take a round number, a rate of sound, or a frame rate times a power of two that exceeds 10,000.
_ROUND = (100, 11025, 999)
_POWER, _LEAST = 512, 10_000
# Lengths of the full boxes that hold a clock or a length, by version.
_LENGTHS = {b"mvhd": (100, 112), b"tkhd": (84, 96), b"mdhd": (24, 36)}


@dataclass(frozen=True)
class Fragments:
    """The fragments of a file: what is wrong with them, empty where nothing is; track number -> samples that
    they announce, beside those of the movie header; bytes of media data, all tracks together.
    """

    fault: str = ""
    samples: Mapping[int, int] = field(default_factory=dict)
    payload: int = 0


def read_fragments(file: BinaryIO) -> Fragments:
    """Walk the fragments of ``file``; none where it has no fragments."""
    numbers: list[int] = []
    samples: Counter[int] = Counter()
    fault, payload = "", 0
    end = file.seek(0, 2)
    for at, size, kind, own in _file_boxes(file):
        if kind not in _TOP or size < own:
            fault = f"no box begins at byte {at}"
            file.seek(at)
            if b"moof" in file.read(_MAX_FRAGMENT):
                numbers.append(0)
            break
        if kind == b"mdat":
            payload += size - own
        if kind == b"moof":
            file.seek(at + own)
            fragment = file.read(min(size - own, _MAX_FRAGMENT))
            try:
                numbers.append(struct.unpack_from(">I", _child(fragment, b"mfhd"), 4)[0])
                samples.update(_samples(fragment))
            except struct.error:
                fault = f"the fragment at byte {at} is broken"
        if at + size > end:
            fault = f"the box at byte {at} ends {at + size - end} bytes after the file"
    if not fault and any(later - former > 1 for former, later in pairwise(numbers)):
        fault = "fragments are missing"
    if numbers or any(kind == b"mvex" for kind, _ in _boxes(_movie_header(file))):
        return Fragments(fault, samples, payload)
    return Fragments()  # what follows a full table of samples may be anything


def _samples(fragment: bytes) -> Counter[int]:
    """Track number -> samples, from the runs of one fragment."""
    found: Counter[int] = Counter()
    for kind, body in _boxes(fragment):
        if kind == b"traf":
            (track,) = struct.unpack_from(">I", _child(body, b"tfhd"), 4)
            for inner, run in _boxes(body):
                if inner == b"trun":
                    found[track] += struct.unpack_from(">I", run, 4)[0]
    return found


def picture_tracks(file: BinaryIO) -> dict[int, int]:
    """Track number -> samples in the movie header, of each track of pictures, in order."""
    found: dict[int, int] = {}
    try:
        for kind, body in _boxes(_movie_header(file)):
            if kind == b"trak" and _child(body, b"mdia", b"hdlr")[8:12] == b"vide":
                header = _child(body, b"tkhd")
                (number,) = struct.unpack_from(">I", header, 20 if header[0] == 1 else 12)
                table = _child(body, b"mdia", b"minf", b"stbl", b"stsz")
                (found[number],) = struct.unpack_from(">I", table, 8)
    except (struct.error, IndexError):
        pass  # a track that cannot be read declares nothing
    return found


def track_kinds(file: BinaryIO) -> list[int]:
    """1 for each track of pictures, 0 for each other one. The position of the file is kept."""
    place = file.tell()
    tracks = [body for kind, body in _boxes(_movie_header(file)) if kind == b"trak"]
    file.seek(place)
    return [int(_child(track, b"mdia", b"hdlr")[8:12] == b"vide") for track in tracks]


def has_movie_header(file: BinaryIO) -> bool:
    """Whether there is a box `moov`, without which nothing says where the frames are."""
    return any(kind == b"moov" for _, _, kind, _ in _file_boxes(file))


def mirrored_rotation(file: BinaryIO) -> float | None:
    """Clockwise rotation in degrees of the first track of pictures, to be mirrored after it; None where it is
    not. The matrix of a track: ISO 14496-12, section 8.3.2.
    """
    try:
        for kind, body in _boxes(_movie_header(file)):
            if kind == b"trak" and _child(body, b"mdia", b"hdlr")[8:12] == b"vide":
                header = _child(body, b"tkhd")
                a, b, _, c, d = struct.unpack_from(">5i", header, 52 if header[0] == 1 else 40)
                return math.degrees(math.atan2(b, d)) if a * d - b * c < 0 else None
    except (struct.error, IndexError):
        pass
    return None


def edit_list_fault(file: BinaryIO, track: int) -> str:
    """Why the frames that track number ``track`` hides may not be hidden on purpose.

    Empty where the header agrees with itself.
    """
    try:
        _check_edit_list(_movie_header(file), track)
    except (struct.error, IndexError):
        return "a header that cannot be read"
    except ValueError as contradiction:
        return str(contradiction)
    return ""


def _check_edit_list(header: bytes, number: int) -> None:
    movie_clock = _fields(header, b"mvhd", ">III", ">QQI", 2)[0]
    for kind, track in _boxes(header):
        if kind == b"trak" and _fields(track, b"tkhd", ">III", ">QQI", 2)[0] == number:
            break
    else:
        raise ValueError(f"no track has the number {number}")
    edits = _child(track, b"edts", b"elst")
    if not edits:
        raise ValueError("frames are hidden, and no edit list hides them")
    media = _child(track, b"mdia")
    clock, media_length = _fields(media, b"mdhd", ">IIII", ">QQIQ", 2, 3)
    steps = _child(media, b"minf", b"stbl", b"stts")
    track_length = _fields(track, b"tkhd", ">III4xI", ">QQI4xQ", 3)[0]
    edits_length = sum(entry[0] for entry in _entries(edits, ">IiI", ">QqI"))
    samples_length = sum(count * ticks for count, ticks in _entries(steps, ">II", ">II"))
    if abs(track_length - edits_length) > max(2, track_length // 500):
        raise ValueError(f"edits of {edits_length} ticks in a track of {track_length}")
    if abs(media_length - samples_length) > max(2, media_length // 50):
        raise ValueError(f"samples of {samples_length} ticks in a medium of {media_length}")
    for rate in (movie_clock, clock):
        usual = rate >= _LEAST and rate % _POWER == 0
        if rate > 100_000_000 or (not usual and all(rate % unit for unit in _ROUND)):
            raise ValueError(f"a clock of {rate} ticks a second")


def _fields(parent: bytes, kind: bytes, short: str, long: str, *wanted: int) -> tuple[int, ...]:
    """Numbers at the places ``wanted`` of a full box, whose version decides its field widths."""
    box = _child(parent, kind)
    version = box[0]
    if version > 1 or len(box) != _LENGTHS[kind][version]:
        raise ValueError(f"a box {kind.decode()} of {len(box)} bytes in version {version}")
    values = struct.unpack_from(long if version else short, box, 4)
    return tuple(values[index] for index in wanted)


def _entries(box: bytes, short: str, long: str) -> Iterator[tuple[int, ...]]:
    """The entries of a full box that holds a table, as many as it has room for."""
    form = long if box[0] == 1 else short
    (count,) = struct.unpack_from(">I", box, 4)
    size = struct.calcsize(form)
    for index in range(min(count, (len(box) - 8) // size)):
        yield struct.unpack_from(form, box, 8 + index * size)


def _movie_header(file: BinaryIO) -> bytes:
    """What the box `moov` holds; nothing where there is none."""
    for at, size, kind, own in _file_boxes(file):
        if kind == b"moov":
            file.seek(at + own)
            return file.read(max(0, min(size - own, _MAX_HEADER)))
    return b""


def _file_boxes(file: BinaryIO) -> Iterator[tuple[int, int, bytes, int]]:
    """Position, size, kind and length of its own header, of each box at the top of ``file``.

    A size is what the box claims: it may reach beyond the end. Ends after a box whose size makes no
    sense, which is yielded, as are bytes that are too few for a box.
    """
    end = file.seek(0, 2)
    at = 0
    for _ in range(_MAX_BOXES):
        if at >= end:  # a claimed size may exceed what the system can seek to
            return
        file.seek(at)
        head = file.read(16)
        if len(head) < 8:
            yield at, 8, b"", 8
            return
        size, kind, own = _box(head)
        size = end - at if size == 0 else size  # 0: as long as the file goes on
        yield at, size, kind, own
        if size < own:
            return
        at += size


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of each box in ``data``."""
    at = 0
    for _ in range(_MAX_BOXES):
        if at + 8 > len(data):
            return
        size, kind, own = _box(data[at : at + 16].ljust(16, b"\0"))
        if size < own:
            return
        yield kind, data[at + own : at + size]
        at += size


def _child(data: bytes, *path: bytes) -> bytes:
    """Content of the first box along ``path``; nothing where there is none."""
    for name in path:
        data = next((body for kind, body in _boxes(data) if kind == name), b"")
    return data


def _box(head: bytes) -> tuple[int, bytes, int]:
    """Size, kind and length of its own header, of the box that begins with ``head``."""
    size, kind = struct.unpack_from(">I4s", head)
    if size == 1 and len(head) >= 16:
        return struct.unpack_from(">Q", head, 8)[0], kind, 16
    return size, kind, 8
