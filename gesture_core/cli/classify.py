"""``gesture classify``: the main job."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gesture_core.archive.run import RunRequest, RunSummary
from gesture_core.cli.flags import Flags
from gesture_core.cli.progress import progress
from gesture_core.cli.screen import print_rows, visible


def classify(
    *sources: Annotated[str, Parameter(required=True)],
    examples: Annotated[tuple[str, ...], Parameter(consume_multiple=False)],
    out: Path,
    flags: Flags | None = None,
    labels: str = "folder",
    workers: int = 0,
    engine: str = "processes",
    retry_errors: bool = False,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """Label every input by its nearest example gesture.

    Parameters
    ----------
    sources
        Videos, folders, globs, or text and CSV manifests; OpenPose JSON folders and .npz, .npy, .csv
        and .parquet keypoint files may be mixed with videos.
    examples
        Examples as <label>/<clip>; may be repeated.
    out
        The run folder: run.db holds the result. The same command again goes on where it stopped.
    labels
        Where the labels of examples come from: folder, a CSV file with path and label, or a regular
        expression with a group (?P<label>...) that is searched in the name.
    workers
        Worker processes; 0 for one for each core.
    engine
        Execution engine: processes, or inline for debugging.
    retry_errors
        Try inputs again that ended in an error.
    overwrite
        Classify again with other settings in the same folder; keypoints are reused.
    quiet
        No progress and no table.
    """
    request = RunRequest(
        sources,
        out,
        (flags or Flags()).settings(),
        examples,
        labels,
        workers,
        engine,
        retry_errors,
        overwrite,
    )
    return execute(request, quiet=quiet)


def execute(request: RunRequest, *, quiet: bool = False) -> int:
    """Run ``request``, show it, and return the exit code."""
    from gesture_core.archive.pipeline import run_archive

    with progress(quiet=quiet) as listener:
        summary = run_archive(request, listener)
    if not quiet:
        print_rows(summary.rows())
        say_summary(summary)
    return summary.exit_code


def say_summary(summary: RunSummary) -> None:
    """The last lines on standard error: counts, speed, where the result is."""
    total = sum(summary.counts.values())
    counts = ", ".join(f"{n} {status}" for status, n in sorted(summary.counts.items()))
    database = summary.out / "run.db"
    if summary.done_now:
        speed = f", {summary.frames / summary.elapsed:.0f} frames/s" if summary.frames else ""
        kernel = f", kernel {summary.kernel}" if summary.kernel else ""
        took = f"{summary.done_now} inputs in {summary.elapsed:.1f} s{speed}{kernel}"
        print(f"{total} rows: {counts}; {took}; {database}", file=sys.stderr)
    else:
        print(f"nothing to do: all {total} rows are in {database} ({counts})", file=sys.stderr)
    for row in summary.failed_examples:
        print(f"example left out: {row.code} {visible(row.message)}", file=sys.stderr)
    if summary.lost_classes:
        lost = visible(", ".join(summary.lost_classes))
        print(f"no example of {lost} can be used: no input gets such a label", file=sys.stderr)
