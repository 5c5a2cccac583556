"""``gesture classify``: the main job."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gesture_core.cli.flags import Flags, PoseFlags, RunFlags
from gesture_core.cli.progress import progress, say_event
from gesture_core.cli.screen import counted, print_rows, say_assumed, visible
from gesture_core.run.pipeline import RunSummary
from gesture_core.run.plan import RunRequest

_CLASSES_SHOWN = 30


def classify(
    *sources: Annotated[str, Parameter(required=True)],
    examples: Annotated[tuple[str, ...], Parameter(consume_multiple=False)],
    out: Path,
    labels: str = "folder",
    flags: Flags | None = None,
    run: RunFlags | None = None,
) -> int:
    """Label every input by the example gestures that it resembles.

    Parameters
    ----------
    sources
        Videos, keypoint files (OpenPose JSON, npz, npy, csv, parquet), folders, globs or manifests.
    examples
        Examples as <label>/<clip>; --examples again for each further folder.
    out
        The run folder: run.db holds the result. The same command again goes on where it stopped.
    labels
        folder, a CSV file with path and label, or an expression for file names: '^(?P<label>[a-z]+)_'.
    """
    return execute(sources, out, flags, run, examples, labels)


def execute(
    sources: tuple[str, ...],
    out: Path,
    flags: PoseFlags | None,
    run: RunFlags | None,
    examples: tuple[str, ...] = (),
    labels: str = "folder",
) -> int:
    """Run what a command asks for, show it, and return the exit code; without examples, only extract."""
    from gesture_core.run.pipeline import run_archive

    run = run or RunFlags()
    request = RunRequest(
        sources,
        out,
        (flags or PoseFlags()).settings(),
        examples,
        labels,
        run.workers,
        run.engine,
        run.retry_errors,
        run.overwrite,
    )
    with progress(quiet=run.quiet) as listener:
        summary = run_archive(request, listener)
    if not run.quiet:
        print_rows(summary.rows(), classified=bool(examples))
        say_summary(summary)
    return summary.exit_code


def say_summary(summary: RunSummary) -> None:
    """The end of a run on standard error: text on a terminal, one JSON line otherwise."""
    if sys.stderr.isatty():
        _say_to_people(summary)
        return
    say_event(
        "done",
        rows=sum(summary.counts.values()),
        counts=dict(sorted(summary.counts.items())),
        worked_on=summary.done_now,
        seconds=round(summary.elapsed, 3),
        frames=summary.frames,
        kernel=summary.kernel,
        failed_examples=[row.input for row in summary.failed_examples],
        lost_classes=list(summary.lost_classes),
        classes=dict(summary.classes),
        inputs_among_examples=summary.inputs_among_examples,
        gone=summary.gone,
        assumed=dict(summary.assumed),
        database=str(summary.out / "run.db"),
        fingerprint=summary.fingerprint,
        exit_code=summary.exit_code,
    )


def _say_to_people(summary: RunSummary) -> None:
    counts = ", ".join(f"{n} {status}" for status, n in sorted(summary.counts.items()))
    database = visible(str(summary.out / "run.db"))
    if (summary.out / "keypoints").is_dir():
        database += f" and {visible(str(summary.out / 'keypoints'))}"
    if summary.done_now:
        speed = f", {summary.frames / summary.elapsed:.0f} frames/s" if summary.frames else ""
        kernel = f", kernel {summary.kernel}" if summary.kernel else ""
        took = f"{counted(summary.done_now, 'input')} in {summary.elapsed:.1f} s{speed}{kernel}"
        total = counted(sum(summary.counts.values()), "row")
        print(f"{total}: {counts}; {took}; {database}", file=sys.stderr)
    else:
        again = "; --retry-errors tries errors again" if summary.counts.get("error") else ""
        print(f"nothing to do: all rows ({counts}) are in {database}{again}", file=sys.stderr)
    if summary.gone:
        print(
            f"no longer there, and without a row from now on: {counted(summary.gone, 'input')}",
            file=sys.stderr,
        )
    say_assumed(summary.assumed)
    if summary.done_now and summary.failed_examples:
        left_out = counted(len(summary.failed_examples), "example")
        print(f"{left_out} left out, as said above", file=sys.stderr)
    else:
        for row in summary.failed_examples:
            print(f"example left out: {row.code} {visible(row.message)}", file=sys.stderr)
    _say_classes(summary)


def _say_classes(summary: RunSummary) -> None:
    """The labels that could be given: a misspelled one is a class of its own, and nothing else tells."""
    counts = [f"{visible(label)} {number}" for label, number in summary.classes.items()]
    if counts:
        more = f", and {len(counts) - _CLASSES_SHOWN} more" if counts[_CLASSES_SHOWN:] else ""
        print(f"examples: {', '.join(counts[:_CLASSES_SHOWN])}{more}", file=sys.stderr)
    if len(counts) == 1:
        print("all examples have one label: every input that is near enough gets it", file=sys.stderr)
    if summary.inputs_among_examples == 1:
        print("1 input is among the examples itself: its label is no result", file=sys.stderr)
    elif summary.inputs_among_examples:
        number = summary.inputs_among_examples
        print(
            f"{number} inputs are among the examples themselves: their labels are no result", file=sys.stderr
        )
    if summary.lost_classes:
        lost = visible(", ".join(summary.lost_classes))
        print(f"no example of {lost} can be used: no input gets such a label", file=sys.stderr)
