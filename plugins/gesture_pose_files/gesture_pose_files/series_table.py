"""Tables of channels as text, with all that devices write above them, beside them, and as times."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_pose_files.files import MAX_CSV_BYTES, MAX_FRAMES, open_keypoints
from gesture_pose_files.table import (
    MAX_LINE,
    lines_above,
    number_in,
    numbers_of,
    rows_of,
    seconds_in,
    split_header,
)

_LOOKED_AT = 20
_ABOVE = 400
"""Lines in which a table begins."""
_ALIKE = 3
"""Rows of numbers that show it."""
_MOST_CELLS = 1 << 28
_DATE = re.compile(r"\s*\d{1,4}[./-]\d{1,2}[./-]\d{1,4}[ T]+")
_BEGAN, _FASTEST = 9.4e8, 2000.0
"""Of Empatica's first two rows: a date in seconds, and samples a second."""


@dataclass(frozen=True)
class TextTable:
    """The columns of a table.

    Attributes
    ----------
    columns : dict of (T,) float64 arrays
        By their names.
    named : bool
        Whether a header says these.
    clock : str or None
        Which of them is the time.
    left_out : list of str
        Columns of text.
    rate : float
        Samples a second, where the table says it; else 0.
    notes : list of str
    """

    columns: dict[str, np.ndarray]
    named: bool
    clock: str | None
    left_out: list[str]
    rate: float
    notes: list[str]


def read_text(path: Path, clock_of: Callable[[Sequence[str]], int | None]) -> TextTable:
    """The table of a text file; ``clock_of`` says which of the names is a time."""
    source, notes = printable(path), []
    with open_table(path) as (above, names, rows):
        if above:
            notes.append(
                "its first line is no table" if above == 1 else f"its first {above} lines are no table"
            )
        first = list(islice(rows, _LOOKED_AT))
        if not first:
            raise KeypointError("holds no row", subject=source, code="E_KEYPOINTS_EMPTY")
        width = len(first[0])
        called = [name.strip() or f"column {n + 1}" for n, name in enumerate(names or [""] * width)]
        if len(called) != width:
            cause = f"its header has {len(called)} cells, its first row {width}"
            raise KeypointError(cause, subject=source, code="E_KEYPOINTS_FORMAT")
        if width * len(first) > _MOST_CELLS:
            raise KeypointError("is too wide", subject=source, code="E_KEYPOINTS_LIMIT")
        even = [row for row in first if len(row) == width]
        text = [n for n in range(width) if all(number_in(row[n]) is None for row in even)]
        wanted = [n for n in range(width) if n not in text]
        table, rest = numbers_of(chain(first, rows), width, wanted, called, MAX_FRAMES, source)
    filled = np.flatnonzero(~np.isnan(table).all(axis=1))
    last = int(filled[-1]) + 1 if len(filled) else len(table)  # below are the empty rows of a spreadsheet
    table, rest = table[:last], rest[:last]
    columns = {called[n]: table[:, n] for n in wanted}
    if len(columns) < len(wanted):
        twice = next(name for name in called if called.count(name) > 1)
        raise KeypointError(f"has two columns {twice!r}", subject=source, code="E_KEYPOINTS_FORMAT")
    texts = {called[n]: [row[place] for row in rest] for place, n in enumerate(text)}
    clock = clock_of(called)
    said = None if clock is None else called[clock]
    if said is None:
        said = next((name for name, cells in texts.items() if _dates(cells[:_LOOKED_AT]) is not None), None)
    if said in texts:
        cells = texts.pop(said)
        times = _dates(cells)
        if times is None:
            raise KeypointError(
                f"its times, such as {cells[0].strip()[:30]!r}, are neither numbers nor dates, "
                "or clocks of several days",
                subject=source,
                remedy="seconds, or dates such as 2024-05-01T12:00:00.250",
                code="E_KEYPOINTS_TIMES",
            )
        columns = {said: times, **columns}
    if said is not None:
        _refuse_long(columns[said], texts, source)
    rate = 0.0
    if names is None and not texts and (rate := _rate_above(table)):
        notes.append(f"its first two rows say when it began and {rate:g} samples a second")
        columns = {name: column[2:] for name, column in columns.items()}
    return TextTable(columns, names is not None, said, list(texts), rate, notes)


def lacking(path: Path, clock_of: Callable[[Sequence[str]], int | None]) -> str:
    """Why a text file is no table of channels; empty where it is one."""
    try:
        with open_table(path) as (_, names, rows):
            first = next(rows, None)
    except KeypointError as error:
        return error.cause
    if first is None:
        return "it has no row below its header" if names else "it has no row"
    clock = clock_of(names) if names else None
    if not any(number_in(cell) is not None for place, cell in enumerate(first) if place != clock):
        return f"its first row {','.join(first)[:60]!r} holds no number"
    return ""


@contextmanager
def open_table(path: Path) -> Iterator[tuple[int, list[str] | None, Iterator[list[str]]]]:
    """Lines above the table, its names, and its rows."""
    above = _lines_above(path)
    with open_keypoints(path, MAX_CSV_BYTES) as file:
        for _ in range(above):
            file.readline()
        yield above, *split_header(rows_of(file, printable(path)), lambda names: None, units=True)


def _lines_above(path: Path) -> int:
    """Lines before the header of a table: a title, remarks, facts about the device."""
    with open_keypoints(path, MAX_CSV_BYTES) as file:
        read = islice(iter(lambda: file.readline(MAX_LINE), b""), _ABOVE)
        return lines_above([line.decode("utf-8-sig", "replace").strip("\r\n") for line in read])


def _dates(cells: Sequence[str]) -> np.ndarray | None:
    """Seconds of dates as ISO 8601 writes them, or of clocks behind one date in any form; None for others."""
    days = {found[0] for cell in cells if (found := _DATE.match(cell))}
    times = [seconds_in(cell) for cell in cells]
    if None in times and len(days) == 1:
        times = [seconds_in(_DATE.sub("", cell)) for cell in cells]
    values = np.array(times, np.float64)
    return None if not len(values) or np.isnan(values).any() else values


def _refuse_long(times: np.ndarray, texts: dict[str, list[str]], source: str) -> None:
    """Refuse rows of one value each, of which a text says what it is."""
    if len(times) < _ALIKE or not (np.diff(times) == 0).mean() > 0.5:
        return
    for name, cells in texts.items():
        if len(set(zip(times.tolist(), cells, strict=True))) == len(times):
            raise KeypointError(
                f"holds several rows for each time, told apart by {name!r}",
                subject=source,
                remedy="a row for each time, with a column for each channel (a pivot table)",
                code="E_KEYPOINTS_FORMAT",
            )


def _rate_above(table: np.ndarray) -> float:
    """Samples a second by the second of two rows above the samples, as Empatica's devices write them."""
    if len(table) < _ALIKE or np.ptp(table[0]) or np.ptp(table[1]) or not table[0, 0] > _BEGAN:
        return 0.0
    rate = float(table[1, 0])
    return rate if 0 < rate <= _FASTEST and np.nanmax(np.abs(table[2:])) < _BEGAN else 0.0
