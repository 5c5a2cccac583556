"""What commands write and where: tables on a terminal, JSON lines through a pipe, files that can be written.

Names that come from files are printed by `files.printable`, so that none of them can move the cursor.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from gesture_core.errors import Code, ConfigError, InputError
from gesture_core.files import check_local, printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from gesture_core.records import Row

_ROWS_SHOWN = 60
_REASONS_SHOWN = 20
_NOTES_SHOWN = 8
_NARROW = 80
_WORST = ("error", "degraded", "rejected", "skipped", "ok")
Table = Literal["labels", "events", "keypoints"]
"""What the rows of a run are about."""
_STYLES = {"ok": "green", "degraded": "yellow", "rejected": "yellow", "skipped": "dim", "error": "red"}


def say(text: str) -> None:
    """One line for people, on standard error."""
    _to_standard_error(printable(text))


def say_event(event: str, **facts: Any) -> None:
    """One line for programs, as JSON on standard error."""
    _to_standard_error(json.dumps({"event": event, **facts}, ensure_ascii=False))


def _to_standard_error(line: str) -> None:
    try:
        print(line, file=sys.stderr, flush=True)
    except BrokenPipeError:  # nobody reads how the work goes on, and it goes on
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


@contextmanager
def warnings_as_lines(*, events: bool = False) -> Iterator[None]:
    """What functions of the package warn of in the block, as lines for people, each text once.

    With ``events``, as lines for programs where standard error is no terminal.
    """

    said: set[str] = set()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        if str(message) in said:
            return
        said.add(str(message))
        if events and not sys.stderr.isatty():
            say_event("warning", message=printable(str(message)))
        else:
            say(str(message))

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = show
        yield


def counted(number: int, noun: str) -> str:
    """``1 row``, ``2 rows``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def named(names: Sequence[str], most: int = 5, join: str = ", ") -> str:
    """The first ``most`` names, and how many more there are."""
    more = f", and {len(names) - most} more" if names[most:] else ""
    return join.join(names[:most]) + more


def console(*, stderr: bool = False) -> Console:
    """A Rich console; as wide as the text needs where it is no terminal."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    return Console(file=stream, width=None if stream.isatty() else 240, highlight=False, emoji=False)


def print_table(
    columns: Sequence[str], rows: Iterable[Sequence[str | Text]], *, right: Sequence[str] = ()
) -> None:
    """A plain table; the columns in ``right`` are right-aligned."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    narrow = console().width < _NARROW
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 0 if narrow else 1))
    for column in columns:
        number = column in right  # is never broken
        table.add_column(
            column, justify="right" if number else "left", overflow="fold", no_wrap=number and narrow
        )
    for row in rows:
        table.add_row(*(Text(printable(cell)) if isinstance(cell, str) else cell for cell in row))
    console().print(table)


def print_list(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, below: bool = False, title: str = ""
) -> None:
    """A list: a table on a terminal, JSON lines through a pipe, whose keys are the columns' names.

    On a terminal it has a ``title``; with ``below`` its last column, paths or addresses, stands on lines of
    its own, as a narrow table would break them.
    """
    if not sys.stdout.isatty():
        for row in rows:
            print(json.dumps(dict(zip(columns, row, strict=True)), ensure_ascii=False))
        return
    if title:
        print(f"\n{title}")
    shown = len(columns) - below
    print_table(columns[:shown], [row[:shown] for row in rows])
    width = max((len(row[0]) for row in rows), default=0)
    for row in rows if below else ():
        print(f" {printable(row[0]):<{width}}   {printable(row[-1])}")


def print_rows(rows: Iterable[Row], what: Table = "labels") -> None:
    """The result: a table and what went wrong on a terminal, JSON lines otherwise. They are never held as a
    whole, but for those that something is wrong with.
    """
    if not sys.stdout.isatty():
        from gesture_core.run.export import json_line

        for row in rows:
            print(json_line(row.as_record()))
        return
    remaining = iter(rows)
    first = list(islice(remaining, _ROWS_SHOWN))
    row_table(first, what)
    flawed, more = [row for row in first if row.message], 0
    for row in remaining:
        more += 1
        flawed += [row] if row.message else []
    if more:
        print(f"… and {counted(more, 'more row')}: gesture export writes all of them")
    print_reasons(flawed)


def print_reasons(rows: Sequence[Row]) -> None:
    """Why rows are not ``ok``, the worst first; what several rows say once, rejections of one kind, and files
    left out, as one group.
    """
    flawed = sorted((row for row in rows if row.message), key=lambda row: _WORST.index(row.status))
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in flawed:
        groups.setdefault((row.status, row.code), []).append(row)
    grouped = {key for key, group in groups.items() if key[0] in ("rejected", "skipped") and len(group) > 1}
    each: dict[tuple[str, str, str], list[Row]] = {}
    for row in flawed:
        if (row.status, row.code) not in grouped:
            each.setdefault((row.status, row.code, row.message.removeprefix(f"{row.input}: ")), []).append(
                row
            )
    for (status, code, text), alike in list(each.items())[:_REASONS_SHOWN]:
        if len(alike) == 1:
            print(f"{status} {code} {printable(alike[0].message)}")
        else:
            print(printable(f"{len(alike)} {status} {code} {text}"))
            print(f"  {printable(named(list(dict.fromkeys(row.input for row in alike)), _REASONS_SHOWN))}")
    if len(each) > _REASONS_SHOWN:
        print(f"… and {counted(len(each) - _REASONS_SHOWN, 'more reason')} in the column 'message'")
    for key in groups:
        if key in grouped:
            _print_group(groups[key])


def _print_group(rows: Sequence[Row]) -> None:
    """Rows that have no label for one reason: the reason once, then what they would have been."""
    code = Code.of(rows[0].code)
    remedies = {row.message.partition("; try: ")[2] for row in rows}
    remedy = remedies.pop() if len(remedies) == 1 else ""
    reason = f": {code.meaning}; try: {remedy or code.remedy}" if code else ""
    print(f"{len(rows)} {rows[0].status} {rows[0].code}{reason}")
    base = _common_folder([row.input for row in rows])
    shown = rows[:_REASONS_SHOWN]
    names = [row.input.removeprefix(base) + (f" #{row.person}" if row.person else "") for row in shown]
    if not any(row.neighbors for row in shown):
        print(f"  {printable(named(names, _REASONS_SHOWN))}")
    else:
        cells = []
        for name, row in zip(names, shown, strict=True):
            numbers = ["" if value is None else f"{value:.3f}" for value in (row.distance, row.margin)]
            cells.append([name, row.neighbors[0][1] if row.neighbors else "", *numbers])
        print_table(["input", "would have been", "distance", "margin"], cells, right=["distance", "margin"])
    if len(rows) > len(shown):
        print(f"… and {len(rows) - len(shown)} more of them")


def row_table(rows: Sequence[Row], what: Table = "labels") -> None:
    """One line for each row: input, then what is known of its label, event or keypoints, and status."""
    from rich.text import Text

    if what == "events":
        columns, right = ["input", "start", "end", "label", "score", "nearest example", "status"], [1, 2, 4]
    elif what == "labels":
        there = {name for row in rows for name in ("confidence", "score") if getattr(row, name) is not None}
        sure = next((name for name in ("confidence", "score") if name in there), "margin")
        columns, right = ["input", "label", "distance", sure, "nearest example", "status"], [2, 3]
    else:
        columns = ["input", "frames", "looked at", "with a pose", "seconds", "status"]
        right = [1, 2, 3, 4]
    base = _common_folder([row.input for row in rows])
    clips: dict[str, set[str]] = {}
    for row in rows:
        for name, _, _ in row.neighbors[:1]:
            clips.setdefault(name.rpartition("/")[2], set()).add(name)
    cells: list[list[str | Text]] = []
    for row in rows:
        name = row.input.removeprefix(base) + (f" #{row.person}" if row.person else "")
        status = Text(printable(f"{row.status} {row.code}".strip()), _STYLES[row.status])
        if what == "events":
            start, end, score = (
                "" if value is None else f"{value:.2f}" for value in (row.start, row.end, row.score)
            )
            cells.append([name, start, end, row.label or "-", score, _nearest(row, clips), status])
        elif what == "labels":
            known = (row.distance, getattr(row, sure))
            numbers = ["" if value is None else f"{value:.3f}" for value in known]
            cells.append([name, row.label or "-", *numbers, _nearest(row, clips), status])
        else:
            counts = (row.frames_read, row.frames_looked_at, row.frames_with_pose)
            frames = [*map(str, counts), f"{row.seconds:.1f}"]
            cells.append([name, *frames, status])
    print_table(columns, cells, right=[columns[i] for i in right])


def _nearest(row: Row, clips: Mapping[str, Collection[str]]) -> str:
    """The nearest example, with the folder above where that is its label; and with as many folders as tell it
    from the others of ``clips`` that have the name of its file.
    """
    if not row.neighbors:
        return ""
    name, label, _ = row.neighbors[0]
    parts = (name.partition("::")[0] if "://" in name else name).split("/")  # of a file in an archive
    least = 2 if parts[-2:-1] == [label] else 1
    others = [other.split("/") for other in clips.get(parts[-1], ()) if other != name]
    while least < len(parts) and any(other[-least:] == parts[-least:] for other in others):
        least += 1
    return "/".join(parts[-least:])


def _common_folder(names: Sequence[str]) -> str:
    """The folder that all of ``names`` are in, with a slash at its end."""
    if len(names) < 2:
        return ""
    first, last = min(names), max(names)
    shared = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[: first.rfind("/", 0, shared) + 1]


_OF_KEYPOINTS = ("order", "axes", "unit", "frame_size", "fps")
"""Settings of keypoint files, of which a reader says what it assumed."""


def say_assumed(assumed: Mapping[str, int]) -> None:
    """What files do not say and was assumed, and of how many, on standard error."""
    for what, files in sorted(assumed.items()):
        say(f"assumed for {counted(files, 'file')}: {what}")
    names = [part.partition("=")[0] for what in assumed for part in what.split(", ")]
    if keys := [f"keypoints.{name}" for name in dict.fromkeys(names) if name in _OF_KEYPOINTS]:
        say(f"where that is wrong, --set says what is right: {', '.join(keys)}")


def say_notes(notes: Mapping[str, int]) -> None:
    """What is worth knowing of files, and of how many, the most frequent first, on standard error."""
    ordered = sorted(notes.items(), key=lambda pair: (-pair[1], pair[0]))
    for what, files in ordered[:_NOTES_SHOWN]:
        say(f"{counted(files, 'file')}: {what}")
    if ordered[_NOTES_SHOWN:]:
        say(f"… and {counted(len(ordered) - _NOTES_SHOWN, 'more note')} in the column 'note'")


def mirroring_hint(sided: Sequence[str]) -> str:
    """That labels for the left and the right may be one gesture; ``sided`` from `examples.sided_labels`."""
    return (
        f"{', '.join(map(repr, sided))} and the like on the right may be one gesture with either "
        "hand, and classify.mirror then takes one for the other: --set classify.mirror=none"
    )


def check_file(
    path: Path, suffixes: Sequence[str] = (), *, flag: str = "--out", replace: bool = True
) -> None:
    """Raise where no file can be written at ``path``: before the work begins, not after hours of it.

    ``E_OPTION`` for a name that ends in none of ``suffixes``, ``E_EXISTS`` for a file that is there and not
    to be replaced, ``E_OUT`` for a folder or a place that cannot be written to.
    """
    if suffixes and path.suffix.lower() not in suffixes:
        remedy = f"a name that ends in {' or '.join(suffixes)}"
        raise InputError(f"{flag} {path}", remedy=remedy, code="E_OPTION")
    check_local(path, f"{flag} {path}")
    if path.is_dir():
        raise ConfigError(f"{flag} {path} is a folder", remedy="a file", code="E_OUT")
    if path.exists() and not replace:
        raise InputError(
            "there is a file of this name",
            subject=str(path),
            kept="that one",
            remedy=f"--overwrite, or another {flag}",
            code="E_EXISTS",
        )
    _check_writable(path.parent, f"{flag} {path}")


def check_folder(path: Path, *, flag: str = "--out") -> None:
    """Raise ``E_OUT`` where ``path`` is a file, or no folder that can be written to."""
    check_local(path, f"{flag} {path}")
    if path.exists() and not path.is_dir():
        raise ConfigError(f"{flag} {path} is a file", remedy="a folder", code="E_OUT")
    _check_writable(path, f"{flag} {path}")


def _check_writable(folder: Path, what: str) -> None:
    """Try it, in the nearest folder that is there: no permission bit knows as much."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        cause = f"{what} cannot be written ({there}: {error.strerror or error})"
        raise ConfigError(cause, remedy="another place, or its permissions", code="E_OUT") from None
