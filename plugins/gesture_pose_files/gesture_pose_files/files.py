"""Opens keypoint files, which are not trusted, and checks options that all readers share."""

from __future__ import annotations

import bz2
import gzip
import io
import os
import zlib
from pathlib import Path
from typing import Any, BinaryIO, cast

from gesture_core.errors import KeypointError
from gesture_core.files import open_regular, printable

MAX_FRAMES = 500_000
MAX_ARRAY_BYTES = 128 << 20
MAX_JSON_BYTES = 2 << 20
MAX_LIST_BYTES = 128 << 20
MAX_CSV_BYTES = 512 << 20
MAX_MEMBERS = 20_000
_CODES = ("E_KEYPOINTS_MISSING", "E_KEYPOINTS_UNREADABLE", "E_KEYPOINTS_LIMIT")
COPY_AGAIN = "copy it again from where it came"
PACKED = (".gz", ".bz2")


def suffix_of(path: Path) -> str:
    """The suffix of a file, lower case: of ``clip.csv.gz`` it is ``.csv``."""
    suffix = path.suffix.lower()
    return path.with_suffix("").suffix.lower() if suffix in PACKED else suffix


def open_keypoints(path: Path, max_bytes: int) -> BinaryIO:
    """Open the regular file ``path`` of 1 to ``max_bytes`` bytes for reading, unpacked where it is packed.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_MISSING`, `E_KEYPOINTS_UNREADABLE`, `E_KEYPOINTS_EMPTY`, `E_KEYPOINTS_LIMIT`.
    """
    try:
        file = open_regular(path, max_bytes, KeypointError, _CODES)
    except KeypointError as error:
        if error.code == "E_KEYPOINTS_LIMIT":
            error.remedy = "split it"
        raise
    if os.fstat(file.fileno()).st_size == 0:
        file.close()
        raise KeypointError(
            "is empty, 0 bytes", subject=printable(path), remedy=COPY_AGAIN, code="E_KEYPOINTS_EMPTY"
        )
    if path.suffix.lower() in PACKED:
        return cast(BinaryIO, io.BufferedReader(_Unpacked(file, path, max_bytes)))
    return file


class _Unpacked(io.RawIOBase):
    """A packed file as what it holds, of at most so many bytes, whatever it would unpack to."""

    def __init__(self, file: BinaryIO, path: Path, most: int) -> None:
        self._file, self._path, self._room = file, path, most
        gzipped = path.suffix.lower() == ".gz"
        self._inner = gzip.GzipFile(fileobj=file) if gzipped else bz2.BZ2File(file)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        try:
            data = self._inner.read(len(buffer))
        except (EOFError, OSError, zlib.error) as error:
            raise KeypointError(
                f"cannot be unpacked: {error}",
                subject=printable(self._path),
                remedy=COPY_AGAIN,
                code="E_KEYPOINTS_BROKEN",
            ) from error
        self._room -= len(data)
        if self._room < 0:
            raise KeypointError(
                "unpacks to more than is allowed",
                subject=printable(self._path),
                remedy="split it",
                code="E_KEYPOINTS_LIMIT",
            )
        buffer[: len(data)] = data
        return len(data)

    def close(self) -> None:
        self._file.close()
        super().close()


def head_of(path: Path, count: int) -> bytes:
    """The first ``count`` bytes of ``path``, none where it is no regular file.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_UNREADABLE`, `E_KEYPOINTS_BROKEN` where the file exists and cannot be read or unpacked,
        so that its format is unknown.
    """
    try:
        with open_keypoints(path, 1 << 62) as file:
            return file.read(count)
    except KeypointError as error:
        unreadable = error.code == "E_KEYPOINTS_UNREADABLE" and isinstance(error.__cause__, OSError)
        if unreadable or error.code == "E_KEYPOINTS_BROKEN":
            raise
        return b""
    except OSError as error:
        raise KeypointError(
            f"cannot be read: {error.strerror}", subject=printable(path), code="E_KEYPOINTS_UNREADABLE"
        ) from error
