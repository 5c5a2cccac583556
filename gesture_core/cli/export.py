"""``gesture export``: the rows of a run as a file."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gesture_core.cli.targets import check_file
from gesture_core.errors import ConfigError
from gesture_core.plugin import registry
from gesture_core.run.export import export_rows
from gesture_core.settings import load_settings


def export(
    run: Path,
    /,
    *,
    format: str | None = None,
    to: Annotated[str, Parameter(name=["--to", "-o"], allow_leading_hyphen=True, show_default=False)] = "",
) -> None:
    """Write the rows of a run as CSV, Parquet or JSON lines.

    Parameters
    ----------
    run
        The run folder.
    format
        csv, parquet, jsonl, or a result writer of a plugin; by default as --to ends, or csv.
    to
        The file, or - for standard output; <run>/results.<format> by default.
    """
    limits = load_settings().limits
    if to != "-":
        target = Path(to) if to else None
        if target is not None:
            check_file(target, flag="--to")
        print(export_rows(run, format or _format_of(target), target, limits))
        return
    with tempfile.TemporaryDirectory() as folder:
        written = export_rows(run, format or "csv", Path(folder) / "rows", limits)
        with written.open("rb") as file:
            if sys.stdout.isatty() and b"\0" in file.read(1 << 16):
                raise ConfigError(f"{format} is not text", remedy="--to FILE, or a pipe", code="E_OPTION")
            file.seek(0)
            shutil.copyfileobj(file, sys.stdout.buffer)


def _format_of(path: Path | None) -> str:
    """The result writer whose name a file ends in; CSV where it ends in nothing."""
    ending = path.suffix.lower().removeprefix(".") if path else ""
    names = registry().names("writer")
    if ending and ending not in names:
        raise ConfigError(
            f"--to {path}: no result writer is called {ending!r}",
            remedy=f"--format with one of {', '.join(names)}",
            code="E_OPTION",
        )
    return ending or "csv"
