"""The labels of examples: from folders, tables, or regular expressions."""

from __future__ import annotations

import glob
import os
import re
import unicodedata
import warnings
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from gesture_core.errors import ConfigError
from gesture_core.files import passed_over, printable
from gesture_core.run.addresses import local_path
from gesture_core.run.inputs import Input
from gesture_core.run.results import DATABASE

TABLES = (".csv", ".tsv", ".txt")
"""What the name of a table ends in."""
_REMEDY = (
    "examples/<label>/<clip>, a CSV file with path and label, or a regular expression "
    "(one with a / is searched in the whole path)"
)
LEVEL = re.compile(r"folder(?::(-?\d+))?")
"""``folder``, or ``folder:`` and a level."""
# Folders that are parts of a data set.
_PARTS = frozenset(
    "train training trn val valid validation dev eval evaluation test testing tst holdout".split()
)
# What people are called in front of their number.
_PEOPLE = frozenset(
    "s sub subj subject p person people u user a actor participant signer performer id".split()
)
_NUMBER = re.compile(r"[\d\W_]+")
# Of the folders that lie in any of the folders above, each of these holds this share on average: the same.
_ALIKE = 0.5
_SHOWN, _DAY = 4, 6  # and the digits of a day
Folders = tuple[str, ...]


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
        ``folder``, or ``folder:`` and a level, see `FolderLabels`. A path to a table of paths
        and labels (``.csv``, ``.tsv``, ``.txt``), see `tables.LabelTable`. Otherwise a regular
        expression whose group ``label``, or first group, is found by `search_name`.
    roots : sequence of path or address
        The sources that the inputs were found in.
    columns : str
        The headings of a table, as in `tables.read_labels`.

    Raises
    ------
    ConfigError
        Where the expression is wrong, the folders look like another layout, or an input gets no label; a
        label from a manifest is kept. What is broken or nobody's may do without one: it cannot be used in any
        case.
    """
    find = _source_of(items, labels, [*map(local_path, map(str, roots))], columns)
    labelled = []
    for item in items:
        label = word(item.label or find(item) or "")
        if not label and item.readable:
            fault, remedy = find.refusal(item)
            cause = f"no label for {item.name} by {labels!r}" + (f": {fault}" if fault else "")
            raise ConfigError(cause, remedy=remedy, code="E_LABELS")
        labelled.append(replace(item, label=label or None))
    _warn_of_two_kinds(labelled)
    return labelled


def _warn_of_two_kinds(items: Sequence[Input]) -> None:
    """Say where a video and its own keypoints are two clips, which find each other."""
    videos = {item.path.with_suffix(""): item for item in items if item.kind == "video"}
    keypoints = [item for item in items if item.kind == "keypoints"]
    both = [(videos[stem], item) for item in keypoints if (stem := item.path.with_suffix("")) in videos]
    if both:
        count = f"{len(both)} clips are" if both[1:] else "one clip is"
        names = " and ".join(item.name for item in both[0])
        warnings.warn(f"{count} there as a video and as keypoints, and count twice: {names}", stacklevel=3)


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
    if labels.lower().endswith(".csv") or (
        labels.lower().endswith(TABLES) and ("(" not in labels or Path(labels).is_file())
    ):
        from gesture_core.run.tables import LabelTable

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
    if not pattern.groups and Path(labels).exists():
        raise ConfigError(
            f"labels {labels!r} is a {'folder' if Path(labels).is_dir() else 'file'}, and no table of text",
            remedy="a table saved as CSV (UTF-8): path,label",
            code="E_LABELS",
        )
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


class FolderLabels:
    """The label of an input, by a folder that it lies in.

    Parameters
    ----------
    level : int or None
        None for the first folder below the root, or where the roots themselves are folders of clips side by
        side, as a pattern such as ``examples/*`` gives them, the root. N for the N-th folder below the root,
        from 0; -1 for the one that holds the clip, -2 for the one above.
    items : sequence of Input
    roots : sequence of path
        The sources that the items were found in.

    Raises
    ------
    ConfigError
        ``E_LABELS`` for no level where another one than the first looks like the label.
    """

    def __init__(
        self, level: int | None, items: Sequence[Input], roots: Sequence[str | os.PathLike[str]]
    ) -> None:
        self._level = level
        self._roots = _folders(roots)
        self._are_roots = self._level is None and _are_labels(items, self._roots)
        if self._are_roots:
            self._check_roots()
        elif self._level is None:
            self._check([item for item in items if item.readable])

    def __call__(self, item: Input) -> str | None:
        if self._level is not None and self._level < 0:
            above = item.path.absolute().parts[:-1]
            return printable(above[self._level]) if len(above) > -self._level else None
        root, below = _place(item, self._roots)
        if root is None:
            return None
        if self._are_roots:
            return printable(root.name)
        level = self._level or 0
        return printable(below[level]) if len(below) > level else None

    def refusal(self, item: Input) -> tuple[str, str]:
        """Why ``item`` has no label, and what helps."""
        root, below = _place(item, self._roots)
        if root is None:
            fault = "no folder was named that it lies in"
        else:
            fault = f"it lies in no folder below {printable(root)}"
            fault += f" with number {self._level}" if self._level else ""
        if item.address and not below:
            return "it lies in no folder below the address", "an address with a folder for each label"
        if item.kind == "keypoints" and item.path.is_dir():
            return fault, f"a folder for each clip, such as {item.name}/1/*_keypoints.json"
        if root is not None and not below:
            name, parent = printable(root.name), printable(root.parent)
            return fault, f"the folder above, {parent}, if {name} is the label, or --labels folder:-1"
        return (
            fault,
            "--labels folder:-1 for the folder that holds each clip, a table, or a regular expression",
        )

    def _check_roots(self) -> None:
        """Refuse sources side by side that are parts of a data set, or people."""
        names = {root.name for root in self._roots}
        parts = _are_parts(names)
        if parts or _numbered([(name,) for name in names], 0) in _PEOPLE:
            raise ConfigError(
                f"{_listed(names)} look like {'parts of a data set' if parts else 'people'}, not labels",
                remedy="--labels with a table or a regular expression, or --labels folder:-1 if "
                f"{_listed(names)} are the labels",
                code="E_LABELS",
            )

    def _check(self, items: Sequence[Input]) -> None:
        """Refuse labels that are parts of a data set, or people who perform."""
        full = [below for item in items if (below := _place(item, self._roots)[1])]
        if not full:
            return
        top = {folders[0] for folders in full}
        # A folder that everything lies in (data/v1/clips) says nothing, wherever it stands.
        levels = [n for n in range(min(map(len, full))) if len({folders[n] for folders in full}) > 1]
        tree = [tuple(folders[n] for n in levels) for folders in full]
        first = 0 if len(top) == 1 else 1
        parts = _are_parts(top)
        alone = len(top) == 1 and bool(levels) and _numbered(tree, 0) is None
        if not parts and not alone and not (levels[1:] and _repeats(tree, 0)):
            _warn_of_levels(full)
            return
        kind = "parts of a data set" if parts else "people, places or days"
        what = f"{_listed(top)} look like {kind}, not labels"
        if len(top) == 1:
            what = f"everything lies in {_listed(top)}, which looks like no label"
        anyway = f"--labels folder:0 if {_listed(top)} are the labels"
        names = [{folders[place] for folders in tree} for place in range(len(levels))]
        others = [_are_parts(name) or _numbered(tree, n) is not None for n, name in enumerate(names)]
        likely = first
        while likely + 1 < len(levels) and (others[likely] or _repeats(tree, likely)):
            likely += 1
        if likely >= len(levels):
            raise ConfigError(
                what, remedy=f"--labels with a table or a regular expression, or {anyway}", code="E_LABELS"
            )
        remedies = []
        for place in sorted(range(first, len(levels)), key=lambda n: n != likely):
            last = {len(folders) for folders in full} == {levels[place] + 1}
            level = -1 if last else levels[place]
            if place == likely or not others[place]:
                remedies.append(f"--labels folder:{level} for {_listed(names[place])}")
        where = "it" if len(top) == 1 else "each of them"
        raise ConfigError(
            f"{what}; below {where} lie folders such as {_listed(names[likely])}",
            remedy="; ".join([*remedies, anyway]),
            code="E_LABELS",
        )


def label_folders(items: Sequence[Input], roots: Sequence[str | os.PathLike[str]], avoid: Path) -> set[str]:
    """Names of the folders that stand for labels, whatever is in them, where ``--labels`` is ``folder``.

    Hidden ones, ``avoid`` and other run folders stand for none.
    """
    folders = _folders(roots)
    if _are_labels(items, folders):
        return {folder.name for folder in folders}
    found: set[str] = set()
    for root in folders:
        with suppress(OSError):  # what cannot be listed has been said by then
            for folder in root.iterdir():
                own = (folder / DATABASE).exists() or folder.resolve() == avoid.resolve()
                if folder.is_dir() and not own and not passed_over(folder.name):
                    found.add(folder.name)
    return found


def _folders(roots: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """The folders among the sources, those of patterns included, and those of what is not fetched yet."""
    found = []
    for root in roots:
        text = os.fspath(root)
        some = [text] if Path(text).exists() else sorted(glob.glob(text, recursive=True)) or [text]  # noqa: PTH207
        found += [Path(one) for one in some if not Path(one).is_file()]
    return found


def _are_labels(items: Sequence[Input], roots: Sequence[Path]) -> bool:
    """Whether the roots are folders of clips side by side."""
    if len(roots) < 2 or len({root.absolute().parent for root in roots}) > 1:
        return False
    clips = [item for item in items if item.readable]
    files = {root / root.name for root in roots}  # an address of one file, which lies in a folder of its name
    return bool(clips) and all(item.path.parent in roots and item.path not in files for item in clips)


def _place(item: Input, roots: Sequence[Path]) -> tuple[Path | None, Folders]:
    """The root that an input lies in, and the folders between."""
    for root in roots:
        if item.path != root and item.path.is_relative_to(root):
            return root, item.path.relative_to(root).parts[:-1]
    return None, ()


def _are_parts(names: Iterable[str]) -> bool:
    return all(_NUMBER.sub("", name).casefold() in _PARTS for name in names)


def _numbered(tree: Sequence[Folders], level: int) -> str | None:
    """What all folders of a level are called in front of their number (people, cameras, days), else None."""
    names = {folders[level] for folders in tree if len(folders) > level}
    stems = {_NUMBER.sub("", name).casefold() for name in names}
    alike = len(stems) == 1 and all(any(letter.isdigit() for letter in name) for name in names)
    return stems.pop() if alike else None


def _warn_of_levels(tree: Sequence[Folders]) -> None:
    """Say where some labels hold clips, and others nothing but folders that may be labels as well."""
    plain = {folders[0] for folders in tree if len(folders) == 1}
    for name in {folders[0] for folders in tree} - plain if plain else ():
        below = [folders for folders in tree if folders[0] == name]
        levels = range(1, min(map(len, below)))
        level = next((n for n in levels if len({folders[n] for folders in below}) > 1), None)
        if level is not None and _numbered(below, level) is None:
            inside = _listed({folders[level] for folders in below})
            text = f"{printable(name)} holds the folders {inside}, where other labels hold clips: "
            warnings.warn(f"{text}if these are labels, --labels folder:-1", stacklevel=5)


def _repeats(tree: Sequence[Folders], level: int) -> bool:
    """Whether the folders of a level hold the same ones, not just numbered, or are people or days."""
    inside: dict[Folders, set[str]] = {}
    for folders in tree:
        inside.setdefault(folders[: level + 1], set()).add(folders[level + 1])
    every = set().union(*inside.values())
    shares = [len(names) / len(every) for names in inside.values()]
    alike = len(every) > 1 and sum(shares) / len(shares) >= _ALIKE
    here, below = _numbered(tree, level), _numbered(tree, level + 1)
    days = here == "" and all(sum(map(str.isdigit, place[-1])) >= _DAY for place in inside)
    if len(every) > 1 and below is None and (days or here in _PEOPLE):
        return True
    return alike and (below is None or (here is not None and (here in _PEOPLE or below not in _PEOPLE)))


def _listed(names: Iterable[str]) -> str:
    ordered = sorted(printable(name) for name in names)
    return ", ".join(ordered[:_SHOWN]) + (", …" if ordered[_SHOWN:] else "")
