"""NumPy's array format, read with every size checked before memory is taken.

`numpy.load` trusts the header: it allocates what the header says, whatever the file holds.
"""

from __future__ import annotations

import math
import tokenize
from typing import IO

import numpy as np

from gesture_core.errors import KeypointError
from gesture_pose_files.files import COPY_AGAIN, MAX_ARRAY_BYTES

_MAGIC_BYTES = 128
MAX_HEADER = 10_000
MAX_FILE_BYTES = 2 << 30
_KINDS = "fiu"


def read_header(file: IO[bytes], name: str) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, Fortran order and dtype; the file is left at the data.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_FORMAT` for no array or one of Python objects, `E_KEYPOINTS_LIMIT` for one
        that is too large.
    """
    try:
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            shape, fortran, dtype = np.lib.format.read_array_header_1_0(file, max_header_size=MAX_HEADER)
        elif version == (2, 0):
            shape, fortran, dtype = np.lib.format.read_array_header_2_0(file, max_header_size=MAX_HEADER)
        else:
            raise ValueError(f"version {version[0]}.{version[1]} of the array format")
    except (
        ValueError, TypeError, SyntaxError, KeyError, OverflowError, RecursionError, MemoryError,
        tokenize.TokenError,
    ) as error:  # fmt: skip
        raise KeypointError(
            f"holds no NumPy array: {_first_line(error)}",
            subject=name,
            remedy=COPY_AGAIN,
            code="E_KEYPOINTS_FORMAT",
        ) from error
    if dtype.hasobject or dtype.names is not None or dtype.subdtype is not None:
        raise KeypointError(
            "holds Python objects or records, which are not read",
            subject=name,
            remedy="plain numbers of one shape, as np.stack makes them of the frames",
            code="E_KEYPOINTS_FORMAT",
        )
    if any(type(side) is not int or side < 0 for side in shape):
        raise KeypointError(f"claims the shape {shape}", subject=name, code="E_KEYPOINTS_FORMAT")
    size = math.prod(shape) * dtype.itemsize
    if size > MAX_ARRAY_BYTES:
        raise KeypointError(
            f"claims {size} bytes of data, more than the {MAX_ARRAY_BYTES} allowed",
            subject=name,
            remedy="split it",
            code="E_KEYPOINTS_LIMIT",
        )
    return shape, fortran, dtype


def read_array(file: IO[bytes], name: str, *, kinds: str = _KINDS) -> np.ndarray:
    """The array at ``file``, which may end early but never costs more than it holds.

    ``kinds`` are the dtype kinds that are wanted: ``"fiu"`` are real numbers.
    """
    shape, fortran, dtype = read_header(file, name)
    if dtype.kind not in kinds:
        raise KeypointError(
            f"holds {dtype}, expected {'text' if kinds == 'U' else 'real numbers'}",
            subject=name,
            code="E_KEYPOINTS_FORMAT",
        )
    count = math.prod(shape)
    data = _read_up_to(file, count * dtype.itemsize)
    if len(data) < count * dtype.itemsize:
        raise KeypointError(
            f"ends after {len(data)} of {count * dtype.itemsize} bytes of data",
            subject=name,
            remedy=COPY_AGAIN,
            code="E_KEYPOINTS_BROKEN",
        )
    array: np.ndarray = np.frombuffer(data, dtype, count)
    return array.reshape(shape, order="F" if fortran else "C")


def _read_up_to(file: IO[bytes], size: int) -> bytearray:
    """At most ``size`` bytes in pieces, so that memory follows what is there, not what is claimed."""
    data = bytearray()
    while len(data) < size:
        piece = file.read(min(size - len(data), 1 << 20))
        if not piece:
            break
        data += piece
    return data


def _first_line(error: BaseException) -> str:
    text = str(error) or type(error).__name__
    return text.splitlines()[0][:200]
