"""Whether a Matroska or WebM file is all there: its chain of elements (RFC 8794, RFC 9559).

FFmpeg skips, without an error, an element that it does not know and a block of a track that is not there, so
that a flipped bit in a block's header loses its frame unnoticed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

# EBML, Segment, SeekHead, Info, Tracks, Cluster, Cues, Attachments, Chapters, Tags, Void, CRC-32.
_TOP = frozenset(
    map(
        bytes.fromhex,
        "1a45dfa3 18538067 114d9b74 1549a966 1654ae6b 1f43b675 "
        "1c53bb6b 1941a469 1043a770 1254c367 ec bf".split(),
    )
)
# Timestamp, SilentTracks, Position, PrevSize, SimpleBlock, BlockGroup.
_CLUSTER = frozenset(map(bytes.fromhex, "e7 5854 a7 ab a3 a0".split()))
# Block, BlockAdditions, BlockDuration, ReferencePriority, ReferenceBlock, CodecState, DiscardPadding, Slices.
_GROUP = frozenset(map(bytes.fromhex, "a1 75a1 9b fa fb a4 75a2 8e".split()))
_NUMBERS = frozenset(map(bytes.fromhex, "e7 a7 ab 9b fa fb 75a2".split()))
_BLOCKS = frozenset((b"\xa3", b"\xa1"))
_SEGMENT, _CLUSTER_BEGINS = bytes.fromhex("18538067"), bytes.fromhex("1f43b675")
_GROUP_BEGINS, _VOID, _CHECKSUM = b"\xa0", b"\xec", b"\xbf"
_ENTERED = frozenset((_SEGMENT, _CLUSTER_BEGINS, _GROUP_BEGINS))
# A block without a picture has only its own header: track, time, flags.
_EMPTY = 4
_TRACKS, _TRACK, _TRACK_TYPE = bytes.fromhex("1654ae6b"), b"\xae", b"\x83"
_MAX_HEADER = 4 << 20
_MAX_ELEMENTS = 5_000_000


@dataclass(frozen=True)
class Blocks:
    """What a file holds for its demuxer: where the chain breaks, empty where it does not; blocks of all
    tracks that hold data; stretches among the blocks that are marked as unused; whether the file declares
    its length, and is whole.
    """

    fault: str = ""
    count: int = 0
    voids: int = 0
    closed: bool = False


def read_blocks(file: BinaryIO) -> Blocks:
    """Walk the elements of ``file``."""
    end = file.seek(0, 2)
    at = count = voids = group = 0
    segment: int | None = None
    among = False
    for _ in range(_MAX_ELEMENTS):
        if at >= end:
            break
        file.seek(at)
        name, size, own = _header(file.read(12))
        inside = at < group
        known = name in _TOP or (name in _GROUP if inside else among and name in _CLUSTER)
        if not known and segment is not None and at >= segment:
            break  # what follows the segment may be anything
        if not known or (name in _NUMBERS and (size is None or size > 8)):
            return Blocks(f"no element begins at byte {at}", count, voids)
        length = 0 if name in _ENTERED else size
        if length is None or at + own + length > end:
            return Blocks(f"the element at byte {at} ends after the file", count, voids)
        if name == _SEGMENT and size is not None:
            segment = at + own + size
        if name == _GROUP_BEGINS and size is not None:
            group = at + own + size
        if name in _TOP and name not in (_VOID, _CHECKSUM):
            among = name == _CLUSTER_BEGINS
        count += name in _BLOCKS and length > _EMPTY
        voids += among and name == _VOID
        at += own + length
    short = (segment or 0) - end
    if short > 0:
        return Blocks(f"its segment ends {short} bytes after the file", count, voids)
    return Blocks("", count, voids, closed=segment is not None and at >= segment)


def track_types(file: BinaryIO) -> list[int]:
    """The type of each track (1 pictures, 2 sound, 17 subtitles) that is listed before the first cluster.

    What follows is data, in which any bytes may be. The position of the file is kept.
    """
    place, end, at = file.tell(), file.seek(0, 2), 0
    found: list[int] = []
    while at < min(end, _MAX_HEADER):
        file.seek(at)
        name, size, own = _header(file.read(12))
        if name == _TRACKS:
            file.seek(at + own)
            tracks = _elements(file.read(min(size or 0, _MAX_HEADER)))
            kinds = [dict(_elements(track)).get(_TRACK_TYPE, b"") for name, track in tracks if name == _TRACK]
            found = [int.from_bytes(kind[:8], "big") for kind in kinds]
        if not name or name in (_TRACKS, _CLUSTER_BEGINS) or (size is None and name != _SEGMENT):
            break
        at += own + (0 if name == _SEGMENT else size or 0)
    file.seek(place)
    return found


def _elements(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Name and content of each element in ``data``; ends where none begins."""
    at = 0
    while at < len(data):
        name, size, own = _header(data[at : at + 12])
        if not name or size is None:
            return
        yield name, data[at + own : at + own + size]
        at += own + size


def _header(head: bytes) -> tuple[bytes, int | None, int]:
    """Name, size (None where it is left open) and length of the header of the element that begins here."""
    width = 9 - head[0].bit_length()
    if width > 4 or len(head) <= width:
        return b"", None, 1
    own = width + 9 - head[width].bit_length()
    if own - width > 8 or len(head) < own:
        return b"", None, 1
    bits = 7 * (own - width)
    size = int.from_bytes(head[width:own], "big") & ((1 << bits) - 1)
    return head[:width], None if size == (1 << bits) - 1 else size, own
