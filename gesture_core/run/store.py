"""What came of the extraction of an input, and the keypoint store.

The store is one Parquet file for each (content, pose settings), verified when read, and kept below its limit.

A file has one row for each person and frame, the columns ``person``, ``time`` and, for every joint,
``<joint>_x``, ``<joint>_y`` and ``<joint>_score``; missing joints are null. Of a recording it has a row for
each sample, and a column for each channel. Facts about the input
and a checksum of the numbers are in the schema's metadata under ``gesture_core``.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gesture_core.errors import GestureError, KeypointError, RunFolderError
from gesture_core.files import TEMPORARY, cache_dir, open_regular, replacing
from gesture_core.skeletons import COCO18, skeleton
from gesture_core.types import PoseSequence, Recording

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
    sequences : list of PoseSequence, or of one Recording
        One for each person.
    facts : mapping
        About the input: frames declared and read, completeness, notes, seconds, plugin.
    """

    sequences: list[Any]
    facts: Mapping[str, Any]


class Seen(NamedTuple):
    """A person in an input: number, frames with a pose, seconds of the first and last of them, and where."""

    person: int
    frames: int
    start: float
    end: float
    box: tuple[float, ...]

    @classmethod
    def of(cls, sequence: PoseSequence | Recording) -> Seen:
        """The facts of a sequence with a pose."""
        times = sequence.times[sequence.seen.any(axis=1)]
        frames, first, last = len(times), float(times[0]), float(times[-1])
        return cls(int(sequence.person), frames, first, last, sequence.box)


@dataclass(frozen=True)
class Extracted:
    """What came of the extraction of one input: keypoints in the store, or an error.

    Attributes
    ----------
    sha256 : str
        Of the content; empty where it could not be read.
    stamp : str
        Of the file as it was read, from `files.stamp`.
    stored : str
        File name in the keypoint store; empty after an error.
    cached : bool
        The keypoints were already there.
    people : tuple of Seen
    frames_declared : int or None
        What the container claims.
    frames_read : int
        All of them, decoded.
    frames_looked_at : int
        Those of them in which people were looked for.
    complete : bool
        No frame is known to be lost.
    notes : tuple of str
        What was wrong with the input, or is worth knowing of it.
    assumed : str
        What the input does not say and its reader assumed, where anything was.
    seconds : float
        Length of what was read.
    plugin : str
        Distribution and version of the backend or reader.
    code, message : str
        Of the error; empty after success.
    attempts : int
    """

    sha256: str = ""
    stamp: str = ""
    stored: str = ""
    cached: bool = False
    people: tuple[Seen, ...] = ()
    frames_declared: int | None = None
    frames_read: int = 0
    frames_looked_at: int = 0
    complete: bool = True
    notes: tuple[str, ...] = ()
    assumed: str = ""
    seconds: float = 0.0
    plugin: str = ""
    code: str = ""
    message: str = ""
    attempts: int = 1

    @classmethod
    def from_tree(cls, tree: Mapping[str, Any]) -> Extracted:
        """The inverse of `asdict`, after JSON."""
        people = tuple(Seen._make([*facts, tuple(box)]) for *facts, box in tree["people"])
        return cls(**{**tree, "notes": tuple(tree["notes"]), "people": people})

    def error(self, name: str) -> GestureError:
        """Why there are no keypoints of the input, which is called ``name``."""
        return GestureError(self.message, subject=name, code=self.code)

    def failed(self, error: GestureError) -> Extracted:
        """The same input without keypoints: ``error`` is why, without a subject, which the row names."""
        return replace(self, stored="", code=error.code, message=error.reason)

    def holding(self, stored: Stored, name: str, *, cached: bool = False) -> Extracted:
        """The same input with its keypoints in the store, under ``name``."""
        names = ("frames_declared", "frames_read", "frames_looked_at", "complete", "seconds")
        return replace(
            self,
            stored=name,
            cached=cached,
            people=tuple(map(Seen.of, stored.sequences)),
            notes=tuple(stored.facts["notes"]),
            assumed=stored.facts.get("assumed", ""),
            **{name: stored.facts[name] for name in names},
        )


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


def write_keypoints(
    path: Path, sequences: Sequence[PoseSequence | Recording], facts: Mapping[str, Any]
) -> None:
    """Write ``sequences``, all of one skeleton or one recording, and ``facts`` (plain values) to a file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    header: dict[str, Any] = {"format": FORMAT, **_layout(sequences), "facts": dict(facts)}
    header["people"] = [
        {
            "person": int(s.person),
            "frame_size": getattr(s, "frame_size", None),
            "provenance": dict(s.provenance),
        }
        for s in sequences
    ]
    names = _columns(header)
    person = np.concatenate([np.empty(0), *[np.full(len(s), s.person) for s in sequences]])
    times = np.concatenate([np.empty(0), *[s.times for s in sequences]])
    values = np.concatenate([np.empty((0, len(names) - 2)), *map(_values, sequences)])
    columns = {
        column: np.ascontiguousarray(array.astype(_TYPES.get(column, np.float32)))
        for column, array in zip(names, (person, times, *values.T), strict=True)
    }
    header["checksum"] = _checksum(header, columns)
    arrays = {key: pa.array(column, from_pandas=True) for key, column in columns.items()}
    table = pa.table(arrays).replace_schema_metadata({_METADATA: json.dumps(header, sort_keys=True)})
    with replacing(path) as temporary:
        pq.write_table(table, os.fspath(temporary), compression="zstd")


def _layout(sequences: Sequence[PoseSequence | Recording]) -> dict[str, Any]:
    """What the columns are: a skeleton, in how many dimensions unless they are two, or channels."""
    first = sequences[0] if sequences else None
    if isinstance(first, Recording):
        return {"channels": list(first.channels)}
    if first is None:
        return {"skeleton": COCO18.name}
    dimensions = first.keypoints.shape[2]
    return {"skeleton": first.skeleton} | ({"dimensions": dimensions} if dimensions != 2 else {})


def _values(sequence: PoseSequence | Recording) -> np.ndarray:
    """(T, columns) numbers of one sequence."""
    if isinstance(sequence, Recording):
        return sequence.values
    whole = np.concatenate([sequence.keypoints, sequence.scores[..., None]], axis=2)
    return whole.reshape(len(sequence), -1)


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
        names = _columns(header)
        table = parquet.read(columns=names)
    columns = {
        name: table.column(name).to_numpy().astype(_TYPES.get(name, np.float32), copy=False) for name in names
    }
    if _checksum(header, columns) != header["checksum"]:
        raise ValueError("the content does not match its checksum")
    person, times, *values = columns.values()
    table_of = np.stack(values, axis=1)
    sequences: list[PoseSequence | Recording] = []
    for entry in header["people"]:
        rows, size = person == int(entry["person"]), entry["frame_size"]
        provenance = {str(key): str(value) for key, value in entry["provenance"].items()}
        if "channels" in header:
            channels = tuple(map(str, header["channels"]))
            sequences.append(Recording(table_of[rows], times[rows], channels, source, provenance))
            continue
        width = header.get("dimensions", 2)
        joints = table_of[rows].reshape(int(rows.sum()), -1, width + 1)
        sequences.append(
            PoseSequence(
                joints[:, :, :width],
                joints[:, :, width],
                times[rows],
                header["skeleton"],
                (int(size[0]), int(size[1])) if size else None,
                int(entry["person"]),
                source,
                provenance,
            )
        )
    return Stored(sequences, dict(header["facts"]))


def _columns(header: Mapping[str, Any]) -> list[str]:
    if "channels" in header:
        return ["person", "time", *(f"channel {name}" for name in header["channels"])]
    parts = (*"xyz"[: header.get("dimensions", 2)], "score")
    joints = skeleton(header["skeleton"]).joints
    return ["person", "time", *(f"{joint}_{part}" for joint in joints for part in parts)]


def _checksum(header: Mapping[str, Any], columns: Mapping[str, np.ndarray]) -> str:
    """Of the header (without the checksum itself) and the numbers."""
    facts = dict(header)
    facts.pop("checksum", None)
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for name, column in columns.items():
        digest.update(name.encode() + np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


class StoreReader:
    """Reads the files that `gesture extract` writes, as inputs or examples."""

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is a Parquet file of ours, or one that is damaged and may be."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        if path.suffix.lower() != ".parquet" or not path.is_file():
            return False
        with path.open("rb") as file:
            if file.read(4) != _MAGIC:
                return False
            try:
                return _METADATA in (pq.read_schema(file).metadata or {})
            except (pa.ArrowException, OSError, ValueError):
                return True

    def members(self, path: Path) -> list[str]:
        """Always one sequence."""
        return [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The sequences of the file, one for each person; no recording of channels."""
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
