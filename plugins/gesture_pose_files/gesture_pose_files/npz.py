"""NumPy's archives (``.npz``), whose members are known by their headers before any is unpacked."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_pose_files.files import COPY_AGAIN, MAX_ARRAY_BYTES, MAX_MEMBERS, open_keypoints
from gesture_pose_files.npy import MAX_FILE_BYTES, read_array, read_header

Members = dict[str, zipfile.ZipInfo]


def members_of(archive: zipfile.ZipFile, path: Path) -> Members:
    """The arrays in an archive by name; at most `files.MAX_MEMBERS`."""
    infos = archive.infolist()
    if len(infos) > MAX_MEMBERS:
        raise KeypointError(
            f"holds {len(infos)} members, more than {MAX_MEMBERS}",
            subject=printable(path),
            remedy="split it",
            code="E_KEYPOINTS_LIMIT",
        )
    return {info.filename.removesuffix(".npy"): info for info in infos if info.filename.endswith(".npy")}


def shape_of(
    archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, *, objects: bool = False
) -> tuple[int, ...]:
    """The shape that a member's header claims; ``()`` of Python ``objects`` where these may be there."""
    with archive.open(info) as file:
        try:
            return read_header(file, f"{name}::{info.filename}")[0]
        except KeypointError as error:
            if objects and error.code == "E_KEYPOINTS_FORMAT":
                return ()
            raise


def array_in(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, kinds: str = "fiu") -> np.ndarray:
    """A member, unpacked; ``kinds`` as in `npy.read_array`."""
    if info.file_size > MAX_ARRAY_BYTES + (1 << 16):
        raise KeypointError(
            f"{info.filename} unpacks to {info.file_size} bytes, more than the {MAX_ARRAY_BYTES} allowed",
            subject=name,
            code="E_KEYPOINTS_LIMIT",
        )
    with archive.open(info) as file:
        return read_array(file, f"{name}::{info.filename}" if "::" not in name else name, kinds=kinds)


@contextmanager
def opened(path: Path) -> Iterator[zipfile.ZipFile]:
    """The archive at ``path``; what is broken in it, then or later, is an E_KEYPOINTS_BROKEN."""
    with open_keypoints(path, MAX_FILE_BYTES) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                yield archive
        except (
            zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError,
            OSError, ValueError, OverflowError, IndexError, struct.error,
        ) as error:  # fmt: skip
            # zipfile raises RuntimeError for an encrypted member.
            raise KeypointError(
                f"is a broken archive: {error}",
                subject=printable(path),
                remedy=COPY_AGAIN,
                code="E_KEYPOINTS_BROKEN",
            ) from error
