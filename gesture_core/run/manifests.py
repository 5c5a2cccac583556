"""Lists of inputs: text with a path a line, tables with a column ``path`` and perhaps ``label``."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from gesture_core.errors import InputError
from gesture_core.files import printable

NO_TEXT, SAVE_AS_TEXT = "is not text in UTF-8", "saving it as UTF-8"
_PATH_COLUMNS = ("path", "input", "file", "video")


def read_manifest(path: Path) -> list[tuple[Path, str | None]] | None:
    """Paths and labels listed in ``path``; None where it is no manifest.

    A text manifest (``.txt``) has one path a line, a CSV manifest a column ``path`` and perhaps
    ``label``. Relative paths start at the manifest's folder; lines that begin with ``#`` are comments.

    Raises
    ------
    InputError
        Where it looks like one and cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix not in (".txt", ".csv"):
        return None
    try:
        with path.open(encoding="utf-8-sig", errors="surrogateescape", newline="") as file:
            if suffix == ".txt":
                lines = [line.rstrip("\r\n") for line in _text(file)]
                entries = [line for line in lines if line.strip() and not line.startswith("#")]
                return [(path.parent / entry, None) for entry in entries]
            mark, columns = _header(file.readline())
            place = _path_column(columns)
            if place is None:
                return None
            label = columns.index("label") if "label" in columns else len(columns)
            return [
                (path.parent / cells[place], _label(cells[label] if label < len(cells) else ""))
                for cells in csv.reader(_text(file), delimiter=mark)
                if place < len(cells) and cells[place]
            ]
    except UnicodeError:
        raise InputError(
            NO_TEXT, subject=printable(os.fspath(path)), remedy=SAVE_AS_TEXT, code="E_MANIFEST"
        ) from None
    except (OSError, csv.Error) as error:
        raise InputError(
            f"not a manifest: {error}", subject=printable(os.fspath(path)), code="E_MANIFEST"
        ) from None


def _text(lines: Iterable[str]) -> Iterator[str]:
    """The lines; a UnicodeError where they are UTF-16, as spreadsheets offer to write."""
    for line in lines:
        if "\0" in line:
            raise UnicodeError
        yield line


def _label(cell: str) -> str | None:
    """A label; a UnicodeError where it is in another encoding, in which a name of a file may well be."""
    cell.encode("utf-8")
    return cell.strip() or None


def _header(line: str) -> tuple[str, list[str]]:
    """The separator of a table (spreadsheets write others than commas) and the names of its columns."""
    found = {
        mark: [name.strip().casefold() for name in next(csv.reader([line], delimiter=mark), [])]
        for mark in ",;\t"
    }
    mark = next((mark for mark in found if _path_column(found[mark]) is not None), ",")
    return mark, found[mark]


def _path_column(columns: Sequence[str]) -> int | None:
    return next((columns.index(name) for name in _PATH_COLUMNS if name in columns), None)


def lacking(path: Path) -> str:
    """What keeps a table from having labels."""
    with path.open(encoding="utf-8-sig", errors="surrogateescape", newline="") as file:
        line = file.readline()
    _, columns = _header(line)
    if not line.strip():
        return "is empty"
    if "\0" in line:
        return NO_TEXT
    if "label" in columns and _path_column(columns) is not None:
        return "has no label in any line"
    missing = "path" if _path_column(columns) is None else "label"
    return f"has no column {missing!r}, but {printable(', '.join(columns))[:200]}"
