"""Where output goes: tables for people on a terminal, JSON lines through a pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from gesture_core.types import Row

_ROWS_SHOWN = 60
_REASONS_SHOWN = 20
_WORST = ("error", "degraded", "rejected", "skipped", "ok")
_STYLES = {"ok": "green", "degraded": "yellow", "rejected": "yellow", "skipped": "dim", "error": "red"}


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

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(column, justify="right" if column in right else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(visible(cell)) if isinstance(cell, str) else cell for cell in row))
    console().print(table)


def print_rows(rows: Sequence[Row], *, classified: bool = True) -> None:
    """The result: a table and what went wrong on a terminal, JSON lines otherwise."""
    if not sys.stdout.isatty():
        from gesture_core.run.export import json_line

        for row in rows:
            print(json_line(row.as_record()))
        return
    (result_table if classified else keypoint_table)(rows[:_ROWS_SHOWN])
    if len(rows) > _ROWS_SHOWN:
        print(f"… and {counted(len(rows) - _ROWS_SHOWN, 'more row')}: gesture export writes all of them")
    print_reasons(rows)


def print_reasons(rows: Sequence[Row]) -> None:
    """Why rows are not ``ok``, the worst first."""
    flawed = sorted((row for row in rows if row.message), key=lambda row: _WORST.index(row.status))
    for row in flawed[:_REASONS_SHOWN]:
        print(f"{row.status} {row.code} {visible(row.message)}")
    if len(flawed) > _REASONS_SHOWN:
        print(f"… and {counted(len(flawed) - _REASONS_SHOWN, 'more reason')} in the column 'message'")


def result_table(rows: Sequence[Row]) -> None:
    """One line for each row: input, label, distance, margin, nearest example and status."""
    cells = [
        (
            name,
            row.label or "-",
            _number(row.distance),
            _number(row.margin),
            _nearest(row),
            _status(row),
        )
        for name, row in zip(_names(rows), rows, strict=True)
    ]
    columns = ("input", "label", "distance", "margin", "nearest example", "status")
    print_table(columns, cells, right=("distance", "margin"))


def keypoint_table(rows: Sequence[Row]) -> None:
    """One line for each row of keypoints: input, frames, how many with a pose, seconds and status."""
    cells = [
        (name, str(row.frames_read), str(row.frames_with_pose), f"{row.seconds:.1f}", _status(row))
        for name, row in zip(_names(rows), rows, strict=True)
    ]
    columns = ("input", "frames", "with a pose", "seconds", "status")
    print_table(columns, cells, right=columns[1:4])


def say_assumed(assumed: Mapping[str, int]) -> None:
    """What keypoint files do not say and was assumed, and of how many, on standard error."""
    for what, files in sorted(assumed.items()):
        print(f"assumed for {counted(files, 'keypoint file')}: {visible(what)}", file=sys.stderr)


def visible(text: str) -> str:
    """``text`` with control characters escaped, so that a file name cannot move the cursor."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def counted(number: int, noun: str) -> str:
    """``1 row``, ``2 rows``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _names(rows: Sequence[Row]) -> list[str]:
    """The inputs without the folder that all of them are in, and the number of the person."""
    base = _common_folder([row.input for row in rows])
    return [row.input.removeprefix(base) + (f" #{row.person}" if row.person else "") for row in rows]


def _nearest(row: Row) -> str:
    """The nearest example, with the folder above where that is its label."""
    if not row.neighbors:
        return ""
    name, label, _ = row.neighbors[0]
    folder, _, clip = name.rpartition("/")
    return f"{label}/{clip}" if folder.rpartition("/")[2] == label else clip


def _status(row: Row) -> Text:
    from rich.text import Text

    return Text(visible(f"{row.status} {row.code}".strip()), _STYLES[row.status])


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def _common_folder(names: Sequence[str]) -> str:
    if len(names) < 2:
        return ""
    first, last = min(names), max(names)
    shared = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[: first.rfind("/", 0, shared) + 1]
