"""Collections of labelled series: the UCR and UEA archives (Dau et al. 2018, Bagnall et al. 2018).

A file holds all examples, or all tests: ``.ts`` (sktime's format), ``.arff`` (Weka's, with a relational
attribute where there are several channels), and ``NAME_TRAIN.tsv`` with the label in the first column.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_pose_files.files import MAX_CSV_BYTES, MAX_MEMBERS, open_keypoints
from gesture_pose_files.table import number_in

_UCR = re.compile(r".*_(train|test)", re.IGNORECASE)
_RELATIONAL = re.compile(r"""(['"])(?P<rows>.*)\1\s*,(?P<label>.*)""", re.DOTALL)
_LONGEST = 64 << 20


@dataclass(frozen=True, eq=False)
class Series:
    """One of them: (T, D) values, NaN where missing, and its label."""

    values: np.ndarray
    label: str


def is_archive(path: Path) -> bool:
    """Whether ``path`` is a collection by its name."""
    suffix = path.suffix.lower()
    return suffix in (".ts", ".arff") or (suffix == ".tsv" and bool(_UCR.fullmatch(path.stem)))


def series_in(path: Path) -> dict[str, Series]:
    """All series of a file by ``label/number``, or number alone where there are no labels.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_FORMAT`, `E_KEYPOINTS_EMPTY`, `E_KEYPOINTS_LIMIT`.
    """
    source, suffix = printable(path), path.suffix.lower()
    found: list[Series] = []
    with open_keypoints(path, MAX_CSV_BYTES) as file:
        lines = _lines(file, source)
        labelled = suffix == ".tsv" or _header(lines, suffix, source)
        for number, line in lines:
            if len(found) == MAX_MEMBERS:
                cause = f"holds more than {MAX_MEMBERS} series"
                raise KeypointError(cause, subject=source, remedy="split it", code="E_KEYPOINTS_LIMIT")
            try:
                parse = {".ts": _ts, ".arff": _arff}.get(suffix, _tsv)
                found.append(parse(line, labelled=labelled))
            except ValueError as error:
                cause = f"line {number}: {error}"
                raise KeypointError(cause, subject=source, code="E_KEYPOINTS_FORMAT") from None
    if not found:
        raise KeypointError("holds no series", subject=source, code="E_KEYPOINTS_EMPTY")
    digits = len(str(len(found)))
    called = [f"{number:0{digits}}" for number in range(1, len(found) + 1)]
    return {
        f"{one.label}/{number}" if labelled else number: one
        for number, one in zip(called, found, strict=True)
    }


def _lines(file: IO[bytes], source: str) -> Iterator[tuple[int, str]]:
    """Lines that are neither blank nor comments, with their numbers."""
    number = 0
    while line := file.readline(_LONGEST + 1):
        number += 1
        if len(line) > _LONGEST:
            cause = f"line {number} is longer than {_LONGEST} bytes"
            raise KeypointError(cause, subject=source, code="E_KEYPOINTS_LIMIT")
        text = line.decode("utf-8", "replace").strip()
        if text and text[0] not in "#%":
            yield number, text


def _header(lines: Iterator[tuple[int, str]], suffix: str, source: str) -> bool:
    """Read up to the data; whether the series have labels."""
    labelled = suffix == ".arff"
    for _, line in lines:
        words = line.split()
        word = words[0].casefold()
        said = words[1].casefold() if len(words) > 1 else ""
        if not word.startswith("@"):
            break
        if word == "@data":
            return labelled
        if word in ("@timestamps", "@targetlabel") and said == "true":
            raise KeypointError(
                f"has {word[1:]}, which are not read", subject=source, remedy="a .csv file for each series",
                code="E_KEYPOINTS_FORMAT",
            )  # fmt: skip
        if word == "@classlabel":
            labelled = said == "true"
    raise KeypointError("has no line @data", subject=source, code="E_KEYPOINTS_FORMAT")


def _ts(line: str, *, labelled: bool) -> Series:
    *parts, last = line.split(":")
    channels = parts if labelled else [*parts, last]
    return Series(_stacked([_numbers(part) for part in channels]), last.strip() if labelled else "")


def _arff(line: str, *, labelled: bool) -> Series:
    relational = _RELATIONAL.fullmatch(line)
    if relational:
        rows = relational["rows"].replace("\\n", "\n").split("\n")
        return Series(_stacked([_numbers(row) for row in rows if row.strip()]), _word(relational["label"]))
    values, _, label = line.rpartition(",")
    return Series(_stacked([_numbers(values)]), _word(label))


def _tsv(line: str, *, labelled: bool) -> Series:
    label, *cells = line.split("\t")
    values = _numbers("\t".join(cells), "\t")
    there = np.flatnonzero(~np.isnan(values))  # shorter ones are filled up with NaN
    return Series(_stacked([values[: there[-1] + 1] if len(there) else values]), label.strip())


def _word(text: str) -> str:
    return text.strip().strip("'\"")


def _numbers(text: str, mark: str = ",") -> np.ndarray:
    cells = text.split(mark)
    values = [np.nan if cell.strip() == "?" else number_in(cell) for cell in cells]
    if bad := next((cell for cell, value in zip(cells, values, strict=True) if value is None), None):
        raise ValueError(f"{bad.strip()[:40]!r} is no number")
    return np.array(values, np.float64)


def _stacked(channels: list[np.ndarray]) -> np.ndarray:
    if len({len(channel) for channel in channels}) != 1 or not len(channels[0]):
        raise ValueError(f"its channels have {', '.join(str(len(one)) for one in channels[:5])} values")
    return np.stack(channels, axis=1)
