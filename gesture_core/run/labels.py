"""The labels of examples: from folders, tables, or regular expressions."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from gesture_core.errors import ConfigError
from gesture_core.files import printable
from gesture_core.run.inputs import Input
from gesture_core.run.label_folders import LEVEL, FolderLabels

TABLES = (".csv", ".tsv", ".txt")
"""What the name of a table ends in."""
_REMEDY = (
    "examples/<label>/<clip>, a CSV file with path and label, or a regular expression "
    "(one with a / is searched in the whole path)"
)


class Labels(Protocol):
    """Where labels come from: folders, a table, or names."""

    def __call__(self, item: Input) -> str | None:
        """The label of an input, if it has any."""

    def refusal(self, item: Input) -> tuple[str, str]:
        """Why an input has none, and what helps."""


def label_inputs(
    items: Sequence[Input], labels: str, roots: Sequence[str | os.PathLike[str]], columns: str = ""
) -> list[Input]:
    """Give each input its label.

    Parameters
    ----------
    items : sequence of Input
    labels : str
        ``folder``, or ``folder:`` and a level, see `label_folders.FolderLabels`. A path to a table of paths
        and labels (``.csv``, ``.tsv``, ``.txt``), see `label_tables.LabelTable`. Otherwise a regular
        expression whose group ``label``, or first group, is found by `search_name`.
    roots : sequence of path
        The sources that the inputs were found in.
    columns : str
        The headings of a table, as in `manifests.read_labels`.

    Raises
    ------
    ConfigError
        Where the expression is wrong, the folders look like another layout, or an input gets no label; a
        label from a manifest is kept. What is broken or nobody's may do without one: it cannot be used in any
        case.
    """
    find = _source_of(items, labels, roots, columns)
    labelled = []
    for item in items:
        label = word(item.label or find(item) or "")
        if not label and item.kind not in ("broken", "other"):
            fault, remedy = find.refusal(item)
            cause = f"no label for {item.name} by {labels!r}" + (f": {fault}" if fault else "")
            raise ConfigError(cause, remedy=remedy, code="E_LABELS")
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


def word(label: str) -> str:
    """``label`` without spaces around it and with its accents in one form, fit for SQLite and JSON."""
    return printable(unicodedata.normalize("NFC", label.strip()))


def _source_of(
    items: Sequence[Input], labels: str, roots: Sequence[str | os.PathLike[str]], columns: str
) -> Labels:
    if labels.lower().endswith(".csv") or (labels.lower().endswith(TABLES) and Path(labels).is_file()):
        from gesture_core.run.label_tables import LabelTable

        return LabelTable(Path(labels), columns, items)
    if columns:
        raise ConfigError(
            f"--label-columns {columns!r} without a table", remedy="--labels TABLE.csv", code="E_OPTION"
        )
    if level := LEVEL.fullmatch(labels):
        return FolderLabels(int(level[1]) if level[1] else None, items, roots)
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
    return NameLabels(pattern)


@dataclass(frozen=True)
class NameLabels:
    """Labels in the names of files, where a regular expression finds them."""

    pattern: re.Pattern[str]

    def __call__(self, item: Input) -> str | None:
        match = search_name(self.pattern, item)
        if match is None:
            return None
        label: str | None = match.groupdict().get("label") or match.group(1)
        if label and halves_a_word(match, "label"):
            raise ConfigError(
                f"labels {self.pattern.pattern!r} finds {label!r} inside a word of {item.name}",
                remedy="an expression for letters with accents too, such as '^(?P<label>.+?)_'",
                code="E_LABELS",
            )
        return label

    def refusal(self, item: Input) -> tuple[str, str]:
        """Why an input has no label, and what helps."""
        return "", _REMEDY


def halves_a_word(match: re.Match[str], group: str) -> bool:
    """Whether a letter with an accent ended what was found: ``[a-z]`` finds ``en`` in ``grüßen``.

    ``group`` is what was asked for, or the first one where there is no such group. Where the expression
    itself says what stands beside it, nothing was halved.
    """
    text = match.string
    start, end = match.span(group if match.groupdict().get(group) else 1)
    before = text[max(0, start - 1) : start] if start == match.start() else ""
    after = text[end : end + 1] if end == match.end() else ""
    return (text[start].isalpha() and _accented(before)) or (text[end - 1].isalpha() and _accented(after))


def _accented(letter: str) -> bool:
    """An accent, or a letter beyond ASCII of a writing with capitals: others put no spaces between words."""
    cased = letter.lower() != letter.upper()
    return not letter.isascii() and (cased or bool(unicodedata.combining(letter)))
