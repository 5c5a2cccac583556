"""Keypoints in ``.npy`` and ``.npz``: plain arrays, our own archives, and archives of many sequences."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import Skeleton
from gesture_core.types import PoseSequence
from gesture_pose_files.files import (
    COPY_AGAIN,
    MAX_ARRAY_BYTES,
    MAX_MEMBERS,
    head_of,
    open_keypoints,
)
from gesture_pose_files.layout import check_seconds, sequence, skeleton_called
from gesture_pose_files.npy import read_array, read_header

_PICKLES = (".pkl", ".pickle", ".joblib")
_NPY_MAGIC = b"\x93NUMPY"
_ZIP_MAGIC = b"PK\x03\x04"
_MAX_FILE_BYTES = 2 << 30
_MAX_NAME_CHARS = 64


@dataclass(frozen=True)
class ArrayReader:
    """Reads keypoint arrays.

    - ``.npy``: (T, J, 2|3|4) or (T, 2J|3J|4J); J of 15 (MPI), 17 (COCO), 18 (OpenPose COCO), 25
      (BODY_25) or 33 (MediaPipe).
    - ``.npz`` with ``keypoints`` and, if present, ``scores``, ``times``, ``skeleton``, ``frame_size``.
    - ``.npz`` with one such array for each sequence, its key the sequence's name.

    Attributes
    ----------
    options : ReadOptions
        What files leave open. Our own archives name their joints, and say x first.
    """

    options: ReadOptions = field(default_factory=ReadOptions)

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.npy`` or ``.npz`` and begins like one."""
        suffix = path.suffix.lower()
        if suffix == ".npy":
            return head_of(path, 6) == _NPY_MAGIC
        return suffix == ".npz" and head_of(path, 4) == _ZIP_MAGIC

    def refusal(self, path: Path) -> str:
        """That pickles are not opened, or that the file is none of NumPy's."""
        if path.suffix.lower() in _PICKLES:
            return (
                "pickles are not opened, for they can run any code; save what it holds once, with "
                "np.savez('clip.npz', keypoints=…, scores=…), or a folder of such files"
            )
        return f"it does not begin as NumPy's files do, but with {head_of(path, 12)!r}"

    def members(self, path: Path) -> list[str]:
        """Names of the sequences in ``path``; ``[""]`` where it holds one."""
        if head_of(path, 4) != _ZIP_MAGIC:
            return [""]
        with _archive(path) as archive:
            names = _sequence_names(archive, path)
        return names if len(names) > 1 else [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The one sequence called ``member``, or the only one.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_FORMAT`, `E_KEYPOINTS_BROKEN`, `E_KEYPOINTS_SHAPE`, `E_KEYPOINTS_VALUE`,
            `E_KEYPOINTS_LIMIT`, `E_KEYPOINTS_MEMBER`, and those of `files.open_keypoints`.
        """
        source = printable(path) + (f"::{member}" if member else "")
        if head_of(path, 4) == _ZIP_MAGIC:
            with _archive(path) as archive:
                return [self._from_archive(archive, path, member, source)]
        if member:
            raise KeypointError(
                f"is one array, it has no member {member!r}", subject=source, code="E_KEYPOINTS_MEMBER"
            )
        with open_keypoints(path, _MAX_FILE_BYTES) as file:
            return [sequence(read_array(file, source), self.options, source=source, reader="arrays")]

    def _from_archive(self, archive: zipfile.ZipFile, path: Path, member: str, source: str) -> PoseSequence:
        keys = _keys(archive, path)
        if not member and "keypoints" in keys:
            return _own_archive(archive, keys, self.options, source)
        if not member:
            names = _sequence_names(archive, path)
            member = names[0] if len(names) == 1 else ""
        if member not in keys:
            shown = ", ".join(list(keys)[:5]) + (", …" if len(keys) > 5 else "")
            raise KeypointError(
                f"holds {len(keys)} arrays, and {member!r} is none of them",
                subject=printable(path),
                remedy=f"one of {shown}" if keys else "arrays of keypoints",
                code="E_KEYPOINTS_MEMBER",
            )
        return sequence(_array(archive, keys[member], source), self.options, source=source, reader="arrays")


def _own_archive(
    archive: zipfile.ZipFile, keys: dict[str, zipfile.ZipInfo], options: ReadOptions, source: str
) -> PoseSequence:
    points = _array(archive, keys["keypoints"], source)
    scores = _array(archive, keys["scores"], source) if "scores" in keys else None
    times = _array(archive, keys["times"], source) if "times" in keys else None
    if scores is not None and scores.shape != points.shape[:2]:
        raise KeypointError(
            f"scores {scores.shape} do not fit keypoints {points.shape}",
            subject=source,
            code="E_KEYPOINTS_SHAPE",
        )
    if times is not None and times.shape != points.shape[:1]:
        raise KeypointError(
            f"times {times.shape} do not fit keypoints {points.shape}",
            subject=source,
            code="E_KEYPOINTS_SHAPE",
        )
    if times is not None:
        check_seconds(times, source)
    body: Skeleton | None = None
    if "skeleton" in keys:
        text = _array(archive, keys["skeleton"], source, kinds="U")
        body = skeleton_called(str(text.reshape(-1)[0])[:_MAX_NAME_CHARS] if text.size == 1 else "?", source)
    size = None
    if "frame_size" in keys:
        pair = _array(archive, keys["frame_size"], source).reshape(-1)
        if len(pair) == 2 and (pair >= 1).all() and (pair < 1 << 20).all():
            size = (int(pair[0]), int(pair[1]))
    return sequence(
        points,
        options,
        source=source,
        reader="arrays",
        scores=scores,
        times=times,
        body=body,
        axes="xy" if body else None,
        frame_size=size,
    )


def _sequence_names(archive: zipfile.ZipFile, path: Path) -> list[str]:
    """Keys of the arrays with two or three axes, in the archive's order; smaller ones describe them."""
    keys = _keys(archive, path)
    if "keypoints" in keys:
        return ["keypoints"]
    return [key for key, info in keys.items() if len(_shape(archive, info, printable(path))) >= 2]


def _keys(archive: zipfile.ZipFile, path: Path) -> dict[str, zipfile.ZipInfo]:
    infos = archive.infolist()
    if len(infos) > MAX_MEMBERS:
        raise KeypointError(
            f"holds {len(infos)} members, more than {MAX_MEMBERS}",
            subject=printable(path),
            remedy="split it",
            code="E_KEYPOINTS_LIMIT",
        )
    return {info.filename.removesuffix(".npy"): info for info in infos if info.filename.endswith(".npy")}


def _shape(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str) -> tuple[int, ...]:
    with archive.open(info) as file:
        return read_header(file, f"{name}::{info.filename}")[0]


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, kinds: str = "fiu") -> np.ndarray:
    if info.file_size > MAX_ARRAY_BYTES + (1 << 16):
        raise KeypointError(
            f"{info.filename} unpacks to {info.file_size} bytes, more than the {MAX_ARRAY_BYTES} allowed",
            subject=name,
            code="E_KEYPOINTS_LIMIT",
        )
    with archive.open(info) as file:
        return read_array(file, f"{name}::{info.filename}" if "::" not in name else name, kinds=kinds)


@contextmanager
def _archive(path: Path) -> Iterator[zipfile.ZipFile]:
    with open_keypoints(path, _MAX_FILE_BYTES) as file:
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
