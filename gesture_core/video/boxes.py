"""The boxes that an ISO file (mp4, mov, 3gp) is made of (ISO 14496-12, section 4.2), read without trust."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO

MAX_BOXES = 200_000
_MAX_HEADER = 64 << 20


def top_level(file: BinaryIO) -> Iterator[tuple[int, int, bytes, int]]:
    """Position, size, kind and length of its own header, of each box of ``file``.

    A size is what the box claims: it may reach beyond the end. Ends after a box whose size makes no
    sense, which is yielded, as are bytes that are too few for a box.
    """
    end = file.seek(0, 2)
    at = 0
    for _ in range(MAX_BOXES):
        file.seek(at)
        head = file.read(16)
        if len(head) < 8:
            if head:
                yield at, 8, b"", 8
            return
        size, kind, own = _box(head)
        size = end - at if size == 0 else size  # 0: as long as the file goes on
        yield at, size, kind, own
        if size < own:
            return
        at += size


def movie_header(file: BinaryIO) -> bytes:
    """What the box `moov` holds; nothing where there is none."""
    for at, size, kind, own in top_level(file):
        if kind == b"moov":
            file.seek(at + own)
            return file.read(max(0, min(size - own, _MAX_HEADER)))
    return b""


def boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of each box in ``data``."""
    at = 0
    for _ in range(MAX_BOXES):
        if at + 8 > len(data):
            return
        size, kind, own = _box(data[at : at + 16].ljust(16, b"\0"))
        if size < own:
            return
        yield kind, data[at + own : at + size]
        at += size


def child(data: bytes, *path: bytes) -> bytes:
    """Content of the first box along ``path``; nothing where there is none."""
    for name in path:
        data = next((body for kind, body in boxes(data) if kind == name), b"")
    return data


def _box(head: bytes) -> tuple[int, bytes, int]:
    size, kind = struct.unpack_from(">I4s", head)
    if size == 1 and len(head) >= 16:
        return struct.unpack_from(">Q", head, 8)[0], kind, 16
    return size, kind, 8
