"""Text tables, read without trust: the separator, the rows of a header, numbers as people write them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import IO

import numpy as np

from gesture_core.errors import KeypointError
from gesture_pose_files.files import MAX_FRAMES

MAX_LINE = 1 << 20
SUFFIXES = (".csv", ".tsv")
"""Of the tables that readers of this plugin take."""
_MOST_HEADS = 4
_FEWEST = 20  # columns of a bare table
_MISSING = frozenset(("", "nan", "-nan", "none", "null", "na", "n/a", "#n/a", "<na>", "nil", "-", "--", "."))
_MAX_ROWS = MAX_FRAMES * 64


def rows_of(file: IO[bytes], source: str, mark: str = "") -> Iterator[list[str]]:
    """The cells of each line that is not blank, separated by ``mark``, or by what the first one shows.

    Memory holds one line at a time.
    """
    for number in range(1, _MAX_ROWS):
        line = file.readline(MAX_LINE + 1)
        if not line:
            return
        if len(line) > MAX_LINE:
            raise KeypointError(
                f"line {number} is longer than {MAX_LINE} bytes", subject=source, code="E_KEYPOINTS_LIMIT"
            )
        try:
            text = line.decode("utf-8-sig" if number == 1 else "utf-8").strip("\r\n")
        except UnicodeDecodeError:
            raise KeypointError(
                f"line {number} is no UTF-8 text",
                subject=source,
                remedy="saving it as CSV in UTF-8",
                code="E_KEYPOINTS_FORMAT",
            ) from None
        if text.strip():
            mark = mark or _separator(text)
            yield _cells(text, mark)


def split_header(
    rows: Iterable[list[str]], known: Callable[[list[str]], object | None]
) -> tuple[list[str] | None, Iterator[list[str]]]:
    """The names of the columns, None where there are none, and the rows below them.

    A first row that only counts the columns, as data-frame libraries write it, is a header that names
    nothing. Names may take several rows, as one for joints and one for x and y: as many as it takes until
    they are ``known``.
    """
    rest = iter(rows)
    heads: list[list[str]] = []
    for cells in rest:
        if not heads and (shift := counting(cells)) is not None:
            return None, (row[shift:] for row in rest)
        if _is_data(cells) or len(heads) == _MOST_HEADS:
            return _joined(heads), chain([cells], rest)
        heads.append(cells)
        if known(_joined(heads) or []) is not None:
            break
    return _joined(heads), rest


def numbers_of(
    rows: Iterable[Sequence[str]],
    width: int,
    columns: Sequence[int],
    names: Sequence[str],
    most: int,
    source: str,
) -> tuple[np.ndarray, list[list[str]]]:
    """(T, width) float64 of all rows, NaN for what is missing and for columns that are not wanted, and the
    text of the others.

    Parameters
    ----------
    rows : iterable of rows
    width : int
        Cells of each row.
    columns : sequence of int
        Those that hold numbers.
    names : sequence of str
        Of the columns, for errors; may be empty.
    most : int
        Rows.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_FORMAT`, `E_KEYPOINTS_LIMIT`.
    """
    table: list[np.ndarray] = []
    texts: list[list[str]] = []
    rest = [column for column in range(width) if column not in set(columns)]
    wanted = list(columns)
    for cells in rows:
        number = len(table) + 1
        if number > most:
            raise KeypointError(
                f"holds more than {most} rows", subject=source, remedy="split it", code="E_KEYPOINTS_LIMIT"
            )
        if len(cells) != width:
            raise KeypointError(
                f"row {number} has {len(cells)} cells, the first line has {width}",
                subject=source,
                code="E_KEYPOINTS_FORMAT",
            )
        values = np.full(width, np.nan)
        try:
            values[wanted] = [float(cells[column]) for column in wanted]
        except ValueError:
            for column in wanted:
                value = number_in(cells[column])
                if value is None:
                    where = repr(names[column].strip()[:40]) if names else str(column + 1)
                    raise KeypointError(
                        f"row {number}, column {where}: {cells[column].strip()[:40]!r} is no number",
                        subject=source,
                        remedy="an empty cell where a joint is missing",
                        code="E_KEYPOINTS_FORMAT",
                    ) from None
                values[column] = value
        table.append(values)
        texts.append([cells[column] for column in rest])
    return (np.stack(table) if table else np.zeros((0, width))), texts


def number_in(cell: str) -> float | None:
    """The number in a cell, with a decimal comma or point; NaN where it says that there is none; or None."""
    text = cell.strip()
    if text.casefold() in _MISSING:
        return np.nan
    if text.count(",") == 1 and "." not in text:
        text = text.replace(",", ".")
    try:
        return float(text)
    except ValueError:
        return None


def counting(cells: Sequence[str]) -> int | None:
    """Whether the cells of a row just count: 0,1,2,… or 1,2,3,…, each perhaps behind the same letters.

    1 where they do so behind an empty first cell, above a column that counts the rows; 0 where all do, else
    None.
    """
    shift = int(bool(cells) and not cells[0].strip())
    numbered = [cell.strip() for cell in cells[shift:]]
    if len(numbered) < _FEWEST:
        return None
    prefix = numbered[0].rstrip("0123456789.")
    if prefix.casefold() in ("x", "y") or not all(cell.startswith(prefix) for cell in numbered):
        return None
    values = [number_in(cell.removeprefix(prefix)) for cell in numbered]
    return shift if any(values == list(range(start, start + len(values))) for start in (0, 1)) else None


def _is_data(cells: Sequence[str]) -> bool:
    """Whether a row holds numbers: half of what is not empty at least."""
    filled = [cell for cell in cells if cell.strip()]
    numbers = [cell for cell in filled if number_in(cell) is not None]
    return bool(filled) and 2 * len(numbers) >= len(filled)


def _joined(heads: list[list[str]]) -> list[str] | None:
    """One name for each column from the rows of a header; a cell that spans several is filled first."""
    if len(heads) < 2:
        return heads[0] if heads else None
    if len({len(cells) for cells in heads}) > 1:
        return heads[0]
    heads = [list(cells) for cells in heads]
    for cells in heads[:-1]:
        for column in range(1, len(cells)):
            cells[column] = cells[column].strip() or cells[column - 1]
    # A row that says the same of every column, such as the name of a model, tells nothing.
    telling = [cells for cells in heads if len({cell.strip() for cell in cells[1:]}) > 1]
    return [" ".join(parts).strip() for parts in zip(*telling, strict=True)] if telling else heads[0]


def _separator(line: str) -> str:
    """What separates the cells: where there are semicolons or tabs, a comma may be a decimal one."""
    return next((mark for mark in (";", "\t") if mark in line), ",")


def _cells(line: str, mark: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=mark), [])
    except csv.Error:
        return []
