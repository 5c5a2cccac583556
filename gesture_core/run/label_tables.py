"""Labels from tables: which line of a table is about an input."""

from __future__ import annotations

import difflib
import os
import re
import unicodedata
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from gesture_core.errors import ConfigError, InputError
from gesture_core.files import printable
from gesture_core.run.inputs import Input
from gesture_core.run.manifests import place, read_labels

_DRIVE = re.compile(r"[A-Za-z]:[\\/]")

Parts = tuple[str, ...]


class LabelTable:
    """Labels by path, from a table.

    A line is about the input at its path, as seen from the folder of the table; otherwise about the one input
    whose path ends as the line's does, with or without the suffix. An absolute path that is not here, as of
    another computer, may begin otherwise.

    Parameters
    ----------
    path : Path
    columns : str
        As in `manifests.read_labels`.
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
        self._written: dict[str, str] = {}
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
        if loose := sum(
            found is not None and found[1] != () and found[1] not in self._ends
            for found in self._labels.values()
        ):
            text = f"{path}: {loose} of {len(items)} inputs were found by the end of a path that is not here"
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
        if label and parts and ".." not in parts:
            elsewhere = written.startswith("/") or _DRIVE.match(text) is not None
            self._ends.setdefault(parts, set()).add(label)
            for start in range(1, len(parts)) if elsewhere else ():
                self._loose.setdefault(parts[start:], set()).add(label)

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
