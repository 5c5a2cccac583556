"""What people have marked in recordings: ELAN, WebVTT and CSV files, and how a run compares with them."""

from __future__ import annotations

import csv
import os
import warnings
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from gesture_core.errors import ConfigError, InputError, MissingDependencyError, near
from gesture_core.records import Event, Row
from gesture_core.run.results import open_results
from gesture_core.run.tables import headings
from gesture_core.spot.evaluation import Annotation, EventScores, score_events
from gesture_core.spot.examples import NONE

SUFFIXES = (".eaf", ".vtt", ".csv")
_LARGEST = 64 << 20
_SHOWN = 5
PATHS = ("input", "path", "file", "video")


def evaluate_events(run: str | os.PathLike[str], annotations: str | os.PathLike[str]) -> EventScores:
    """Compare the events of a run with annotations: `gesture evaluate --events` as a function.

    Parameters
    ----------
    run : path
        A folder that `gesture spot` wrote.
    annotations : path
        An ELAN or WebVTT file of a recording's name, a CSV file with the columns ``input``, ``start``,
        ``end`` (seconds; the same as ``start``, or nothing, for a point) and ``label``, or a folder of them.
        Labels that the run does not have are warned of.

    Raises
    ------
    InputError
        Where a file cannot be read.
    ConfigError
        Where the run has no events, or an annotation belongs to no input of it, or none has a label of it.
    """
    with open_results(run) as results:
        rows = list(results.rows())
        labels = {one["label"] for one in results.configuration.get("examples", {}).values()} - {NONE, None}
    if not any(row.event or row.code == "E_NO_EVENT" for row in rows):
        raise ConfigError("the run is not of gesture spot", subject=os.fspath(run), code="E_NO_RUN")
    events = [event_of(row) for row in rows if row.event]
    marks = list(read_annotations(annotation_files(Path(annotations)), rows))
    seconds = sum({row.input: row.seconds for row in rows if row.frames_read}.values())
    unknown = unknown_labels(marks, labels, os.fspath(annotations))
    return replace(score_events(events, marks, seconds), unknown=unknown)


def unknown_labels(marks: Sequence[Annotation], labels: Collection[str], source: str) -> dict[str, int]:
    """How many of ``marks`` have each label that is none of ``labels``; they are warned of.

    Raises
    ------
    ConfigError
        ``E_LABELS`` where all of them have such a label.
    """
    known = sorted(labels)
    found = Counter(mark.label for mark in marks if mark.label not in labels)
    if not found:
        return {}
    meant = [
        f"{label!r} ({number}{f', {hint}' if (hint := near(label, known, ' ').strip()) else ''})"
        for label, number in found.most_common()
    ]
    said = ", ".join(meant[:_SHOWN]) + (f", and {len(meant) - _SHOWN} more" if meant[_SHOWN:] else "")
    if found.total() == len(marks):
        raise ConfigError(
            f"no annotation has a label of the run, but {said}", subject=source, code="E_LABELS",
            remedy=f"labels as the run has them: {', '.join(known)}",
        )  # fmt: skip
    text = f"{found.total()} of {len(marks)} annotations have labels that no event can have: {said}"
    warnings.warn(f"{source}: {text}; the run has {', '.join(known)}", stacklevel=3)
    return dict(found)


def event_of(row: Row) -> Event:
    """The event that a row is about."""
    assert row.start is not None and row.end is not None
    example = row.neighbors[0][0] if row.neighbors else ""
    return Event(
        row.input,
        row.person,
        row.start,
        row.end,
        row.label or "",
        row.score or 0.0,
        row.distance or 0.0,
        example,
    )


def annotation_files(path: Path) -> list[Path]:
    """``path``, or the files of annotations in that folder."""
    if not path.exists():
        raise InputError("no such file", subject=str(path), remedy="check the path", code="E_NOT_FOUND")
    files = sorted(one for one in path.iterdir() if one.suffix in SUFFIXES) if path.is_dir() else [path]
    if not files:
        raise InputError(
            "holds no annotations", subject=str(path), remedy="ELAN, WebVTT or CSV files", code="E_EMPTY"
        )
    return files


def read_annotations(files: Sequence[Path], rows: Sequence[Row]) -> Iterator[Annotation]:
    """All annotations in ``files``, each about an input of ``rows``."""
    names = {row.input for row in rows}
    owner: dict[str, Path] = {}
    for file in files:
        for mark in _read(file, names):
            if owner.setdefault(mark.input, file) != file:
                raise ConfigError(
                    f"{mark.input} is annotated in two files, {owner[mark.input].name} and {file.name}",
                    subject=str(file.parent), remedy="one of them", code="E_LABELS",
                )  # fmt: skip
            yield mark


def _read(file: Path, names: set[str]) -> Iterator[Annotation]:
    """The annotations in one file."""
    try:
        if file.stat().st_size > _LARGEST:
            raise InputError("is too large for annotations", subject=str(file), code="E_READ")
        if file.suffix == ".csv":
            yield from _csv(file, names)
        elif file.suffix == ".vtt":
            yield from _vtt(file, _input_of(file.stem, names, file))
        elif file.suffix == ".eaf":
            yield from _elan(file, _input_of(file.stem, names, file))
        else:
            raise InputError("is no ELAN, WebVTT or CSV file", subject=str(file), code="E_READ")
    except OSError as error:
        cause = f"cannot be read: {error.strerror or error}"
        raise InputError(cause, subject=str(file), code="E_READ") from error


def _input_of(name: str, names: set[str], file: Path) -> str:
    """The one input that is called ``name``, in full, by its last part, or by that without its suffix."""
    for alike in (
        [one for one in names if one == name],
        [one for one in names if Path(one).name == Path(name).name],
        [one for one in names if Path(one).stem == Path(name).stem],
    ):
        if len(alike) == 1:
            return alike[0]
        if alike:
            raise ConfigError(
                f"{name} may be {' or '.join(sorted(alike)[:3])}", subject=str(file), code="E_LABELS",
                remedy="a CSV file with the inputs as the run names them",
            )  # fmt: skip
    raise ConfigError(
        f"{name} is no input of the run", subject=str(file), code="E_LABELS",
        remedy="a name as the run has it, or a run of these recordings",
    )  # fmt: skip


def table_of(file: Path) -> tuple[Sequence[str], list[dict[str, str]], str]:
    """The columns of a CSV file, its rows by them, and what separates its cells."""
    try:
        with file.open(encoding="utf-8-sig", newline="") as opened:
            lines = list(opened)
        _, mark = headings(lines)
        reader = csv.DictReader(lines, delimiter=mark)
        return reader.fieldnames or (), list(reader), mark
    except OSError as error:
        cause = f"cannot be read: {error.strerror or error}"
        raise InputError(cause, subject=str(file), code="E_READ") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"is no CSV file in UTF-8: {error}", subject=str(file), code="E_READ") from error


def _csv(file: Path, names: set[str]) -> Iterator[Annotation]:
    columns, rows, mark = table_of(file)
    place = next((name for name in PATHS if name in columns), None)
    if place is None or not {"start", "label"} <= set(columns):
        raise InputError(
            f"has the columns {', '.join(columns) or 'of no table'}", subject=str(file),
            remedy="input, start, end, label", code="E_READ",
        )  # fmt: skip
    for number, line in enumerate(rows, 2):
        if line["start"] in ("", None):  # a row of a run that is about no event
            continue
        said = line["start"], line.get("end") or line["start"]
        try:
            start, end = (float(text if mark == "," else text.replace(",", ".")) for text in said)
        except ValueError:
            start = end = float("nan")
        cause = "has no time in seconds"
        if 0 <= end < start < float("inf"):
            cause = f"its end {end:g} lies before its start {start:g}"
        elif start < 0 or end < 0:
            cause = f"{min(start, end):g} lies before the start of the recording"
        if not 0 <= start <= end < float("inf"):
            raise InputError(f"line {number}: {cause}", subject=str(file), code="E_READ")
        yield Annotation(_input_of(line[place], names, file), start, end, (line["label"] or "").strip())


def _vtt(file: Path, name: str) -> Iterator[Annotation]:
    try:
        import webvtt
    except ImportError:
        raise _missing("webvtt-py", file) from None
    import html

    try:
        captions = webvtt.read(str(file)).captions
    except (
        webvtt.errors.MalformedFileError,
        webvtt.errors.MalformedCaptionError,
        UnicodeDecodeError,
    ) as error:
        raise InputError(f"is no WebVTT file: {error}", subject=str(file), code="E_READ") from error
    for caption in captions:
        label = html.unescape(caption.text).strip()
        yield Annotation(name, _seconds(caption.start), _seconds(caption.end), label)


def _seconds(clock: str) -> float:
    """``01:02:03.004`` in seconds; the library's own figure has no fraction."""
    seconds = 0.0
    for part in clock.split(":"):
        seconds = 60 * seconds + float(part)
    return round(seconds, 3)


def _elan(file: Path, name: str) -> Iterator[Annotation]:
    try:
        from pympi import Elan
    except ImportError:
        raise _missing("pympi-ling", file) from None
    try:
        document = Elan.Eaf(str(file))
        tiers = {tier: document.get_annotation_data_for_tier(tier) for tier in document.get_tier_names()}
    except Exception as error:  # pympi raises that and nothing narrower
        raise InputError(f"is no ELAN file: {error}", subject=str(file), code="E_READ") from error
    for marks in tiers.values():
        for start, end, label, *_ in marks:
            yield Annotation(name, start / 1000, end / 1000, str(label).strip())


def _missing(package: str, file: Path) -> MissingDependencyError:
    return MissingDependencyError(
        f"reading it needs {package}", subject=str(file), remedy="pip install 'gesture-core[events]'"
    )
