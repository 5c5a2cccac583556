"""Whether a fragmented ISO file is all there.

A fragmented file has no table of all samples: it is a chain of boxes, and a decoder ends where the chain
does. FFmpeg passes over a broken link, and over an end in the middle of one, in silence.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import BinaryIO

from gesture_core.video.boxes import boxes, child, movie_header, top_level

_KINDS = frozenset(
    b"ftyp styp moov moof mdat sidx ssix mfra free skip wide uuid emsg prft meta pdin udta".split()
)
_MAX_FRAGMENT = 16 << 20


@dataclass(frozen=True)
class Chain:
    """The fragments of a file.

    Attributes
    ----------
    fault : str
        What is wrong with them; empty where nothing is.
    samples : mapping
        Track number -> samples that its fragments announce, beside those of the movie header.
    payload : int
        Bytes of media data, all tracks together.
    """

    fault: str = ""
    samples: Mapping[int, int] = field(default_factory=dict)
    payload: int = 0


def read_chain(file: BinaryIO) -> Chain:
    """Walk the fragments of ``file``, whose position is kept; an empty chain where it has none."""
    position = file.tell()
    try:
        chain, fragmented = _walk(file, file.seek(0, 2))
        announced = any(kind == b"mvex" for kind, _ in boxes(movie_header(file)))
        # What follows a full table of samples may be anything.
        return chain if fragmented or announced else Chain()
    finally:
        file.seek(position)


def picture_tracks(file: BinaryIO) -> dict[int, int]:
    """Track number -> samples in the movie header, of each track of pictures, in order."""
    position = file.tell()
    found: dict[int, int] = {}
    try:
        for kind, body in boxes(movie_header(file)):
            if kind == b"trak" and child(body, b"mdia", b"hdlr")[8:12] == b"vide":
                header = child(body, b"tkhd")
                (number,) = struct.unpack_from(">I", header, 20 if header[0] == 1 else 12)
                (found[number],) = struct.unpack_from(
                    ">I", child(body, b"mdia", b"minf", b"stbl", b"stsz"), 8
                )
    except (struct.error, IndexError):
        pass  # a track that cannot be read promises nothing
    finally:
        file.seek(position)
    return found


def _walk(file: BinaryIO, end: int) -> tuple[Chain, bool]:
    numbers: list[int] = []
    samples: Counter[int] = Counter()
    fault = ""
    payload = 0
    for at, size, kind, own in top_level(file):
        if kind not in _KINDS or size < own:
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
                numbers.append(struct.unpack_from(">I", child(fragment, b"mfhd"), 4)[0])
                samples.update(_samples(fragment))
            except struct.error:
                fault = f"the fragment at byte {at} is broken"
        if at + size > end:
            fault = f"the box at byte {at} ends {at + size - end} bytes after the file"
    if not fault and any(later - former > 1 for former, later in pairwise(numbers)):
        fault = "fragments are missing"
    return Chain(fault, samples, payload), bool(numbers)


def _samples(fragment: bytes) -> Counter[int]:
    """Track number -> samples, from the runs of one fragment."""
    found: Counter[int] = Counter()
    for kind, body in boxes(fragment):
        if kind == b"traf":
            (track,) = struct.unpack_from(">I", child(body, b"tfhd"), 4)
            for inner, run in boxes(body):
                if inner == b"trun":
                    found[track] += struct.unpack_from(">I", run, 4)[0]
    return found
