"""MATLAB's files of version 5 to 7.2, read without trust: arrays of real numbers, and nothing else in them.

SciPy's reader ends the process where such a file is damaged. The format: *MAT-File Format*, The MathWorks.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod

import numpy as np

from gesture_core.errors import KeypointError
from gesture_pose_files.files import COPY_AGAIN, MAX_LIST_BYTES

_HEADER, _COMPRESSED, _MATRIX = 128, 15, 14
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Of elements, by their numbers."""
_NUMERIC = range(6, 16)
"""Classes of arrays: double to uint64."""
_COMPLEX, _LONGEST_NAME, _MOST_AXES = 0x08, 64, 8


@dataclass(frozen=True)
class Variable:
    """An array of real numbers: its shape, and how it is stored."""

    shape: tuple[int, ...]
    kind: np.dtype
    data: bytes

    def array(self) -> np.ndarray:
        """The numbers, as float64."""
        return np.frombuffer(self.data, self.kind).astype(np.float64).reshape(self.shape, order="F")


def variables_in(data: bytes, source: str) -> dict[str, Variable]:
    """The arrays of real numbers in a file, by name; structures, cells and text are left out.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_BROKEN`, `E_KEYPOINTS_LIMIT`.
    """
    try:
        order = {b"IM": "<", b"MI": ">"}[data[126:128]]
        found, room = {}, MAX_LIST_BYTES
        for kind, content in _elements(data[_HEADER:], order):
            if kind == _COMPRESSED:
                unpacked = zlib.decompressobj().decompress(content, room + 1)
                room -= len(unpacked)
                if room < 0:
                    raise KeypointError(
                        f"unpacks to more than the {MAX_LIST_BYTES} bytes allowed",
                        subject=source,
                        remedy="split it",
                        code="E_KEYPOINTS_LIMIT",
                    )
                kind, content = next(_elements(unpacked, order))
            if kind == _MATRIX and (held := _matrix(content, order)):
                found[held[0]] = held[1]
        return found
    except (KeyError, ValueError, StopIteration, struct.error, zlib.error, UnicodeError, IndexError) as error:
        raise KeypointError(
            f"is damaged: {str(error) or type(error).__name__}",
            subject=source,
            remedy=COPY_AGAIN,
            code="E_KEYPOINTS_BROKEN",
        ) from error


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and content of each element in turn."""
    place = 0
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:  # a short one, with its content in its tag
            size, kind = kind >> 16, kind & 0xFFFF
            start, place = place + 4, place + 8
            if size > 4:
                raise ValueError(f"a short element of {size} bytes")
        else:
            start = place + 8
            place = start + size + (-size % 8 if kind != _COMPRESSED else 0)
        if start + size > len(data):
            raise ValueError(f"an element of {size} bytes where {len(data) - start} are left")
        yield kind, data[start : start + size]


def _matrix(data: bytes, order: str) -> tuple[str, Variable] | None:
    """Name and numbers of an array; None where it is none of real numbers."""
    parts = _elements(data, order)
    flags = struct.unpack(f"{order}II", next(parts)[1])[0]
    if flags & 0xFF not in _NUMERIC or flags >> 8 & _COMPLEX:
        return None
    sides = next(parts)[1]
    shape = struct.unpack(f"{order}{len(sides) // 4}i", sides)
    name = next(parts)[1].decode("ascii")
    kind, content = next(parts)
    numbers = np.dtype(f"{order}{_TYPES[kind]}")
    if not 2 <= len(shape) <= _MOST_AXES or min(shape) < 0 or not 0 < len(name) <= _LONGEST_NAME:
        raise ValueError(f"an array {name[:40]!r} of shape {shape}")
    if prod(shape) * numbers.itemsize != len(content):
        raise ValueError(f"{len(content)} bytes for an array of shape {shape}")
    return name, Variable(shape, numbers, content)
