"""``gesture extract``: keypoints only."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gesture_core.cli.classify import execute
from gesture_core.cli.flags import PoseFlags, RunFlags


def extract(
    *sources: Annotated[str, Parameter(required=True)],
    out: Path,
    flags: PoseFlags | None = None,
    run: RunFlags | None = None,
) -> int:
    """Find keypoints only, and write them to <out>/keypoints/ as Parquet files.

    Parameters
    ----------
    sources
        As in gesture classify.
    out
        The run folder; its keypoints folder can be a source or the examples of gesture classify.
    """
    return execute(sources, out, flags, run)
