"""The keypoint store: one Parquet file for each (content, pose settings), verified when read.

A file has one row for each person and frame, the columns ``person``, ``time`` and, for every joint,
``<joint>_x``, ``<joint>_y`` and ``<joint>_score``; missing joints are null. Facts about the input
and a checksum of the numbers are in the schema's metadata under ``gesture_core``.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.run.atomic import replacing
from gesture_core.skeletons import COCO18, skeleton
from gesture_core.types import PoseSequence

FORMAT = 2
_METADATA = b"gesture_core"
_MAGIC = b"PAR1"
_MAX_BYTES = 1 << 30
_MAX_ROWS = 5_000_000


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


def write_keypoints(path: Path, sequences: Sequence[PoseSequence], facts: Mapping[str, Any]) -> None:
    """Write ``sequences``, all of one skeleton, and ``facts`` (plain values) to a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    name = sequences[0].skeleton if sequences else COCO18.name
    joints = skeleton(name).joints
    columns = {
        "person": _stack([np.full(len(s), s.person, np.int32) for s in sequences], (), np.int32),
        "time": _stack([s.times for s in sequences], (), np.float64),
    }
    points = _stack([s.keypoints for s in sequences], (len(joints), 2), np.float32)
    scores = _stack([s.scores for s in sequences], (len(joints),), np.float32)
    for index, joint in enumerate(joints):
        columns[f"{joint}_x"] = points[:, index, 0]
        columns[f"{joint}_y"] = points[:, index, 1]
        columns[f"{joint}_score"] = scores[:, index]
    header = {
        "format": FORMAT,
        "skeleton": name,
        "people": [
            {"person": s.person, "frame_size": s.frame_size, "provenance": dict(s.provenance)}
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
        raise KeypointError(
            f"not a whole keypoint file: {error}",
            subject=subject,
            remedy="delete it and extract again",
            code="E_STORE",
        ) from error


def _read(path: Path, subject: str) -> Stored:
    import pyarrow.parquet as pq

    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"larger than {_MAX_BYTES} bytes")
    with path.open("rb") as file:
        parquet = pq.ParquetFile(file)
        if parquet.metadata.num_rows > _MAX_ROWS:
            raise ValueError(f"{parquet.metadata.num_rows} rows, at most {_MAX_ROWS}")
        header = json.loads((parquet.schema_arrow.metadata or {})[_METADATA])
        if header["format"] != FORMAT:
            raise ValueError(f"format {header['format']}, this version reads {FORMAT}")
        names = _names(skeleton(header["skeleton"]).joints)
        table = parquet.read(columns=names)
    columns = {name: _column(table, name) for name in names}
    if _checksum(header, columns) != header["checksum"]:
        raise ValueError("the content does not match its checksum")
    sequences = [_sequence(entry, header["skeleton"], columns, subject) for entry in header["people"]]
    return Stored(sequences, dict(header["facts"]))


def _names(joints: Sequence[str]) -> list[str]:
    return ["person", "time", *(f"{joint}_{part}" for joint in joints for part in ("x", "y", "score"))]


def _column(table: Any, name: str) -> np.ndarray:
    dtype = {"person": np.int32, "time": np.float64}.get(name, np.float32)
    return table.column(name).to_numpy().astype(dtype, copy=False)


def _sequence(
    entry: Mapping[str, Any], name: str, columns: Mapping[str, np.ndarray], source: str
) -> PoseSequence:
    rows = columns["person"] == int(entry["person"])
    joints = skeleton(name).joints
    x = np.stack([columns[f"{joint}_x"][rows] for joint in joints], axis=1)
    y = np.stack([columns[f"{joint}_y"][rows] for joint in joints], axis=1)
    scores = np.stack([columns[f"{joint}_score"][rows] for joint in joints], axis=1)
    size = entry["frame_size"]
    return PoseSequence(
        np.stack([x, y], axis=2),
        scores,
        columns["time"][rows],
        name,
        (int(size[0]), int(size[1])) if size else None,
        int(entry["person"]),
        source,
        {str(key): str(value) for key, value in entry["provenance"].items()},
    )


def _stack(parts: Sequence[np.ndarray], shape: tuple[int, ...], dtype: type) -> np.ndarray:
    return np.concatenate([np.empty((0, *shape), dtype), *parts])


def _checksum(header: Mapping[str, Any], columns: Mapping[str, np.ndarray]) -> str:
    """Of the header (without the checksum itself) and the numbers."""
    told = {key: value for key, value in header.items() if key != "checksum"}
    digest = hashlib.sha256(json.dumps(told, sort_keys=True).encode())
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
