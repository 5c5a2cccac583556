"""Lists of paths, and tables of paths and labels, as people and spreadsheets write them."""

from __future__ import annotations

import csv
import difflib
import os
import re
import unicodedata
import warnings
from collections.abc import Iterable, Iterator, Sequence
from itertools import dropwhile
from pathlib import Path, PurePosixPath

from gesture_core.errors import ConfigError, InputError
from gesture_core.files import printable
from gesture_core.run.addresses import is_address, local_path
from gesture_core.run.inputs import VIDEO_SUFFIXES, Input

NO_TEXT, SAVE_AS_TEXT = "is not text in UTF-8", "saving it as UTF-8"
_REMARK = re.compile(r"#(?!\S[^,;\t]*[./])")  # #1.mp4 is a file
_PATHS = ("path", "input", "file", "video")
# Headings of others, where there is only one of them.
_MORE_PATHS = frozenset(
    "filename file_name filepath file_path videoname video_name videopath video_path video_id clip clip_id "
    "clip_name name".split()
)
_MORE_LABELS = frozenset(
    "labels class class_name classname gesture gesture_name sign gloss category action activity".split()
)
_MARKS = ",;\t|"
_DRIVE = re.compile(r"[A-Za-z]:[\\/]")
Parts = tuple[str, ...]


def read_manifest(path: Path) -> list[tuple[Path | str, str | None]] | None:
    """Paths or addresses, and labels, listed in ``path``, a file called so; None where it is no manifest.

    A text manifest (``.txt``) has one path a line, a CSV manifest a column ``path`` and perhaps
    ``label``. Relative paths start at the manifest's folder; lines that begin with ``#`` are comments.

    Raises
    ------
    InputError
        Where it looks like one and cannot be read.
    """
    subject = printable(os.fspath(path))
    try:
        if path.suffix.lower() == ".txt":
            lines = [line for line in _lines(path) if line.strip() and not line.startswith("#")]
            return [(_listed(path.parent, line), None) for line in lines]
        lines = list(_lines(path, ends=True))
        cells, mark = headings(lines)
        if (at := _first(cells, _PATHS)) is None:
            return None
        label = cells.index("label") if "label" in cells else len(cells)
        rows = list(csv.reader(lines, delimiter=mark))[1:]
        return [
            (_listed(path.parent, row[at]), _text(row[label]) or None if label < len(row) else None)
            for row in rows
            if at < len(row) and row[at]
        ]
    except UnicodeError:
        raise InputError(NO_TEXT, subject=subject, remedy=SAVE_AS_TEXT, code="E_MANIFEST") from None
    except (OSError, csv.Error) as error:
        raise InputError(f"not a manifest: {error}", subject=subject, code="E_MANIFEST") from None


def _listed(folder: Path, text: str) -> Path | str:
    """An address as it is written, or the path."""
    return text if is_address(text) else place(folder, local_path(text))


def place(folder: Path, text: str) -> Path:
    """The path that is written as ``text`` in a list in ``folder``: with the separators of Windows, too."""
    found = folder / text
    return folder / text.replace("\\", "/") if "\\" in text and not os.path.lexists(found) else found


def read_labels(path: Path, columns: str = "") -> tuple[list[tuple[str, str]], bool]:
    """The paths and labels in a table of any separator.

    Parameters
    ----------
    path : Path
    columns : str
        ``PATH,LABEL``: two headings, or two numbers of columns, from 1, in a table without a header.
        By default, headings that say so; a table of two columns may do without.

    Returns
    -------
    entries : list of (str, str)
        Path as it is written, and label, empty where there is none.
    header : bool
        Whether a heading told which column is which.

    Raises
    ------
    ConfigError
        ``E_LABELS`` where there is no such file or column.
    """
    try:
        lines = [line for line in _lines(path, ends=True) if line.strip()]
        lines = list(dropwhile(_REMARK.match, lines))
        if not lines:
            raise ConfigError("is empty", subject=str(path), remedy="path,label", code="E_LABELS")
        cells, mark = headings(lines)
        chosen, header = _columns(path, cells, columns)
        rows = list(csv.reader(lines, delimiter=mark))[header:]
        entries = [(row[chosen[0]], _text(row[chosen[1]])) for row in rows if len(row) > max(chosen)]
        entries += [(row[chosen[0]], "") for row in rows if chosen[0] < len(row) <= chosen[1]]
    except UnicodeError:
        raise ConfigError(NO_TEXT, subject=str(path), remedy=SAVE_AS_TEXT, code="E_LABELS") from None
    except (OSError, csv.Error) as error:
        cause = "no such file" if isinstance(error, FileNotFoundError) else f"cannot be read: {error}"
        raise ConfigError(cause, subject=str(path), remedy="check the path", code="E_LABELS") from None
    return [(text.strip(), label) for text, label in entries if text.strip()], header


def _columns(path: Path, cells: Sequence[str], columns: str) -> tuple[tuple[int, int], bool]:
    """Numbers of the columns of path and label, and whether the first line is a header."""
    known = printable(", ".join(cell or "(none)" for cell in cells))[:200]
    if columns:
        names = [name.strip().casefold() for name in columns.split(",")]
        if len(names) != 2 or not all(names):
            raise ConfigError(
                f"--label-columns {columns!r}", remedy="two headings, such as filename,class", code="E_OPTION"
            )
        if all(name in cells for name in names):
            return (cells.index(names[0]), cells.index(names[1])), True
        if all(name.isdigit() and 0 < int(name) <= len(cells) for name in names):
            return (int(names[0]) - 1, int(names[1]) - 1), False
        lost = next(name for name in names if name not in cells)
        raise ConfigError(
            f"has no column {lost!r}, but {known}",
            subject=str(path),
            remedy="--label-columns with two of its headings, or numbers from 1 if it has no header",
            code="E_LABELS",
        )
    at, label = _path_column(cells), _label_column(cells)
    if at is not None and label is not None and at != label:
        return (at, label), True
    if at is None and label is None and len(cells) == 2:
        return (0, 1), False
    raise ConfigError(
        f"has no column {'path' if at is None else 'label'!r}, but {known}",
        subject=str(path),
        remedy="its first line: path,label, or --label-columns PATH,LABEL with two of its headings",
        code="E_LABELS",
    )


def _path_column(cells: Sequence[str]) -> int | None:
    return _first(cells, _PATHS) if _first(cells, _PATHS) is not None else _only(cells, _MORE_PATHS)


def _label_column(cells: Sequence[str]) -> int | None:
    return cells.index("label") if "label" in cells else _only(cells, _MORE_LABELS)


def _first(cells: Sequence[str], names: Sequence[str]) -> int | None:
    return next((cells.index(name) for name in names if name in cells), None)


def _only(cells: Sequence[str], names: frozenset[str]) -> int | None:
    found = [number for number, cell in enumerate(cells) if cell in names]
    return found[0] if len(found) == 1 else None


def headings(lines: Iterable[str]) -> tuple[list[str], str]:
    """The cells of the first line, and the separator by which there are some that say what they are.

    Spreadsheets write others than commas; a space separates only where it does so in every line.
    """
    every = list(lines)
    first = every[0] if every else ""
    found = {mark: _cells(first, mark) for mark in _MARKS}
    for wanted in (_path_column, _label_column):
        for mark, cells in found.items():
            if len(cells) > 1 and wanted(cells) is not None:
                return cells, mark
    if _path_column(found[","]) is not None:
        return found[","], ","
    for mark in (*_MARKS, " "):
        rows = list(csv.reader(every, delimiter=mark))
        counts = {len(row) for row in rows}
        if counts == {2} or (len(counts) == 1 and mark != " " and counts > {1}):
            return _folded(rows[0]), mark
    return found[","], ","


def _cells(line: str, mark: str) -> list[str]:
    return _folded(next(csv.reader([line], delimiter=mark), []))


def _folded(cells: Sequence[str]) -> list[str]:
    return [cell.strip().casefold() for cell in cells]


def _lines(path: Path, *, ends: bool = False) -> Iterator[str]:
    """The lines of a text; a UnicodeError where they are UTF-16, as spreadsheets offer to write.

    With their ``ends`` where cells may run over several lines.
    """
    with path.open(encoding="utf-8-sig", errors="surrogateescape", newline="") as file:
        for line in file:
            if "\0" in line:
                raise UnicodeError
            yield line if ends else line.rstrip("\r\n")


def _text(cell: str) -> str:
    """A label; a UnicodeError where it is in another encoding, in which a name of a file may well be."""
    cell.encode("utf-8")
    return cell.strip()


class LabelTable:
    """Labels by path, from a table.

    A line is about the input at its path, as seen from the folder of the table; otherwise about the one input
    whose path ends as the line's does, with or without the suffix. An absolute path that is not here, as of
    another computer, may begin otherwise.

    Parameters
    ----------
    path : Path
    columns : str
        As in `read_labels`.
    items : sequence of Input

    Raises
    ------
    ConfigError
        ``E_LABELS`` where the table cannot be used.
    InputError
        ``E_CONTRADICTION`` where an input has two labels.
    """

    def __init__(self, path: Path, columns: str, items: Sequence[Input]) -> None:
        self._path = path
        self._folder = path.parent
        entries, header = read_labels(path, columns)
        self._exact: dict[str, str] = {}
        self._ends: dict[Parts, set[str]] = {}
        self._loose: dict[Parts, set[str]] = {}
        self._lines: list[tuple[str, Parts]] = []
        for text, label in entries:
            self._add(text, label)
        if not any(label for _, label in entries):
            raise ConfigError(
                "has no label in any line", subject=str(path), remedy="path,label", code="E_LABELS"
            )
        self._labels = {item.key: self._find(item) for item in items}
        if not header and not any(self._labels.values()):
            first = ",".join(entries[0])
            raise ConfigError(
                f"has no header, and no line about any input: its first line is {printable(first)[:200]!r}",
                subject=str(path),
                remedy="its first line: path,label, or --label-columns 1,2",
                code="E_LABELS",
            )
        self._refuse_shared(items)
        self._warn_of_others(items)
        if loose := sum(
            found is not None and found[1] != () and found[1] not in self._ends
            for found in self._labels.values()
        ):
            text = (
                f"{path}: {loose} of {len(items)} inputs were found by the end of a path that is not here, "
            )
            text += "or of a video of their name"
            warnings.warn(text, stacklevel=2)

    def __call__(self, item: Input) -> str | None:
        found = self._labels.get(item.key)
        return found[0] if found else None

    def refusal(self, item: Input) -> tuple[str, str]:
        """Why ``item`` has no label, and what helps."""
        remedy = "a line for it, its path as seen from the folder of the table"
        name = _spelling(item.path)
        if name in self._exact:
            return "its line there has no label", remedy
        folder = _spelling(self._folder / "x")[:-2]
        listed = [os.path.relpath(path, folder) for path in self._exact]
        near = difflib.get_close_matches(os.path.relpath(name, folder), listed, 1, 0.8)
        return "it has no line for it" + (f", {printable(near[0])!r} is near" if near else ""), remedy

    def _add(self, text: str, label: str) -> None:
        entry = place(self._folder, text)
        spelled = _spelling(entry)
        known = self._exact.get(spelled)
        if known and label and known != label:
            raise self._contradiction(os.fspath(entry), known, label)
        self._exact[spelled] = known or label
        written = unicodedata.normalize("NFC", text.replace("\\", "/"))
        parts = tuple(part for part in PurePosixPath(written).parts if part not in ("/", "."))
        if label and parts:
            self._lines.append((text, parts))
        if label and parts and ".." not in parts:
            elsewhere = written.startswith("/") or _DRIVE.match(text) is not None or "://" in text
            self._ends.setdefault(parts, set()).add(label)
            for start in range(1, len(parts)) if elsewhere else ():
                self._loose.setdefault(parts[start:], set()).add(label)
            stem, _, suffix = parts[-1].rpartition(".")
            if (
                stem and f".{suffix.lower()}" in VIDEO_SUFFIXES
            ):  # a list of videos, of which here are keypoints
                for start in range(len(parts) if elsewhere else 1):
                    self._loose.setdefault((*parts[start:-1], stem), set()).add(label)

    def _find(self, item: Input) -> tuple[str, Parts] | None:
        """The label of an input, and by which end of its path it was found; none where it is the path."""
        if label := self._exact.get(_spelling(item.path)):
            return label, ()
        if _spelling(item.path) in self._exact:
            return None
        whole = Path(_spelling(item.path)).parts[1:]
        for known in (self._ends, self._loose):
            for start in range(len(whole)):
                for name in _names(whole[-1]):
                    end = (*whole[start:-1], name)
                    if labels := known.get(end):
                        if len(labels) > 1:
                            raise self._contradiction(item.name, *sorted(labels)[:2])
                        return next(iter(labels)), end
        return None

    def _refuse_shared(self, items: Sequence[Input]) -> None:
        """One line cannot be about clips of the same name in two folders."""
        first: dict[Parts, Input] = {}
        for item in items:
            found = self._labels[item.key]
            if found is None or not found[1]:
                continue
            other = first.setdefault(found[1], item)
            if other.path.parent != item.path.parent:
                raise ConfigError(
                    f"one line, {printable('/'.join(found[1]))}, could be about {other.name} and {item.name}",
                    subject=str(self._path),
                    remedy="paths with their folders in the table",
                    code="E_LABELS",
                )

    def _warn_of_others(self, items: Sequence[Input]) -> None:
        """Say of lines that none of ``items`` is about: a clip may be missing, or be spelled otherwise."""
        here = {_spelling(item.path) for item in items}
        ends = {found[1] for found in self._labels.values() if found}
        lost = [
            text
            for text, parts in self._lines
            if _spelling(place(self._folder, text)) not in here
            and not any((*parts[n:-1], name) in ends for n in range(len(parts)) for name in _names(parts[-1]))
        ]
        if lost and all(self._labels[item.key] for item in items if item.readable):
            text = f"{self._path}: {len(lost)} of {len(self._lines)} lines are about no input here"
            warnings.warn(f"{text}, the first is {printable(lost[0])}", stacklevel=2)

    def _contradiction(self, name: str, one: str, other: str) -> InputError:
        return InputError(
            f"is listed as {one} and as {other}",
            subject=printable(name),
            remedy=f"one line for it in {self._path}",
            code="E_CONTRADICTION",
        )


def _names(name: str) -> Iterator[str]:
    """A file's name, and without its suffixes: that of our own keypoint files follows the video's."""
    yield name
    for _ in range(2):
        stem, dot, suffix = name.rpartition(".")
        if not stem or not dot or not suffix.isalnum():
            return
        name = stem
        yield name


def _spelling(path: Path) -> str:
    """An absolute path with its accents in one form: some systems take letters and accents apart.

    The last part is not followed where it is a link: two names may stand for one content.
    """
    return unicodedata.normalize("NFC", os.path.join(path.parent.resolve(), path.name))  # noqa: PTH118
