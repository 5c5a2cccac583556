"""Thresholds of events from recordings in which somebody has marked them: `gesture spot --calibrate`.

The recordings are spotted with thresholds that are wide open, in a run folder of their own inside that of the
run. Of all tolerances that would have kept some of the events and not the others, the one with the best F1 is
chosen; it takes the place of `spot.tolerance`, and so stands in the configuration of the run.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from gesture_core.errors import ConfigError, InputError
from gesture_core.files import content_sha256, replacing
from gesture_core.records import Event
from gesture_core.run.annotations import (
    PATHS,
    SUFFIXES,
    annotation_files,
    event_of,
    read_annotations,
    table_of,
    unknown_labels,
)
from gesture_core.run.extract import Listener
from gesture_core.run.pipeline import run_archive
from gesture_core.run.plan import RunRequest
from gesture_core.run.results import open_results
from gesture_core.spot.evaluation import OVERLAPS, Annotation, score_events
from gesture_core.spot.examples import COPY

FOLDER = "calibration"
"""In the run folder: the run of the annotated recordings, and what was chosen."""
_CHOSEN = "chosen.json"
OPEN = 3.0
"""Tolerance under which the annotated recordings are spotted; what is farther is nobody's gesture."""
_STEPS = 100
"""Tolerances that are tried, at most."""


@dataclass(frozen=True)
class Calibration:
    """What annotated recordings say of thresholds.

    Attributes
    ----------
    tolerance : float
        The new `spot.tolerance`.
    f1, false_alarms : float
        Of the annotated recordings under it; false alarms a minute. That of other recordings is lower.
    before : float
        F1 under the tolerance that the settings had.
    annotated : int
        Marks of gestures that there are examples of.
    recordings : tuple of str
    left_out : int
        Events that are copies of examples, and say nothing about others.
    contents : tuple of str
        SHA-256 of the recordings.
    sha256 : mapping
        Of the files of annotations, by name.
    """

    tolerance: float
    f1: float
    false_alarms: float
    before: float
    annotated: int
    recordings: tuple[str, ...]
    left_out: int
    contents: tuple[str, ...]
    sha256: dict[str, str]

    @property
    def text(self) -> str:
        """What was chosen, in a sentence."""
        copies = f"; {self.left_out} events are copies of examples, and left out" if self.left_out else ""
        return (
            f"--set spot.tolerance={self.tolerance:.3g} by {self.annotated} marks in {len(self.recordings)} "
            f"recordings: F1 there {self.f1:.1%} (before {self.before:.1%}), "
            f"{self.false_alarms:.1f} false alarms a minute{copies}"
        )


def calibrate(
    request: RunRequest, annotations: Sequence[str], listener: Listener | None = None
) -> tuple[RunRequest, Calibration]:
    """``request`` with the tolerance that fits ``annotations`` best.

    Parameters
    ----------
    request : RunRequest
        Of `gesture spot`.
    annotations : sequence of str
        ELAN or WebVTT files, each beside its recording and called as it is, CSV files whose inputs are paths
        seen from their own folder, or folders of these.

    Raises
    ------
    InputError, ConfigError
        Where a file cannot be read, a recording is not there, or no mark is of a gesture with examples.
    """
    if request.settings.spot.threshold is not None:
        raise ConfigError(
            "--calibrate and spot.threshold both say how far events may be", remedy="one of them",
            code="E_OPTION",
        )  # fmt: skip
    files = [one for text in annotations for one in annotation_files(Path(text))]
    recordings = list(dict.fromkeys(str(one) for file in files for one in _recordings(file)))
    spot = replace(request.settings.spot, tolerance=OPEN)
    out = request.out / FOLDER
    settings = replace(request.settings, spot=spot)
    # Anew each time: recordings of other annotations must not count.
    opened = replace(request, sources=tuple(recordings), out=out, shard="", overwrite=True, settings=settings)
    summary = run_archive(opened, listener)
    with open_results(out) as results:
        rows = list(results.rows())
    marks = list(read_annotations(files, rows))
    unknown = unknown_labels(marks, summary.classes, ", ".join(annotations))
    marks = [mark for mark in marks if mark.label not in unknown]
    if not marks:
        raise ConfigError(
            "no annotation is of a gesture that there are examples of", subject=", ".join(annotations),
            remedy="annotations called as the folders of the examples", code="E_LABELS",
        )  # fmt: skip
    failed = next((row for row in rows if row.status == "error"), None)
    if failed is not None:
        raise InputError(failed.message, subject=failed.input, code=failed.code)
    events = [event_of(row) for row in rows if row.event]
    usable = [event for event in events if event.distance > COPY]
    if not usable:
        raise ConfigError(
            "nothing in the annotated recordings is like an example that is no copy",
            subject=", ".join(annotations), remedy="other examples, or other recordings", code="E_EXAMPLES",
        )  # fmt: skip
    seconds = sum({row.input: row.seconds for row in rows}.values())
    tolerance = choose_tolerance(usable, marks, seconds)
    found, before = (
        _scored(usable, marks, seconds, one) for one in (tolerance, request.settings.spot.tolerance)
    )
    chosen = Calibration(
        tolerance, *found, before[0], len(marks), tuple(recordings), len(events) - len(usable),
        tuple(sorted({row.sha256 for row in rows})), {file.name: content_sha256(file) for file in files},
    )  # fmt: skip
    with replacing(out / _CHOSEN) as temporary:
        temporary.write_text(json.dumps(asdict(chosen), indent=1) + "\n", "utf-8")
    spot = replace(spot, tolerance=tolerance)
    return replace(request, settings=replace(request.settings, spot=spot)), chosen


def choose_tolerance(events: Sequence[Event], marks: Sequence[Annotation], seconds: float) -> float:
    """The tolerance with the best F1 for ``events`` that were found under a tolerance of 3.

    Of several equally good ones that in the middle.
    """
    needed = np.unique([_needed(event) for event in events])
    if not len(needed):
        return OPEN
    between = np.append((needed[:-1] + needed[1:]) / 2, needed[-1] + 1e-3)
    tried = between[np.linspace(0, len(between) - 1, min(len(between), _STEPS)).round().astype(int)]
    scores = np.array([_scored(events, marks, seconds, float(one))[0] for one in tried])
    best = np.flatnonzero(scores >= scores.max() - 1e-9)
    run = best[: int(np.argmax(np.diff(best, append=best[-1] + 2) > 1)) + 1]
    return float(tried[run[len(run) // 2]])


def _needed(event: Event) -> float:
    """The least tolerance under which ``event`` is one."""
    return OPEN * (1 - event.score)


def _scored(
    events: Sequence[Event], marks: Sequence[Annotation], seconds: float, tolerance: float
) -> tuple[float, float]:
    """F1 and false alarms a minute of the events that a tolerance keeps."""
    scores = score_events([one for one in events if _needed(one) <= tolerance], marks, seconds)
    return scores.f1.get(OVERLAPS[-1], scores.f1.get(0.0, 0.0)), scores.false_alarms


def _recordings(file: Path) -> list[Path]:
    """The recordings that a file of annotations is about."""
    if file.suffix == ".csv":
        names = [next((line[key] for key in PATHS if line.get(key)), "") for line in table_of(file)[1]]
        found = [file.parent / name for name in dict.fromkeys(names) if name]
    else:
        found = [
            one
            for one in sorted(file.parent.iterdir())
            if one.stem == file.stem and one.suffix not in (*SUFFIXES, ".srt", ".txt")
        ]
    missing = [one for one in found if not one.exists()]
    if missing or (len(found) != 1 and file.suffix != ".csv"):
        what = f"{missing[0]} is not there" if missing else f"{len(found)} recordings beside it have its name"
        raise InputError(
            what, subject=str(file), code="E_NOT_FOUND",
            remedy="annotations beside their recording, called as it is; or a CSV file with paths",
        )  # fmt: skip
    return found
