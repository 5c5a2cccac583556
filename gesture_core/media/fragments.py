"""Whether a fragmented ISO file is all there.

A fragmented file has no table of all samples: it is a chain of boxes, and a decoder ends where the chain
does. FFmpeg passes over a broken link, and over an end in the middle of one, in silence.
"""

from __future__ import annotations

import struct
from itertools import pairwise
from typing import BinaryIO

from gesture_core.media.boxes import boxes, child, movie_header, top_level

_KINDS = frozenset(
    b"ftyp styp moov moof mdat sidx ssix mfra free skip wide uuid emsg prft meta pdin udta".split()
)
_MAX_FRAGMENT = 16 << 20


def broken_chain(file: BinaryIO) -> str:
    """What is wrong with the chain; empty where it is whole, or where the file is not fragmented.

    The file's position is kept.
    """
    position = file.tell()
    end = file.seek(0, 2)
    numbers: list[int] = []
    fault = ""
    at = 0
    try:
        for at, size, kind, own in top_level(file):
            if kind == b"moof" and size >= own:
                file.seek(at + own)
                fragment = child(file.read(min(size - own, _MAX_FRAGMENT)), b"mfhd")
                numbers.append(struct.unpack_from(">I", fragment, 4)[0])
            if kind not in _KINDS or size < own:
                fault = f"no box begins at byte {at}"
                break
            if at + size > end:
                fault = f"the box at byte {at} ends {at + size - end} bytes after the file"
    except struct.error:
        fault = f"the fragment at byte {at} has no number"
    if not fault and any(later - former > 1 for former, later in pairwise(numbers)):
        fault = "fragments are missing"
    fragmented = bool(numbers) or _announced(file)
    file.seek(position)
    return fault if fragmented else ""


def _announced(file: BinaryIO) -> bool:
    """Whether the header says that fragments follow."""
    return any(kind == b"mvex" for kind, _ in boxes(movie_header(file)))
