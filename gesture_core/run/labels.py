"""The labels of examples: from folders, tables, or regular expressions."""

from __future__ import annotations

import difflib
import os
import re
import unicodedata
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from gesture_core.errors import ConfigError, InputError
from gesture_core.files import printable
from gesture_core.run.inputs import NO_TEXT, SAVE_AS_TEXT, Input, lacking, read_manifest
from gesture_core.run.results import DATABASE


class _Table:
    """Labels by path, from a CSV file with the columns ``path`` and ``label``."""

    def __init__(self, path: Path) -> None:
        self._folder = path.parent
        entries = read_manifest(path) if path.is_file() else None
        if entries is None or not any(label for _, label in entries):
            cause = lacking(path) if path.is_file() else "no such file"
            remedy = "its first line: path,label" if path.is_file() else "check the path"
            remedy = SAVE_AS_TEXT if cause == NO_TEXT else remedy
            raise ConfigError(cause, subject=str(path), remedy=remedy, code="E_LABELS")
        self._labels: dict[str, str | None] = {}
        for entry, label in entries:
            spelled = _spelling(entry.resolve())
            known = self._labels.get(spelled)
            if known and label and known != label:
                raise InputError(
                    f"is listed as {known} and as {label}",
                    subject=printable(os.fspath(entry)),
                    remedy=f"one line for it in {path}",
                    code="E_CONTRADICTION",
                )
            self._labels[spelled] = known or label

    def __call__(self, item: Input) -> str | None:
        return self._labels.get(_spelling(item.path.resolve()))

    def fault(self, item: Input) -> str:
        """Why ``item`` has no label."""
        name = _spelling(item.path.resolve())
        if name in self._labels:
            return "its line there has no label"
        folder = _spelling(self._folder.resolve())
        listed = [os.path.relpath(path, folder) for path in self._labels]
        near = difflib.get_close_matches(os.path.relpath(name, folder), listed, 1, 0.8)
        return "it has no line for it" + (f", {printable(near[0])!r} is near" if near else "")


def _spelling(path: Path) -> str:
    """A path with its accents in one form: some systems take letters and accents apart, others do not."""
    return unicodedata.normalize("NFC", os.fspath(path))


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
        label = _word(item.label or find(item) or "")
        if not label and item.kind not in ("broken", "other"):
            raise ConfigError(
                f"no label for {item.name} by {labels!r}{_fault(item, find, labels, roots)}",
                remedy=_remedy(item, labels),
                code="E_LABELS",
            )
        labelled.append(replace(item, label=label or None))
    return labelled


def label_folders(roots: Sequence[str | os.PathLike[str]], avoid: Path) -> set[str]:
    """The labels that folders directly below ``roots`` stand for, whatever is in them.

    Hidden ones, ``avoid`` and other run folders stand for none.
    """
    found: set[str] = set()
    for root in (path for path in map(Path, roots) if path.is_dir()):
        with suppress(OSError):  # what cannot be listed has been said by then
            for folder in root.iterdir():
                own = (folder / DATABASE).exists() or folder.resolve() == avoid.resolve()
                if folder.is_dir() and not own and not folder.name.startswith("."):
                    found.add(_word(folder.name))
    return found


def search_name(pattern: re.Pattern[str], item: Input) -> re.Match[str] | None:
    """Where ``pattern`` is found: in the name of the file, or of the sequence in a file of several.

    The folders above are searched only by an expression with a ``/`` (or, for the file of a
    sequence, ``::``): what misses the name must not be answered by whatever the path happens to hold.
    """
    if "/" in pattern.pattern or "::" in pattern.pattern:
        return pattern.search(item.name.replace(os.sep, "/"))
    return pattern.search(item.member or item.path.name)


def _word(label: str) -> str:
    """``label`` without spaces around it and with its accents in one form, fit for SQLite and JSON."""
    return printable(unicodedata.normalize("NFC", label.strip()))


def _fault(
    item: Input, find: Callable[[Input], str | None], labels: str, roots: Sequence[str | os.PathLike[str]]
) -> str:
    """Why there is no label, where more can be said than by whom."""
    if isinstance(find, _Table):
        return f": {find.fault(item)}"
    if labels == "folder":
        root = next((r for r in map(Path, roots) if item.path.is_relative_to(r)), None)
        return f": it lies in no folder below {printable(os.fspath(root))}" if root else ""
    return ""


def _remedy(item: Input, labels: str) -> str:
    if labels == "folder" and item.kind == "keypoints" and item.path.is_dir():
        return f"a folder for each clip, such as {item.name}/1/*_keypoints.json"
    if labels.lower().endswith(".csv"):
        return "a line for it, its path as seen from the folder of the table"
    return (
        "examples/<label>/<clip>, a CSV file with path and label, or a regular expression "
        "(one with a / is searched in the whole path)"
    )


def _labeller(labels: str, roots: Sequence[Path]) -> Callable[[Input], str | None]:
    if labels == "folder":
        return lambda item: _folder_label(item.path, roots)
    if labels.lower().endswith(".csv"):
        return _Table(Path(labels))
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
        if match is None:
            return None
        label: str | None = match.groupdict().get("label") or match.group(1)
        if label and halves_a_word(match, "label"):
            raise ConfigError(
                f"labels {labels!r} finds {label!r} inside a word of {item.name}",
                remedy="an expression for letters with accents too, such as '^(?P<label>.+?)_'",
                code="E_LABELS",
            )
        return label

    return search


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


def _folder_label(path: Path, roots: Sequence[Path]) -> str | None:
    for root in roots:
        if path.is_relative_to(root):
            parts = path.relative_to(root).parts
            if len(parts) > 1:
                return printable(parts[0])
    return None
