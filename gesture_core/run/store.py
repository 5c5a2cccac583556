"""The keypoint store: one Parquet file for each (content, pose settings), verified when read, and kept
below its limit.

A file has one row for each person and frame, the columns ``person``, ``time`` and, for every joint,
``<joint>_x``, ``<joint>_y`` and ``<joint>_score``; missing joints are null. Facts about the input
and a checksum of the numbers are in the schema's metadata under ``gesture_core``.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gesture_core.errors import KeypointError, RunFolderError
from gesture_core.files import TEMPORARY, cache_dir, open_regular, replacing
from gesture_core.skeletons import COCO18, skeleton
from gesture_core.types import PoseSequence

FORMAT = 2
_METADATA = b"gesture_core"
_MAGIC = b"PAR1"
_MAX_BYTES = 1 << 30
_MAX_ROWS = 5_000_000
_TYPES: Mapping[str, type] = {"person": np.int32, "time": np.float64}
"""Of columns; coordinates and scores are float32."""
SPARED_SECONDS = 86_400.0
"""What was used in the last day stays, whatever the limit: another run may be about to read it."""


@dataclass(frozen=True, eq=False)
class Stored:
    """What one file of the store holds.

    Attributes
    ----------
    sequences : list of PoseSequence
        One for each person.
    facts : mapping
        About the input: frames declared and read, completeness, notes, seconds, plugin.
    """

    sequences: list[PoseSequence]
    facts: Mapping[str, Any]


def keypoint_store() -> Path:
    """Folder of the keypoint store, shared by all runs."""
    return cache_dir() / "keypoints"


@contextmanager
def storing(folder: Path | str) -> Iterator[None]:
    """What the system refuses ends the run: no other input could be kept either."""
    try:
        yield
    except OSError as error:
        raise RunFolderError(
            f"keypoints cannot be written to {folder}: {error.strerror or error}",
            remedy="free space there, or name another folder in GESTURE_CACHE",
            code="E_STORE_WRITE",
        ) from error


def write_keypoints(path: Path, sequences: Sequence[PoseSequence], facts: Mapping[str, Any]) -> None:
    """Write ``sequences``, all of one skeleton, and ``facts`` (plain values) to a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    name = sequences[0].skeleton if sequences else COCO18.name
    joints = len(skeleton(name).joints)
    person = np.concatenate([np.empty(0), *(np.full(len(s), s.person) for s in sequences)])
    times = np.concatenate([np.empty(0), *(s.times for s in sequences)])
    points = np.concatenate([np.empty((0, joints, 2)), *(s.keypoints for s in sequences)])
    scores = np.concatenate([np.empty((0, joints)), *(s.scores for s in sequences)])
    values = np.concatenate([points, scores[..., None]], axis=2).reshape(len(points), 3 * joints)
    columns = {
        column: np.ascontiguousarray(array.astype(_TYPES.get(column, np.float32)))
        for column, array in zip(_columns(name), (person, times, *values.T), strict=True)
    }
    header = {
        "format": FORMAT,
        "skeleton": name,
        "people": [
            {"person": int(s.person), "frame_size": s.frame_size, "provenance": dict(s.provenance)}
            for s in sequences
        ],
        "facts": dict(facts),
    }
    header["checksum"] = _checksum(header, columns)
    arrays = {key: pa.array(column, from_pandas=True) for key, column in columns.items()}
    table = pa.table(arrays).replace_schema_metadata({_METADATA: json.dumps(header, sort_keys=True)})
    with replacing(path) as temporary:
        pq.write_table(table, os.fspath(temporary), compression="zstd")


def read_keypoints(path: Path, source: str = "") -> Stored:
    """Read a file of the store.

    Raises
    ------
    KeypointError
        ``E_STORE`` where it is damaged, was written by another version, or does not match its
        checksum.
    """
    subject = source or path.name
    try:
        return _read(path, subject)
    except (Exception, RecursionError) as error:
        cause = error.cause if isinstance(error, KeypointError) else str(error)
        raise KeypointError(
            f"not a whole keypoint file: {cause}",
            subject=subject,
            remedy="delete it and extract again",
            code="E_STORE",
        ) from error


def _read(path: Path, source: str) -> Stored:
    import pyarrow.parquet as pq

    with open_regular(path, _MAX_BYTES, KeypointError, ("E_STORE", "E_STORE", "E_STORE")) as file:
        parquet = pq.ParquetFile(file)
        if parquet.metadata.num_rows > _MAX_ROWS:
            raise ValueError(f"{parquet.metadata.num_rows} rows, at most {_MAX_ROWS}")
        header = json.loads((parquet.schema_arrow.metadata or {})[_METADATA])
        if header["format"] != FORMAT:
            raise ValueError(f"format {header['format']}, this version reads {FORMAT}")
        names = _columns(header["skeleton"])
        table = parquet.read(columns=names)
    columns = {
        name: table.column(name).to_numpy().astype(_TYPES.get(name, np.float32), copy=False) for name in names
    }
    if _checksum(header, columns) != header["checksum"]:
        raise ValueError("the content does not match its checksum")
    person, times, *values = columns.values()
    joints = np.stack(values, axis=1).reshape(len(times), len(values) // 3, 3)
    sequences = []
    for entry in header["people"]:
        rows, size = person == int(entry["person"]), entry["frame_size"]
        sequences.append(
            PoseSequence(
                joints[rows, :, :2],
                joints[rows, :, 2],
                times[rows],
                header["skeleton"],
                (int(size[0]), int(size[1])) if size else None,
                int(entry["person"]),
                source,
                {str(key): str(value) for key, value in entry["provenance"].items()},
            )
        )
    return Stored(sequences, dict(header["facts"]))


def _columns(name: str) -> list[str]:
    joints = skeleton(name).joints
    return ["person", "time", *(f"{joint}_{part}" for joint in joints for part in ("x", "y", "score"))]


def _checksum(header: Mapping[str, Any], columns: Mapping[str, np.ndarray]) -> str:
    """Of the header (without the checksum itself) and the numbers."""
    facts = {key: value for key, value in header.items() if key != "checksum"}
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for name, column in columns.items():
        digest.update(name.encode() + np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


class StoreReader:
    """Reads the files that `gesture extract` writes, as inputs or examples."""

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is a Parquet file by name and first bytes."""
        if path.suffix.lower() != ".parquet" or not path.is_file():
            return False
        with path.open("rb") as file:
            return file.read(4) == _MAGIC

    def members(self, path: Path) -> list[str]:
        """Always one sequence."""
        return [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The sequences of the file, one for each person."""
        if member:
            raise KeypointError(f"has no member {member!r}", subject=path.name, code="E_KEYPOINTS_MEMBER")
        return read_keypoints(path).sequences


def mark_used(path: Path) -> None:
    """Note that a file of the store has been used now."""
    with suppress(OSError):  # a store that may only be read is as good
        os.utime(path)


def prune(store: Path, mebibytes: int) -> int:
    """Delete the files of the store that were used longest ago until the others fit.

    Parameters
    ----------
    store : Path
        Its files are in folders one level down.
    mebibytes : int
        What may stay, apart from what was used in the last day. Temporary files that a killed run
        left more than a day ago go in any case.

    Returns
    -------
    int
        Files that were deleted.
    """
    old = time.time() - SPARED_SECONDS
    found = []
    with suppress(FileNotFoundError):
        for folder in os.scandir(store):
            for entry in os.scandir(folder) if folder.is_dir(follow_symlinks=False) else ():
                with suppress(FileNotFoundError):
                    facts = entry.stat(follow_symlinks=False)
                    found.append((facts.st_mtime, facts.st_size, Path(entry.path)))
    room, gone = mebibytes << 20, 0
    for used, size, path in sorted(found, reverse=True):
        room -= size
        if used < old and (room < 0 or TEMPORARY in path.name):
            with suppress(OSError):  # another run was quicker, or it is not ours to delete
                path.unlink()
                gone += 1
    return gone
