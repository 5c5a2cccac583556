"""Opens keypoint files that nobody vouches for: regular files only, no larger than agreed."""

from __future__ import annotations

import os
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from gesture_core.errors import KeypointError

MAX_FRAMES = 500_000
MAX_ARRAY_BYTES = 128 << 20
MAX_JSON_BYTES = 2 << 20
MAX_CSV_BYTES = 512 << 20
MAX_MEMBERS = 20_000
COPY_AGAIN = "copy it again from where it came"


def printable(path: str | os.PathLike[str]) -> str:
    """``path`` as text that can be encoded, whatever bytes the file name holds."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def open_regular(path: Path, max_bytes: int) -> BinaryIO:
    """Open the regular file ``path`` of at most ``max_bytes`` for reading.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_MISSING`, `E_KEYPOINTS_UNREADABLE`, `E_KEYPOINTS_EMPTY`, `E_KEYPOINTS_LIMIT`.
    """
    name = printable(path)
    try:
        # Without O_NONBLOCK a named pipe would hang the process before it could be refused.
        fd = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        raise KeypointError("no such file", subject=name, code="E_KEYPOINTS_MISSING") from None
    except (OSError, ValueError) as error:
        cause = getattr(error, "strerror", None) or str(error)
        raise KeypointError(
            f"cannot be opened: {cause}", subject=name, code="E_KEYPOINTS_UNREADABLE"
        ) from error
    status = os.fstat(fd)
    try:
        if not stat.S_ISREG(status.st_mode):
            raise KeypointError("is not a regular file", subject=name, code="E_KEYPOINTS_UNREADABLE")
        if status.st_size == 0:
            raise KeypointError(
                "is empty, 0 bytes", subject=name, remedy=COPY_AGAIN, code="E_KEYPOINTS_EMPTY"
            )
        if status.st_size > max_bytes:
            raise KeypointError(
                f"has {status.st_size} bytes, more than the {max_bytes} that such a file may have",
                subject=name,
                remedy="split it",
                code="E_KEYPOINTS_LIMIT",
            )
    except KeypointError:
        os.close(fd)
        raise
    return os.fdopen(fd, "rb")


def head_of(path: Path, count: int) -> bytes:
    """The first ``count`` bytes of ``path``, none where it is no regular file.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_UNREADABLE` where the file is there and cannot be read: whose it is, nobody can say.
    """
    try:
        with open_regular(path, 1 << 62) as file:
            return file.read(count)
    except KeypointError as error:
        if isinstance(error.__cause__, OSError):
            raise
        return b""
    except OSError as error:
        raise KeypointError(
            f"cannot be read: {error.strerror}", subject=printable(path), code="E_KEYPOINTS_UNREADABLE"
        ) from error


def check_size(frame_size: Sequence[int]) -> tuple[int, int]:
    """``frame_size`` as (width, height); refused where no picture can have it."""
    size = tuple(frame_size)
    if len(size) != 2 or not all(isinstance(side, int) and 0 < side < 1 << 20 for side in size):
        raise ValueError(f"frame_size is {frame_size!r}, it must be two whole numbers of pixels")
    return size[0], size[1]


def check_options(fps: float, people: str) -> None:
    """Refuse options that no reader can honour."""
    if not 0 < fps < 100_000:
        raise ValueError(f"fps is {fps!r}, it must be above zero")
    if people not in ("single", "multi"):
        raise ValueError(f"people is {people!r}, it must be 'single' or 'multi'")
