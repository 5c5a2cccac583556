"""Text tables, read without trust: the separator, the rows of a header, numbers as people write them."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from itertools import chain, islice
from typing import IO

import numpy as np

from gesture_core.channel_names import is_unit
from gesture_core.errors import KeypointError
from gesture_pose_files.files import MAX_FRAMES

MAX_LINE = 1 << 20
SUFFIXES = (".csv", ".tsv", ".txt")
"""Of the tables that readers of this plugin take."""
_MOST_HEADS = 6
_LOOKED_AT = 8
_NAMES_ITS_SEPARATOR = re.compile(r'"?sep=(.|\\t)"?', re.IGNORECASE)
_FEWEST = 20  # columns of a bare table
# 1,024.5 and 1.024,5; 1 024,5 and 1'024. What 1,024 is, its neighbours say.
_THOUSANDS = re.compile(
    r"[+-]?[0-9]{1,3}(?:(?:,[0-9]{3})+\.[0-9]+|(?:\.[0-9]{3})+,[0-9]+"
    r"|(?:[ '\u2019\u00a0\u202f][0-9]{3})+(?:[.,][0-9]+)?)"
)
_CLOCK = re.compile(
    r"(?:(\d+) days? )?(?:(\d{1,2}):)?(\d{1,2}):(\d{2}(?:[.,]\d+|:\d{3})?)(?:\s*([ap])\.?m\.?)?", re.I
)
_MISSING = frozenset(
    "|nan|-nan|none|null|na|n/a|n.a.|#n/a|#nv|<na>|nil|-|--|.|?|1.#qnan|1.#ind|-1.#ind".split("|")
)
UNITS = dict.fromkeys(("px", "pixel", "pixels"), "pixels") | dict.fromkeys(
    ("m", "mm", "cm", "metre", "metres", "meter", "meters", "millimeters", "millimetres"), "metres"
)
"""Of coordinates, as headers say them, and what ``keypoints.unit`` calls them."""
_NO_UNIT = ("", "-", "1")
_MAX_ROWS = MAX_FRAMES * 64
_ALIKE = 3
"""Rows of one width that show a table."""


def rows_of(file: IO[bytes], source: str, mark: str = "") -> Iterator[list[str]]:
    """The cells of each line that is not blank, separated by ``mark``, or by what the first lines show.

    Memory holds few lines at a time.
    """
    lines = _lines(file, source)
    if not mark:
        first = list(islice(lines, _LOOKED_AT))
        if first and (named := _NAMES_ITS_SEPARATOR.fullmatch(first[0])):
            mark = named[1].replace("\\t", "\t")
            del first[0]
        mark, lines = mark or separator(first[-1] if first else ""), chain(first, lines)
    for line in lines:
        yield cells_of(line, mark)


def cells_of(line: str, mark: str) -> list[str]:
    """The cells of a line, none where its quotes are broken."""
    try:
        return line.split() if mark == " " else next(csv.reader([line], delimiter=mark), [])
    except csv.Error:
        return []


def _lines(file: IO[bytes], source: str) -> Iterator[str]:
    for number in range(1, _MAX_ROWS):
        line = file.readline(MAX_LINE + 1)
        if not line:
            return
        if len(line) > MAX_LINE:
            raise KeypointError(
                f"line {number} is longer than {MAX_LINE} bytes", subject=source, code="E_KEYPOINTS_LIMIT"
            )
        if b"\0" in line:
            raise KeypointError(
                f"line {number} is no UTF-8 text",
                subject=source,
                remedy="saving it as CSV in UTF-8",
                code="E_KEYPOINTS_FORMAT",
            )
        # Names of joints and numbers are the same in every code page; other cells may lose letters.
        text = line.decode("utf-8-sig" if number == 1 else "utf-8", "replace").strip("\r\n")
        if text.strip(" "):  # tabs alone are a row of empty cells
            yield text


def separator(line: str) -> str:
    """What separates the cells of a row, in which a comma may be a decimal one."""
    commas = line.count(",")
    rare = next((mark for mark in (";", "\t", "|") if mark in line and line.count(mark) + 1 >= commas), "")
    return rare or ("," if commas else " ")


def split_header(
    rows: Iterable[list[str]],
    known: Callable[[list[str]], object | None],
    *,
    units: bool = False,
    index: list[str] | None = None,
) -> tuple[list[str] | None, Iterator[list[str]]]:
    """The names of the columns, None where there are none, and the rows below them.

    A first row that only counts the columns, as data-frame libraries write it, is a header that names
    nothing. Names may take several rows, as one for joints and one for x and y: as many as it takes until
    they are ``known``. With ``units`` the last of these may be one of units. A title, which is shorter than
    the rows below, is no name; ``index`` takes what numbers the rows before columns without names; empty
    rows before a table without names are frames in which nobody was found.
    """
    rest = iter(rows)
    heads: list[list[str]] = []
    empty: list[list[str]] = []
    for cells in rest:
        if not any(cell.strip() for cell in cells):
            empty.append(cells)
            if len(empty) >= MAX_FRAMES:
                break
            continue
        if not heads and (shift := counting(cells)) is not None:
            return None, _indexed(rest, shift, index)
        if _is_data(cells) or len(heads) == _MOST_HEADS:
            heads = [head for head in heads if len(head) == len(cells)]
            return _joined(heads, units=units), chain([] if heads else empty, [cells], rest)
        heads.append(cells)
        alike = [head for head in heads if len(head) == len(cells)]
        if known(_joined(alike) or []) is not None:
            return _without_remarks(_joined(alike) or [], len(alike), rest)
    return _joined(heads, units=units), rest


def _indexed(rows: Iterator[list[str]], shift: int, index: list[str] | None) -> Iterator[list[str]]:
    for row in rows:
        if index is not None:
            index += row[:shift]
        yield row[shift:]


def _without_remarks(
    names: list[str], heads: int, rows: Iterator[list[str]]
) -> tuple[list[str], Iterator[list[str]]]:
    """The names, with units where the row below says some, and the rows without it.

    Such a row may also be the header once more, or the name of the index below a header of several rows.
    """
    first = next(rows, [])
    cells = [cell.strip() for cell in first]
    units = [re.sub(r"[\[\]() ]", "", cell).casefold() for cell in cells]
    if cells == [name.strip() for name in names]:
        return names, rows
    known = [unit in UNITS or unit in _NO_UNIT or is_unit(unit) for unit in units]
    if len(cells) == len(names) and all(known) and any(unit in UNITS for unit in units):
        pairs = zip(names, units, strict=True)
        return [name if unit in _NO_UNIT else f"{name} [{unit}]" for name, unit in pairs], rows
    if heads > 1 and cells[:1] != [""] and not any(cells[1:]) and number_in(cells[0]) is None:
        return names, rows
    return names, chain([first] if first else [], rows)


def lines_above(lines: Sequence[str]) -> int:
    """How many of the first lines stand before the header of a table: a title, remarks, facts.

    A table is what lasts to the end of the lines that are looked at with one number of cells; its header may
    have one more or less, which is another fault. Rows of a table that is broken by another line stay.
    """
    lines = list(lines)
    while lines and not lines[-1].strip(" "):
        lines.pop()
    if not lines:
        return 0
    mark = separator(lines[-1])
    widths = [len(cells_of(line, mark)) if line.strip(" ") else 0 for line in lines]
    width, start = widths[-1], len(lines)
    while start and widths[start - 1] in (0, width):
        start -= 1
    above = start
    if start and width > 2 and abs(widths[start - 1] - width) == 1:
        above -= 1
    while above < len(lines) and not widths[above]:
        above += 1
    return above if len(lines) - start >= _ALIKE and width not in widths[:start] else 0


def numbers_of(
    rows: Iterable[Sequence[str]],
    width: int,
    columns: Sequence[int],
    names: Sequence[str],
    most: int,
    source: str,
    clock: int | None = None,
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
    clock : int, optional
        The one of them that holds times, perhaps as clocks or calendars write them.

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
                remedy="a cell for each column in every row, and no remarks between or below them",
                code="E_KEYPOINTS_FORMAT",
            )
        values = np.full(width, np.nan)
        try:
            if any("_" in cell for cell in cells):  # which Python takes for a separator of digits
                raise ValueError
            values[wanted] = [float(cells[column]) for column in wanted]
        except ValueError:
            for column in wanted:
                value = (seconds_in if column == clock else number_in)(cells[column])
                if value is None:
                    where = repr(names[column].strip()[:40]) if names else str(column + 1)
                    raise KeypointError(
                        f"row {number}, column {where}: {cells[column].strip()[:40]!r} is no number",
                        subject=source,
                        remedy="numbers alone below the header, without units, sums or remarks, and an "
                        "empty cell where a joint is missing",
                        code="E_KEYPOINTS_FORMAT",
                    ) from None
                values[column] = value
        table.append(values)
        texts.append([cells[column] for column in rest])
    return (np.stack(table) if table else np.zeros((0, width))), texts


def refuse_thousands(table: np.ndarray, source: str) -> None:
    """Refuse columns of 950 and 1.024, in which the point, or the comma, separates thousands."""
    found = np.where(np.isfinite(table), table, 0)
    cut = found * 1000
    whole = (found >= 100) & (found < 1000) & (found == np.round(found))
    small = (found > 1) & (found < 10) & (np.abs(cut - np.round(cut)) < 1e-6)
    odd = ~whole & ~small & (found != 0)
    doubted = whole.any(axis=0) & (small & (found != np.round(found))).any(axis=0) & ~odd.any(axis=0)
    if doubted.any():
        column = int(np.flatnonzero(doubted)[0])
        one, other = (found[place[:, column], column][0] for place in (whole, small))
        raise KeypointError(
            f"a column holds {one:g} and {other:.3f}, which may be {other * 1000:g}",
            subject=source,
            remedy="numbers without separators of thousands",
            code="E_KEYPOINTS_FORMAT",
        )


def number_in(cell: str) -> float | None:
    """The number in a cell, with a decimal comma or point; NaN where it says that there is none; or None."""
    text = cell.strip()
    if text.casefold() in _MISSING:
        return np.nan
    if "_" in text:  # Python reads 0_1 as 1
        return None
    if _THOUSANDS.fullmatch(text):
        point = max(text.rfind("."), text.rfind(","))
        whole, part = (text[:point], text[point + 1 :]) if point > 0 else (text, "")
        text = re.sub("[^0-9+-]", "", whole) + f".{part}"
    if text.count(",") == 1 and "." not in text:
        text = text.replace(",", ".")
    try:
        return float(text)
    except ValueError:
        return None


def seconds_in(cell: str) -> float | None:
    """A time in a cell: a number as it is, 00:01:02.5 and days in seconds, a date in seconds since 1970."""
    value = number_in(cell)
    if value is not None:
        return value
    text = cell.strip()
    if found := _CLOCK.fullmatch(text):
        days, hours, minutes, seconds = (
            float(re.sub("[,:]", ".", part or "0")) for part in found.group(1, 2, 3, 4)
        )
        if found[5]:
            hours = hours % 12 + 12 * (found[5] in "pP")
        return ((days * 24 + hours) * 60 + minutes) * 60 + seconds
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


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
    if not all(cell.startswith(prefix) for cell in numbered):
        return None
    values = [number_in(cell.removeprefix(prefix)) for cell in numbered]
    return shift if any(values == list(range(start, start + len(values))) for start in (0, 1)) else None


def _is_data(cells: Sequence[str]) -> bool:
    """Whether a row holds numbers: half of what is not empty at least."""
    filled = [cell for cell in cells if cell.strip()]
    numbers = [cell for cell in filled if number_in(cell) is not None]
    return bool(filled) and 2 * len(numbers) >= len(filled)


def _joined(heads: list[list[str]], *, units: bool = False) -> list[str] | None:
    """One name for each column from the rows of a header; a cell that spans several is filled first."""
    last = [cell.strip() for cell in heads[-1] if cell.strip()] if units and len(heads) > 1 else []
    if last and all(map(is_unit, last)) and len(heads[-1]) == len(heads[-2]):
        names = _joined(heads[:-1]) or []
        return [
            f"{name} [{unit.strip()}]" if unit.strip() else name
            for name, unit in zip(names, heads[-1], strict=True)
        ]
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
