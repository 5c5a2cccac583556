"""Tables of keypoints in Parquet and Feather, as data-frame libraries of Python, R and Julia write them."""

from __future__ import annotations

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
        import pyarrow.feather
        import pyarrow.parquet

        with open_keypoints(path, MAX_CSV_BYTES) as file:
            try:
                if path.suffix.lower() == ".parquet":
                    opened = pa.parquet.ParquetFile(file)
                    about = opened.metadata
                    if _OWN in (opened.schema_arrow.metadata or {}):
                        raise KeypointError("is of gesture extract", code="E_KEYPOINTS_FORMAT")
                    groups = range(about.num_row_groups)
                    size = sum(about.row_group(group).total_byte_size for group in groups)
                    if about.num_rows > _MAX_ROWS or size > MAX_ARRAY_BYTES:
                        raise KeypointError(
                            f"claims {about.num_rows} rows of {size} bytes, more than is allowed",
                            subject=printable(path),
                            remedy="split it",
                            code="E_KEYPOINTS_LIMIT",
                        )
                    return opened.read().to_pylist()
                return pa.feather.read_table(file, memory_map=False).to_pylist()
            except (pa.ArrowException, OSError, ValueError, TypeError) as error:
                raise KeypointError(
                    f"is damaged: {str(error).splitlines()[0] if str(error) else type(error).__name__}",
                    subject=printable(path),
                    remedy=COPY_AGAIN,
                    code="E_KEYPOINTS_BROKEN",
                ) from error
