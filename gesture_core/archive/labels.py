"""Lists of inputs, and the labels of examples: from folders, tables, or regular expressions."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gesture_core.errors import ConfigError, InputError

if TYPE_CHECKING:
    from gesture_core.archive.discovery import Input

_PATH_COLUMNS = ("path", "input", "file", "video")


def printable(text: str) -> str:
    """``text`` with bytes that are no UTF-8 written as ``\\xNN``, fit for SQLite and JSON."""
    return os.fsencode(text).decode("utf-8", "backslashreplace") if os.name == "posix" else text


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
                lines = [line.rstrip("\r\n") for line in file]
                entries = [line for line in lines if line.strip() and not line.startswith("#")]
                return [(path.parent / entry, None) for entry in entries]
            rows = csv.DictReader(file)
            column = next((c for c in _PATH_COLUMNS if c in (rows.fieldnames or ())), None)
            if column is None:
                return None
            return [(path.parent / row[column], row.get("label") or None) for row in rows if row[column]]
    except (OSError, csv.Error) as error:
        raise InputError(
            f"not a manifest: {error}", subject=printable(os.fspath(path)), code="E_MANIFEST"
        ) from None


def label_inputs(items: Sequence[Input], labels: str, roots: Sequence[str | os.PathLike[str]]) -> list[Input]:
    """Give each input its label.

    Parameters
    ----------
    items : sequence of Input
    labels : str
        ``folder``: the first folder below its root. A path to a ``.csv`` file with the columns
        ``path`` and ``label``. Otherwise a regular expression whose group ``label``, or first
        group, is found by `search_name`.
    roots : sequence of path
        The sources that the inputs were found in.

    Raises
    ------
    ConfigError
        Where the expression is wrong, or an input gets no label; a label from a manifest is kept.
        What is broken or nobody's may do without one: it cannot be used in any case.
    """
    find = _labeller(labels, [Path(root) for root in roots])
    labelled = []
    for item in items:
        label = printable(item.label or find(item) or "")
        if not label and item.kind not in ("broken", "other"):
            raise ConfigError(
                f"no label for {item.name} by {labels!r}",
                remedy=_remedy(item, labels),
                code="E_LABELS",
            )
        labelled.append(replace(item, label=label or None))
    return labelled


def search_name(pattern: re.Pattern[str], item: Input) -> re.Match[str] | None:
    """Where ``pattern`` is found: in the name of the file, or of the sequence in a file of several.

    The folders above are searched only by an expression with a ``/`` (or, for the file of a
    sequence, ``::``): what misses the name must not be answered by whatever the path happens to hold.
    """
    if "/" in pattern.pattern or "::" in pattern.pattern:
        return pattern.search(item.name.replace(os.sep, "/"))
    return pattern.search(item.member or item.path.name)


def _remedy(item: Input, labels: str) -> str:
    if labels == "folder" and item.kind == "keypoints" and item.path.is_dir():
        return f"a folder for each clip, such as {item.name}/1/*_keypoints.json"
    return (
        "examples/<label>/<clip>, a CSV file with path and label, or a regular expression "
        "(one with a / is searched in the whole path)"
    )


def _labeller(labels: str, roots: Sequence[Path]) -> Callable[[Input], str | None]:
    if labels == "folder":
        return lambda item: _folder_label(item.path, roots)
    if labels.lower().endswith(".csv"):
        entries = read_manifest(Path(labels)) if Path(labels).is_file() else None
        if entries is None:
            there = Path(labels).is_file()
            raise ConfigError(
                "is no table with the columns path and label" if there else "no such file",
                subject=labels,
                remedy="its first line: path,label" if there else "check the path",
                code="E_LABELS",
            )
        table = {path.resolve(): label for path, label in entries}
        return lambda item: table.get(item.path.resolve())
    try:
        pattern = re.compile(labels)
    except re.error as error:
        raise ConfigError(f"labels {labels!r} is no regular expression: {error}", code="E_LABELS") from None
    if not pattern.groups:
        raise ConfigError(
            f"labels {labels!r} has no group",
            remedy="folder, a CSV file, or an expression such as '^(?P<label>[a-z]+)_'",
            code="E_LABELS",
        )

    def search(item: Input) -> str | None:
        match = search_name(pattern, item)
        return match.groupdict().get("label") or match.group(1) if match else None

    return search


def _folder_label(path: Path, roots: Sequence[Path]) -> str | None:
    for root in roots:
        if path.is_relative_to(root):
            parts = path.relative_to(root).parts
            if len(parts) > 1:
                return printable(parts[0])
    return None
