"""Keypoints in CSV: bare rows of coordinates, or a table with named columns."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import SKELETONS, Skeleton, skeleton_of
from gesture_core.types import PoseSequence
from gesture_pose_files.files import (
    MAX_CSV_BYTES,
    MAX_FRAMES,
    check_people,
    head_of,
    open_keypoints,
)
from gesture_pose_files.layout import check_seconds, flat_widths, sequence

_HEAD_BYTES = 1 << 14
_MAX_LINE = 1 << 16
_SUFFIXES = (".csv", ".tsv")
_PARTS = ("_x", "_y", "_score")
_MIN_JOINTS = 2
_SHOWN = 100


@dataclass(frozen=True)
class CsvReader:
    """Reads keypoint tables.

    - Without a header: one row a frame, 2, 3 or 4 values for each of 15, 17, 18, 25 or 33 joints; 36
      columns are x, y in OpenPose's COCO order. Rows of zeros are frames in which nobody was found.
    - With a header: ``time`` (seconds) or ``frame``, perhaps ``person``, then ``<joint>_x``,
      ``<joint>_y`` and perhaps ``<joint>_score`` with the joint names of `gesture_core.skeletons`; empty
      cells are missing joints.

    Attributes
    ----------
    options : ReadOptions
        What tables leave open; a header names the joints, and which column is x.
    people : "single" or "multi"
        Of a table with the column ``person``: the person whose scores sum to the most, or everybody.
    """

    options: ReadOptions = field(default_factory=ReadOptions)
    people: str = "single"

    def __post_init__(self) -> None:
        check_people(self.people)

    def accepts(self, path: Path) -> bool:
        """Whether the first line of a ``.csv`` or ``.tsv`` is a row of keypoints or names them."""
        if path.suffix.lower() not in _SUFFIXES:
            return False
        lines = head_of(path, _HEAD_BYTES).decode("utf-8-sig", "replace").splitlines()
        if not lines:
            return False
        cells = _cells(lines[0], _delimiter(lines[0]))
        return _is_bare(cells, self.options) or _columns(cells) is not None

    def refusal(self, path: Path) -> str:
        """The header, which names no joints."""
        lines = head_of(path, _HEAD_BYTES).decode("utf-8-sig", "replace").splitlines()
        header = next((line for line in lines if line.strip()), "")
        if not header:
            return "it is empty"
        shown = printable(header[:_SHOWN]) + ("…" if len(header) > _SHOWN else "")
        return f"its header {shown!r} names no joints, and is no row of keypoints"

    def members(self, path: Path) -> list[str]:
        """``[""]``: a table is one sequence."""
        return [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The people in the table.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_FORMAT` for a CSV file that is no keypoint table, `E_KEYPOINTS_VALUE`,
            `E_KEYPOINTS_TIMES`, `E_KEYPOINTS_LIMIT`, and those of `files.open_keypoints`.
        """
        source = printable(path)
        if member:
            raise KeypointError(f"has no member {member!r}", subject=source, code="E_KEYPOINTS_MEMBER")
        with open_keypoints(path, MAX_CSV_BYTES) as file:
            rows = _rows(file, source)
            first = next(rows, None)
            if first is None:
                raise KeypointError("holds no row", subject=source, code="E_KEYPOINTS_EMPTY")
            if _is_bare(first, self.options):
                table = _numbers([first], rows, len(first), source)
                return [sequence(table, self.options, source=source, reader="csv")]
            columns = _columns(first)
            if columns is None:
                raise KeypointError(
                    "is no keypoint table: its first line is neither a row of keypoints nor names joints",
                    subject=source,
                    remedy="columns time, nose_x, nose_y, … or rows of x, y in COCO order",
                    code="E_KEYPOINTS_FORMAT",
                )
            table = _numbers([], rows, len(first), source)
        return self._named(table, columns, source)

    def _named(self, table: np.ndarray, columns: _Columns, source: str) -> list[PoseSequence]:
        if len(table) == 0:
            raise KeypointError("holds a header and no row", subject=source, code="E_KEYPOINTS_EMPTY")
        if np.isinf(table).any():
            raise KeypointError("holds an infinite value", subject=source, code="E_KEYPOINTS_VALUE")
        if columns.time is not None:
            check_seconds(table[:, columns.time], source)
        if columns.person is None:
            groups = [table]
        else:
            numbers = table[:, columns.person]
            groups = [table[numbers == number] for number in np.unique(numbers[~np.isnan(numbers)])]
            if not groups:
                raise KeypointError("names no person", subject=source, code="E_KEYPOINTS_VALUE")
        found = [columns.sequence(group, self.options, source, index) for index, group in enumerate(groups)]
        if self.people == "multi":
            return found
        return [replace(max(found, key=lambda one: float(one.scores.sum())), person=0)]


@dataclass(frozen=True)
class _Columns:
    """Where a header puts what."""

    skeleton: Skeleton
    x: tuple[int | None, ...]
    y: tuple[int | None, ...]
    score: tuple[int | None, ...]
    time: int | None
    frame: int | None
    person: int | None

    def sequence(self, table: np.ndarray, options: ReadOptions, source: str, person: int) -> PoseSequence:
        points = np.stack([_take(table, self.x), _take(table, self.y)], axis=2)
        scores = None
        if any(column is not None for column in self.score):
            scores = _take(table, self.score)
            # A joint that has coordinates and no score is taken to be certain.
            scores = np.where(np.isnan(scores) & ~np.isnan(points).any(axis=2), 1.0, scores)
        return sequence(
            points,
            options,
            source=source,
            reader="csv",
            scores=scores,
            times=table[:, self.time] if self.time is not None else None,
            numbers=table[:, self.frame] if self.frame is not None else None,
            body=self.skeleton,
            axes="xy",
            person=person,
        )


def _take(table: np.ndarray, columns: Sequence[int | None]) -> np.ndarray:
    out = np.full((len(table), len(columns)), np.nan)
    for index, column in enumerate(columns):
        if column is not None:
            out[:, index] = table[:, column]
    return out


def _columns(cells: Sequence[str]) -> _Columns | None:
    """The columns that a header names; None where it names no skeleton's joints."""
    names = [cell.strip().lower() for cell in cells]
    if len(set(names)) != len(names):
        return None
    where = {name: index for index, name in enumerate(names)}
    joints = [name[:-2] for name in names if name.endswith("_x") and name[:-2] + "_y" in where]
    if len(joints) < _MIN_JOINTS:
        return None
    if not set(joints) <= {joint for kind in SKELETONS.values() for joint in kind.joints}:
        return None
    body = skeleton_of(joints)
    x, y, score = (tuple(where.get(joint + part) for joint in body.joints) for part in _PARTS)
    return _Columns(body, x, y, score, where.get("time"), where.get("frame"), where.get("person"))


def _is_bare(cells: Sequence[str], options: ReadOptions) -> bool:
    return len(cells) in flat_widths(options) and all(_is_number(cell) for cell in cells)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _delimiter(line: str) -> str:
    return max(",;\t", key=line.count)


def _cells(line: str, mark: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=mark), [])
    except csv.Error:
        return []


def _rows(file: IO[bytes], source: str) -> Iterator[list[str]]:
    """The cells of each line that is not blank; memory holds one line at a time."""
    mark = ""
    for number in range(1, MAX_FRAMES * 64):
        line = file.readline(_MAX_LINE + 1)
        if not line:
            return
        if len(line) > _MAX_LINE:
            raise KeypointError(
                f"line {number} is longer than {_MAX_LINE} bytes", subject=source, code="E_KEYPOINTS_LIMIT"
            )
        try:
            text = line.decode("utf-8-sig" if number == 1 else "utf-8").strip("\r\n")
        except UnicodeDecodeError:
            raise KeypointError(
                f"line {number} is no UTF-8 text", subject=source, code="E_KEYPOINTS_FORMAT"
            ) from None
        if text.strip():
            mark = mark or _delimiter(text)
            yield _cells(text, mark)


def _numbers(rows: list[list[str]], more: Iterator[list[str]], width: int, source: str) -> np.ndarray:
    """(T, width) float64 of all rows; empty cells are NaN."""
    table: list[np.ndarray] = []
    for chunk in (rows, more):
        for cells in chunk:
            if len(table) >= MAX_FRAMES:
                raise KeypointError(
                    f"holds more than {MAX_FRAMES} rows",
                    subject=source,
                    remedy="split it",
                    code="E_KEYPOINTS_LIMIT",
                )
            if len(cells) != width:
                raise KeypointError(
                    f"row {len(table) + 1} has {len(cells)} cells, the first line has {width}",
                    subject=source,
                    code="E_KEYPOINTS_FORMAT",
                )
            try:
                values = [float(cell) if cell.strip() else np.nan for cell in cells]
            except ValueError as error:
                raise KeypointError(
                    f"row {len(table) + 1}: {error}", subject=source, code="E_KEYPOINTS_FORMAT"
                ) from None
            table.append(np.array(values))
    return np.stack(table) if table else np.zeros((0, width))
