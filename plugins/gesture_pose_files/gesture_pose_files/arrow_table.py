"""Tables of keypoints in Parquet and Feather, as data-frame libraries of Python, R and Julia write them."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_pose_files.files import (
    COPY_AGAIN,
    MAX_ARRAY_BYTES,
    MAX_CSV_BYTES,
    MAX_FRAMES,
    head_of,
    open_keypoints,
)
from gesture_pose_files.json_table import JsonTableReader

_OWN = b"gesture_core"
"""In the metadata of the files of `gesture extract`, which have a reader of their own."""
_MAGIC = {".parquet": b"PAR1", ".feather": b"ARROW1", ".arrow": b"ARROW1"}
_MAX_ROWS = 64 * MAX_FRAMES
_BATCH = 256
"""Rows of Parquet that are unpacked at once: one may be a long text."""
_BLOCK = np.dtype([("offset", "<i8"), ("head", "<i4"), ("", "<i4"), ("body", "<i8")])
_PAIR = np.dtype([("first", "<i8"), ("second", "<i8")])


class ArrowTableReader(JsonTableReader):
    """Reads Parquet and Feather with a row for each frame, or for each joint.

    The columns are what they are in CSV; those of lists and of structs are what they are in JSON.
    """

    name = "arrow-table"

    def accepts(self, path: Path) -> bool:
        """Whether the columns of a table name joints; a file that this package wrote is another's."""
        magic = _MAGIC.get(path.suffix.lower())
        return bool(magic) and head_of(path, len(magic or b"")) == magic and self._is_clip(path)

    def refusal(self, path: Path) -> str:
        """What its columns are called."""
        try:
            names, _, _ = self._table(path)
        except KeypointError as error:
            return error.cause
        return f"its columns {', '.join(names[:6])}, … name no joints, as nose_x, nose_y, … would"

    def _tree(self, path: Path, *, head: bool = False) -> Any:
        import pyarrow as pa
        import pyarrow.parquet

        with open_keypoints(path, MAX_CSV_BYTES) as file:
            try:
                if path.suffix.lower() == ".parquet":
                    opened = pa.parquet.ParquetFile(file)
                    if _OWN in (opened.schema_arrow.metadata or {}):
                        raise KeypointError("is of gesture extract", code="E_KEYPOINTS_FORMAT")
                    size, values = size_of(opened.metadata)
                    if opened.metadata.num_rows > _MAX_ROWS or max(size, 8 * values) > MAX_ARRAY_BYTES:
                        raise _too_large(path)
                    return _rows(islice(opened.iter_batches(_BATCH), 1 if head else None), path)
                size, values = size_of_feather(file)
                if max(size, 8 * values) > MAX_ARRAY_BYTES:
                    raise _too_large(path)
                stored = pa.ipc.open_file(file)
                batches = (_sound(stored.get_batch(number)) for number in range(stored.num_record_batches))
                return _rows((b.slice(0, _BATCH) for b in islice(batches, 1)) if head else batches, path)
            except MemoryError as error:
                raise _too_large(path) from error
            except (pa.ArrowException, OSError, ValueError, TypeError, struct.error) as error:
                raise KeypointError(
                    f"is damaged: {str(error).splitlines()[0] if str(error) else type(error).__name__}",
                    subject=printable(path),
                    remedy=COPY_AGAIN,
                    code="E_KEYPOINTS_BROKEN",
                ) from error


def size_of(about: Any) -> tuple[int, int]:
    """Bytes and values that the metadata of a Parquet file claim: few bytes may be many values."""
    groups = [about.row_group(number) for number in range(about.num_row_groups)]
    columns = [group.column(number) for group in groups for number in range(group.num_columns)]
    return sum(group.total_byte_size for group in groups), sum(column.num_values for column in columns)


def size_of_feather(file: BinaryIO) -> tuple[int, int]:
    """Bytes and values that a Feather file claims to hold, without unpacking any; at its start again.

    Its end says where the batches lie (Apache Arrow's Columnar Format, "IPC File Format"); each buffer of a
    packed one begins with its size.
    """
    end = file.seek(-10, 2)
    (length,) = struct.unpack("<I", file.read(4))
    footer, size, values = _Table.of(_part(file, end - length, length)), 0, 0
    for field in (2, 3):  # dictionaries, batches
        for block in footer.items(field, _BLOCK):
            message = _part(file, int(block["offset"]), int(block["head"]))
            start = 8 if message.startswith(b"\xff\xff\xff\xff") else 4
            batch = _Table.of(message[start:]).table(2)
            batch = batch.table(1) if field == 2 else batch
            values += sum(batch.items(1, _PAIR)["first"].tolist())
            body = int(block["offset"]) + int(block["head"])
            for place, stored in batch.items(2, _PAIR).tolist():
                packed = stored >= 8 and batch.field(3)
                held = struct.unpack("<q", _part(file, body + place, 8))[0] if packed else -1
                size += stored if held < 0 else held
    file.seek(0)
    return size, values


class _Table(NamedTuple):
    """A table of FlatBuffers: where it lies in its bytes."""

    data: bytes
    at: int

    @classmethod
    def of(cls, data: bytes) -> _Table:
        """The outermost one."""
        return cls(data, struct.unpack_from("<I", data)[0])

    def field(self, number: int) -> int:
        """Where a field lies, 0 where it is not there."""
        known = self.at - struct.unpack_from("<i", self.data, self.at)[0]
        if 4 + 2 * number >= struct.unpack_from("<H", self.data, known)[0]:
            return 0
        offset: int = struct.unpack_from("<H", self.data, known + 4 + 2 * number)[0]
        return self.at + offset if offset else 0

    def table(self, number: int) -> _Table:
        """The table in a field."""
        return _Table(self.data, self._target(number))

    def items(self, number: int, kind: np.dtype) -> np.ndarray:
        """The structures in a field, none where it is not there."""
        if not self.field(number):
            return np.zeros(0, kind)
        target = self._target(number)
        return np.frombuffer(self.data, kind, struct.unpack_from("<I", self.data, target)[0], target + 4)

    def _target(self, number: int) -> int:
        at = self.field(number)
        if not at:
            raise ValueError("its metadata lack a part")
        target: int = at + struct.unpack_from("<I", self.data, at)[0]
        return target


def _part(file: BinaryIO, start: int, length: int) -> bytes:
    if start < 0 or length < 0:
        raise ValueError("its metadata point outside of it")
    file.seek(start)
    return file.read(length)


def _sound(batch: Any) -> Any:
    """The batch, whose lengths and offsets its file may claim at will."""
    batch.validate(full=True)
    return batch


def _rows(batches: Iterable[Any], path: Path) -> list[Any]:
    """The rows of a table, of which few are in memory before their size is known."""
    rows, room = list[Any](), MAX_ARRAY_BYTES
    for batch in batches:
        room -= batch.nbytes
        if room < 0:
            raise _too_large(path)
        rows += batch.to_pylist()
    return rows


def _too_large(path: Path) -> KeypointError:
    return KeypointError(
        f"holds more than the {MAX_ARRAY_BYTES} bytes allowed",
        subject=printable(path),
        remedy="split it",
        code="E_KEYPOINTS_LIMIT",
    )
