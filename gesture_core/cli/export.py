"""``gesture export``: the rows of a run as a file."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gesture_core.archive.journal import open_journal
from gesture_core.archive.rows import COLUMNS
from gesture_core.plugin import registry


def export(
    run: Path,
    *,
    format: str = "csv",
    to: Annotated[str, Parameter(name=["--to", "-o"], allow_leading_hyphen=True)] = "",
) -> None:
    """Write the rows of a run as CSV, Parquet or JSON lines.

    Parameters
    ----------
    run
        The run folder.
    format
        csv, parquet, jsonl, or a result writer of a plugin.
    to
        The file, or - for standard output; <run>/results.<format> by default.
    """
    writer = registry().make("writer", format)
    with open_journal(run) as journal:
        rows = (row.as_record() for row in journal.rows())
        if to == "-":
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "rows"
                writer.write(rows, COLUMNS, path)
                with path.open("rb") as file:
                    shutil.copyfileobj(file, sys.stdout.buffer)
            return
        path = Path(to) if to else run / f"results{writer.suffix}"
        writer.write(rows, COLUMNS, path)
    print(path)
