"""``gesture export``: the rows of a run as a file."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gesture_core.archive.exporting import export_rows
from gesture_core.settings import load_settings


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
    limits = load_settings().limits
    if to == "-":
        with tempfile.TemporaryDirectory() as folder:
            written = export_rows(run, format, Path(folder) / "rows", limits)
            with written.open("rb") as file:
                shutil.copyfileobj(file, sys.stdout.buffer)
        return
    print(export_rows(run, format, Path(to) if to else None, limits))
