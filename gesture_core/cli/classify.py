"""``gesture classify``, the main job, and ``gesture extract``, its first half."""

from __future__ import annotations

import re
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gesture_core.cli.flags import SEVERAL, UNSAID, Flags, PoseFlags, RunFlags, Sources, SpotFlags
from gesture_core.cli.output import (
    counted,
    mirroring_hint,
    named,
    print_rows,
    say,
    say_assumed,
    say_event,
    say_notes,
    warnings_as_lines,
)
from gesture_core.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from gesture_core.records import Row
    from gesture_core.run.pipeline import RunSummary

NO_LABEL = "(none)"
"""What stands for no label, where labels are counted."""
_CLASSES_SHOWN = 30


def classify(
    *sources: Sources,
    examples: Annotated[tuple[str, ...], SEVERAL],
    out: Path,
    labels: str = "folder",
    label_columns: Annotated[str, UNSAID] = "",
    flags: Flags | None = None,
    run: RunFlags | None = None,
) -> int:
    """Label every input by the example gestures that it resembles.

    Parameters
    ----------
    sources
        Videos, keypoint files (OpenPose JSON, npz, npy, csv, parquet), folders, globs or manifests.
    examples
        Folders with examples as <label>/<clip>: everything up to the next option, so that sources stand
        before --examples, or last after --.
    out
        The run folder: run.db holds the result. The same command again goes on where it stopped.
    labels
        folder (the first below FOLDER), folder:-1 (the one that holds the clip) and other levels; a CSV
        file with path and label; or an expression for file names: '^(?P<label>[a-z]+)_'.
    label_columns
        With a CSV file: its headings of path and label, such as filename,class; 1,2 where it has none.
    """
    asked: dict[str, Any] = {"examples": examples, "labels": labels, "label_columns": label_columns}
    return _execute(sources, out, flags, run, **asked)


def spot(
    *sources: Sources,
    examples: Annotated[tuple[str, ...], SEVERAL],
    out: Path,
    calibrate: Annotated[tuple[str, ...], SEVERAL, UNSAID] = (),
    labels: str = "folder",
    label_columns: Annotated[str, UNSAID] = "",
    flags: SpotFlags | None = None,
    run: RunFlags | None = None,
) -> int:
    """Find the example gestures in long recordings: a row for every event.

    Parameters
    ----------
    sources
        As in gesture classify.
    examples
        As in gesture classify. A folder _none holds other movements, which are never an event.
    out
        The run folder; it is continued, exported and evaluated as that of gesture classify.
    calibrate
        Annotations by which spot.tolerance is chosen: .eaf or .vtt beside a recording of that name, or .csv
        with input, start, end and label. Inputs that are among these recordings are said to be.
    labels
        As in gesture classify.
    label_columns
        As in gesture classify.
    """
    asked: dict[str, Any] = {"examples": examples, "labels": labels, "label_columns": label_columns}
    return _execute(sources, out, flags, run, calibrate, spot=True, **asked)


def extract(*sources: Sources, out: Path, flags: PoseFlags | None = None, run: RunFlags | None = None) -> int:
    """Find keypoints only, and write them to <out>/keypoints/ as Parquet files.

    Parameters
    ----------
    sources
        As in gesture classify.
    out
        The run folder; its keypoints folder can be a source or the examples of gesture classify.
    """
    return _execute(sources, out, flags, run)


def _execute(
    sources: tuple[str, ...],
    out: Path,
    flags: PoseFlags | None,
    run: RunFlags | None,
    annotations: tuple[str, ...] = (),
    **asked: Any,
) -> int:
    """Run what a command asks for, show it, and return the exit code.

    ``asked`` are further fields of a `RunRequest`; without ``examples``, keypoints are only extracted.
    """
    from gesture_core.run.pipeline import run_archive
    from gesture_core.run.plan import RunRequest
    from gesture_core.run.results import open_results

    if asked.get("examples") == ():
        raise ConfigError("--examples needs a value", remedy="--examples FOLDER", code="E_OPTION")
    run = run or RunFlags()
    asked |= vars(run)
    del asked["quiet"]
    request = RunRequest(sources, out, (flags or PoseFlags()).settings(), **asked)
    known: set[str] = set()
    if annotations:
        from gesture_core.run.calibrate import calibrate

        request, chosen = calibrate(request, annotations)
        known = set(chosen.contents)
        say(chosen.text)
    if run.quiet:
        return run_archive(request).exit_code
    from gesture_core.cli.progress import progress

    with progress(sources, request.examples) as listener, warnings_as_lines(events=True):
        summary = run_archive(request, listener)
    with open_results(out) as results, results.failures():  # as they come: there may be a million
        print_rows(
            results.rows(), "events" if request.spot else "labels" if request.examples else "keypoints"
        )
        say_summary(summary, () if request.spot else results.rows())
        if same := len({row.input for row in results.rows() if row.sha256 in known} if known else ()):
            say(f"{counted(same, 'input')} chose the tolerance: what is found there says little about others")
    return summary.exit_code


def say_summary(summary: RunSummary, rows: Iterable[Row] = ()) -> None:
    """The end of a run on standard error: text on a terminal, one JSON line otherwise."""
    labels, right = _counted(rows, summary.classes) if summary.classes else (Counter[str](), None)
    if sys.stderr.isatty():
        _say_to_people(summary, labels, right)
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
        labels=dict(sorted(labels.items())),
        right=right,
        inputs_among_examples=summary.inputs_among_examples,
        gone=summary.gone,
        assumed=dict(summary.assumed),
        notes=dict(summary.notes),
        warnings=_warnings(summary),
        database=str(summary.out / "run.db"),
        fingerprint=summary.fingerprint,
        exit_code=summary.exit_code,
    )


def _counted(rows: Iterable[Row], classes: Mapping[str, int]) -> tuple[Counter[str], int | None]:
    """Labels, and how many of them are that of the folder that holds the input; None for that unless every
    folder is a label.
    """
    labels, right, told = Counter[str](), 0, True
    for row in rows:
        path, _, member = row.input.partition("::")
        inside = "/" in member and "://" not in row.input  # a series in a file is called label/number
        folder = (member if inside else path).rpartition("/")[0].rpartition("/")[2]
        labels[row.label or NO_LABEL] += 1
        right += row.label == folder
        told = told and folder in classes
    return labels, right if labels and told else None


def _say_to_people(summary: RunSummary, labels: Counter[str], right: int | None) -> None:
    counts = ", ".join(f"{n} {status}" for status, n in sorted(summary.counts.items()))
    where = str(summary.out / "run.db")
    if (summary.out / "keypoints").is_dir():
        where += f" and {summary.out / 'keypoints'}"
    if summary.done_now:
        speed = f", {summary.frames / summary.elapsed:.0f} frames/s" if summary.frames else ""
        kernel = f", kernel {summary.kernel}" if summary.kernel else ""
        took = f"{counted(summary.done_now, 'input')} in {summary.elapsed:.1f} s{speed}{kernel}"
        say(f"{counted(sum(summary.counts.values()), 'row')}: {counts}; {took}; {where}")
    else:
        again = "; --retry-errors tries errors again" if summary.counts.get("error") else ""
        say(f"nothing to do: all rows ({counts}) are in {where}{again}")
    if summary.gone:
        say(f"no longer there, and without a row from now on: {counted(summary.gone, 'input')}")
    say_assumed(summary.assumed)
    say_notes(summary.notes)
    if summary.done_now and summary.failed_examples:
        say(f"{counted(len(summary.failed_examples), 'example')} left out, as said above")
    else:
        for row in summary.failed_examples:
            say(f"example left out: {row.code} {row.message}")
    # The labels that could be given: a misspelled one is a class of its own, and nothing else tells.
    if summary.classes:
        classes = [f"{label} {number}" for label, number in summary.classes.items()]
        say(f"examples: {named(classes, _CLASSES_SHOWN)}")
    if labels:
        say(f"labels: {named([f'{label} {n}' for label, n in sorted(labels.items())], _CLASSES_SHOWN)}")
    if right is not None:
        share = right / labels.total()
        say(f"{right} of {counted(labels.total(), 'label')} are those of the inputs' folders ({share:.1%})")
    for warning in _warnings(summary):
        say(warning)


def _warnings(summary: RunSummary) -> list[str]:
    """What makes labels less than they seem."""
    found = []
    if len(summary.classes) == 1:
        found.append("all examples have one label: every input that is near enough gets it")
    spelled: dict[str, list[str]] = {}
    for label in summary.classes:
        spelled.setdefault(re.sub(r"[\s_-]+", " ", label).casefold(), []).append(label)
    for alike in spelled.values():
        if alike[1:]:
            found.append(f"labels that differ only in case, spaces or dashes: {', '.join(alike)}")
    if summary.sided:
        found.append(mirroring_hint(summary.sided))
    if summary.inputs_among_examples == 1:
        found.append("1 input is among the examples itself: its label is no result")
    elif summary.inputs_among_examples:
        number = summary.inputs_among_examples
        found.append(f"{number} inputs are among the examples themselves: their labels are no result")
    refused, events = len(summary.refused), summary.counts.get("ok", 0)
    if refused >= max(events, 1) and (events or sum(summary.counts.values()) > 1):  # one row says it itself
        hint = f"; try: {summary.nearer}" if summary.nearer else ""
        found.append(f"{counted(refused, 'candidate')} farther than the thresholds{hint}")
    if summary.lost_classes:
        lost = ", ".join(summary.lost_classes)
        found.append(f"no example of {lost} can be used: no input gets such a label")
    return found
