"""``gesture extract``: keypoints only."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gesture_core.archive.run import RunRequest
from gesture_core.cli.classify import execute
from gesture_core.cli.flags import Flags


def extract(
    *sources: Annotated[str, Parameter(required=True)],
    out: Path,
    flags: Flags | None = None,
    workers: int = 0,
    engine: str = "processes",
    retry_errors: bool = False,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """Find keypoints only, and write them to <out>/keypoints/ as Parquet files.

    Parameters
    ----------
    sources
        As in gesture classify.
    out
        The run folder; its keypoints folder can be a source or the examples of gesture classify.
    workers
        Worker processes; 0 for one for each core.
    engine
        Execution engine: processes, or inline for debugging.
    retry_errors
        Try inputs again that ended in an error.
    overwrite
        Extract again with other settings in the same folder.
    quiet
        No progress and no table.
    """
    request = RunRequest(
        sources,
        out,
        (flags or Flags()).settings(),
        workers=workers,
        engine=engine,
        retry_errors=retry_errors,
        overwrite=overwrite,
    )
    return execute(request, quiet=quiet)
