"""Tables of keypoints in Parquet and Feather, as data-frame libraries of Python, R and Julia write them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

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

    def _tree(self, path: Path) -> Any:
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
                    return _rows(opened.iter_batches(_BATCH), path)
                stored = pa.ipc.open_file(file)
                return _rows(map(stored.get_batch, range(stored.num_record_batches)), path)
            except MemoryError as error:
                raise _too_large(path) from error
            except (pa.ArrowException, OSError, ValueError, TypeError) as error:
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
