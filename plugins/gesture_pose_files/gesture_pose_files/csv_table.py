"""Keypoints in CSV: bare rows of coordinates, tables with named columns, or with a row for each joint."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import partial
from io import BytesIO
from itertools import chain, islice
from pathlib import Path
from typing import IO, ClassVar, NamedTuple

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.joint_names import joint_named
from gesture_core.types import PoseSequence
from gesture_pose_files.columns import Columns, body_of_rows, columns_of, missing_note, unused_note
from gesture_pose_files.deeplabcut import is_deeplabcut
from gesture_pose_files.files import MAX_CSV_BYTES, MAX_FRAMES, head_of, open_keypoints, suffix_of
from gesture_pose_files.layout import flat_widths, sequence
from gesture_pose_files.ordering import (
    Rows,
    by_index,
    by_joint,
    by_person,
    following,
    frame_numbers,
    in_order,
)
from gesture_pose_files.people import left_out, tracks
from gesture_pose_files.reader import OneClipReader, with_lost
from gesture_pose_files.table import (
    MAX_LINE,
    SUFFIXES,
    cells_of,
    lines_above,
    number_in,
    numbers_of,
    refuse_thousands,
    rows_of,
    separator,
    split_header,
)

_HEAD_BYTES = MAX_LINE
_MAX_JOINT_ROWS = 8 * MAX_FRAMES
_SHOWN = 100
_MOST_LEADING = 2
_FEWEST_ROWS = 3
_CALENDAR = 1e8
"""Seconds from which on a time is one of a calendar: three years."""
_LOOKED_AT = 60
_WIDE = 20
"""Cells of a line above a table that may be a row of joints itself."""
_Person = tuple[np.ndarray, np.ndarray | None, Rows, list[str]]


class _Opened(NamedTuple):
    """The names of the columns, the rows below, what the names are, the index of bare rows, notes."""

    names: list[str] | None
    rows: Iterator[list[str]]
    columns: Columns | None
    numbers: list[str]
    notes: list[str]


class CsvReader(OneClipReader):
    """Reads keypoint tables, separated by commas, semicolons, tabs, bars or spaces.

    - Without names: one row a frame, 2, 3 or 4 values for each joint; 36 columns are x, y in OpenPose's
      COCO order. Rows of zeros are frames in which nobody was found.
    - With names: two columns or more for each joint, such as ``nose_x``, ``nose_y``, ``nose_score``; or a
      column that names the joint of each row, with ``x`` and ``y``. Perhaps columns for the time in
      seconds or the frame, and for the person. What else there is, is named in a note.
    """

    name: ClassVar[str] = "csv"

    def accepts(self, path: Path) -> bool:
        """Whether a table or text begins with a row of keypoints, or with names of joints."""
        if suffix_of(path) not in SUFFIXES:
            return False
        head = head_of(path, _HEAD_BYTES)
        if is_deeplabcut(head):
            return False  # it has a reader of its own
        if len(head) == _HEAD_BYTES:
            head = head[: head.rfind(b"\n") + 1] or head
        try:
            opened = self._opened(BytesIO(head), head, printable(path))
            if opened.names:
                return opened.columns is not None
            if suffix_of(path) == ".txt":  # which may hold anything
                return self._is_bare(list(islice(opened.rows, _FEWEST_ROWS)))
            return bool(self._ends(next(opened.rows, [])))
        except KeypointError as error:
            return error.code == "E_KEYPOINTS_SKELETON"  # reading it says why

    def refusal(self, path: Path) -> str:
        """The header, which names no joints, or what is wrong with it."""
        head = head_of(path, _HEAD_BYTES)
        lines = head.decode("utf-8-sig", "replace").splitlines()
        header = next((line for line in lines if line.strip()), "")
        if not header:
            return "it is empty"
        if b"\0" in head:
            return "it is no UTF-8 text; save it as CSV in UTF-8"
        if b"\r" in head and b"\n" not in head:
            return "its lines end as old Macintoshes ended them; save it as CSV in UTF-8"
        if suffix_of(path) == ".txt" and not any(character.isdigit() for character in header):
            return ""
        try:
            self._opened(BytesIO(head), head, printable(path))
        except KeypointError as error:
            return f"{error.cause}; wanted are {error.remedy}" if error.remedy else error.cause
        named = [cell for cell in re.split(r"[,;\t|]", header) if joint_named(cell.strip(' "'))]
        if len(named) > 1:
            return (
                f"its header {_quoted(header)} names joints, and not what of them is in a column; "
                f"wanted is a column for each number: {named[0]}_x, {named[0]}_y"
            )
        return (
            f"its header {_quoted(header)} names no joints, and is no row of keypoints; wanted are columns "
            "nose_x, nose_y, …, or frame, joint, x, y, or a row of x and y for each frame"
        )

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The people in the table."""
        head = head_of(path, _HEAD_BYTES)
        with open_keypoints(path, MAX_CSV_BYTES) as file:
            opened = self._opened(file, head, source)
            first = next(opened.rows, None)
            if opened.names is None and first is None:
                raise KeypointError("holds no row", subject=source, code="E_KEYPOINTS_EMPTY")
            if opened.names is None:
                return self._bare(first or [], opened, source)
            if opened.columns is None:
                raise _no_table(opened.names, source)
            if first is None:
                raise KeypointError("holds a header and no row", subject=source, code="E_KEYPOINTS_EMPTY")
            return self._named(
                opened.names, opened.columns, chain([first], opened.rows), source, opened.notes
            )

    def _opened(self, file: IO[bytes], head: bytes, source: str) -> _Opened:
        """What a file is by its ``head``.

        R's tables name their columns, but not that of the numbers or names of the rows before them.
        """
        find = partial(columns_of, options=self.options, source=source)
        text = head.decode("utf-8-sig", "replace")
        lines = [line.strip("\r") for line in text.split("\n", _LOOKED_AT)[:_LOOKED_AT]]
        above = 0 if b"\0" in head else lines_above(lines)
        if max((len(cells_of(line, separator(lines[-1]))) for line in lines[:above]), default=0) >= _WIDE:
            above = 0  # rows of another table
        for _ in range(above):
            file.readline()
        index: list[str] = []
        names, rows = split_header(rows_of(file, source), find, index=index)
        first = list(islice(rows, 1))
        longer = len(first[0]) - len(names) if names and first else 0
        if names and longer == -1 and names[0].strip("# ") == "":  # a mark of its own before the names
            names = names[1:]
        elif names and longer == -1 and not names[-1].strip():
            names = names[:-1]
        elif names and longer == 1 and not first[0][-1].strip():
            names = [*names, ""]
        elif names and longer == 1 and number_in(first[0][0]) in (None, 0, 1):
            names = ["", *names]
        notes = [f"its first {above} lines are no table"] if above > 1 else ["its first line is no table"]
        return _Opened(
            names,
            chain(first, rows),
            find(names) if names else None,
            index,
            notes if above else [],
        )

    def _is_bare(self, rows: Sequence[list[str]]) -> bool:
        """Whether the first rows of a text are keypoints without names, and nothing else in numbers."""
        if not rows or not self._ends(rows[0]) or len({len(row) for row in rows}) > 1:
            return False
        numbers = [[number_in(cell) for cell in row] for row in rows]
        if any(value is None for row in numbers for value in row):
            return False
        return bool(self._ends(rows[0], [_leading(np.array(numbers, np.float64))]))

    def _ends(self, cells: Sequence[str], leading: Sequence[int] = range(_MOST_LEADING + 1)) -> list[int]:
        """Where keypoints may end in a row without names, after so many ``leading`` columns."""
        if any(number_in(cell) is None for cell in cells):
            return []
        ends = (len(cells), len(cells) - 1) if cells and not cells[-1].strip() else (len(cells),)
        widths = flat_widths(self.options)
        return [end for end in ends if any(end - start in widths for start in leading)]

    def _bare(self, first: list[str], opened: _Opened, source: str) -> list[PoseSequence]:
        if not self._ends(first):
            raise _no_table(first, source)
        width = len(first)
        cut: list[KeypointError] = []
        rows = _with_a_cut_end(chain([first], opened.rows), width, (0, 1), cut, source)
        table, _ = numbers_of(rows, width, range(width), (), MAX_FRAMES, source)
        refuse_thousands(table, source)
        indexed, order, notes = by_index([opened.numbers[: len(table)]] if opened.numbers else [], source)
        table = table if order is None else table[order]
        leading = _leading(table)
        ends = self._ends(first, [leading])
        if not ends:
            raise _no_table(first, source)
        points = table[:, leading : ends[0]]
        if flat_widths(self.options)[points.shape[1]][1] == 2:
            _refuse_labels(points, source)
        times = table[:, 1] if leading == 2 else indexed
        notes = [*opened.notes, *notes]
        found = sequence(points, self.options, source=source, reader=self.name, times=times, notes=notes)
        return [with_lost(found, cut)]

    def _named(
        self,
        names: list[str],
        columns: Columns,
        rows: Iterator[list[str]],
        source: str,
        notes: Sequence[str] = (),
    ) -> list[PoseSequence]:
        z = columns.z if self.options.depth else ()
        places = [*columns.x, *columns.y, *columns.score, *z, columns.time]
        wanted = sorted({place for place in places if place is not None})
        most = MAX_FRAMES if columns.joint is None else _MAX_JOINT_ROWS
        cut: list[KeypointError] = []
        rows = _with_a_cut_end(
            rows, len(names), (columns.time, columns.frame, columns.person, columns.joint), cut, source
        )
        table, texts = numbers_of(rows, len(names), wanted, names, most, source, columns.time)
        if np.isinf(table).any():
            raise KeypointError("holds an infinite value", subject=source, code="E_KEYPOINTS_VALUE")
        coordinates = [place for place in (*columns.x, *columns.y, *z) if place is not None]
        refuse_thousands(table[:, coordinates], source)
        rest = [column for column in range(len(names)) if column not in wanted]

        def text_of(column: int | None) -> list[str] | None:
            return None if column is None else [cells[rest.index(column)].strip() for cells in texts]

        clips = sorted({*(text_of(columns.clip) or [])} - {""})
        if 1 < len(clips) <= len(table) / _FEWEST_ROWS:
            raise KeypointError(
                f"holds {len(clips)} clips, as its column {names[columns.clip or 0].strip()[:40]!r} says",
                subject=source,
                remedy="one file for each clip",
                code="E_KEYPOINTS_FORMAT",
            )
        times = None if columns.time is None else table[:, columns.time] * columns.tick
        order = None
        if times is None and columns.frame is None and columns.joint is None:
            indices = [text_of(column) or [] for column in columns.index]
            times, order, own = by_index(indices, source, several=columns.person is not None)
            notes = [*notes, *own]
        if times is not None and len(times) and np.fmin.reduce(times) > _CALENDAR:  # the day says nothing
            times = times - np.nanmin(times)
        frames = text_of(columns.frame)
        every = Rows(
            np.stack([_take(table, c) for c in (columns.x, columns.y, columns.score, z) if c], axis=2),
            any(column is not None for column in columns.score),
            times,
            None if frames is None else frame_numbers(frames, source),
            np.arange(len(table)),
        )
        people = text_of(columns.person)
        if order is not None:
            every, people = every.take(order), people and [people[row] for row in order]
        groups, own = by_person(every, people, source)
        body, named = columns.body, columns.named
        if body is None:
            labels = text_of(columns.joint) or []
            body, where = body_of_rows(list(dict.fromkeys(labels)), self.options, source)
            named = not labels[0].isdigit()
            groups = [by_joint(one, labels, where, len(body.joints), source) for one in groups]
        if self.people == "single" and len(groups) > 1:
            groups, after = following(groups)
            own = [*own, *after]
        notes = [*notes, *unused_note(columns.unused), *missing_note(body if named else None), *own]
        found, names = [], []
        for one in groups:
            for points, scores, mine, own in self._people(one, len(body.joints), source):
                names.append(mine.name)
                found.append(
                    sequence(
                        points,
                        self.options,
                        source=source,
                        reader=self.name,
                        scores=scores,
                        depth=mine.depth,
                        times=mine.times,
                        numbers=mine.numbers,
                        clock=every.numbers if times is None else times,
                        body=body if named else None,
                        axes="xy",
                        unit=columns.unit if columns.unit == "metres" else None,
                        notes=[*notes, *own],
                    )
                )
        return [with_lost(one, cut) for one in self.best(found, source, names)]

    def _people(self, rows: Rows, joints: int, source: str) -> Iterator[_Person]:
        """One person, or several whom only their place tells apart."""
        rows, notes = in_order(rows, source)
        if not rows.several:
            yield rows.points, rows.scores, rows, notes
            return
        if rows.depth is not None:
            raise KeypointError(
                "has several people in a frame, and of people who are told apart by their place no z is kept",
                subject=source,
                remedy="a column person",
                code="E_KEYPOINTS_SHAPE",
            )
        frames, first = rows.frames()
        most = max(len(frame) for frame in frames)
        notes.append(f"up to {most} people in a frame told apart by their place, as no column does")
        notes += left_out(frames, self.people)
        for points, scores in tracks(frames, joints, self.people):
            yield points, scores, first, notes


def _with_a_cut_end(
    rows: Iterator[list[str]], width: int, needed: Sequence[int | None], cut: list[KeypointError], source: str
) -> Iterator[list[str]]:
    """The rows, the last one filled up where it is shorter: a recorder was stopped in the middle of it.

    Where it ends before the columns that are ``needed`` it stays as it is.
    """
    last: list[str] = []
    for count, row in enumerate(rows):
        if count:
            yield last
        last = row
        if count and len(row) < width and all(place is None or place < len(row) - 1 for place in needed):
            cause = f"row {count + 1} has {len(row)} cells, the first line has {width}"
            following = next(rows, None)
            if following is None:
                cut.append(KeypointError(cause, subject=source, code="E_KEYPOINTS_FORMAT"))
                last = [*row[:-1], *[""] * (width - len(row) + 1)]
            else:
                yield last
                last = following
    if last:
        yield last


def _leading(table: np.ndarray) -> int:
    """How many of the first columns count the rows, or tell times in even steps after one that does."""
    if len(table) < _FEWEST_ROWS or table[0, 0] not in (0, 1) or (np.diff(table[:, 0]) != 1).any():
        return 0
    steps = np.diff(table[:, 1])
    even = steps[0] > 0 and np.allclose(steps, steps[0], rtol=0.05, atol=0)
    return 2 if even and abs(table[0, 1]) <= steps[0] else 1


def _refuse_labels(points: np.ndarray, source: str) -> None:
    """Refuse x and y that are two numbers of a label: whole, always the same, and far from all joints."""
    pairs = points.reshape(len(points), -1, 2)
    for what, place in (("first", 0), ("last", -1)):
        pair, others = pairs[:, place], np.delete(pairs, place, axis=1)
        others = others[np.isfinite(others).all(axis=2) & others.any(axis=2)]
        same = len(pairs) >= _FEWEST_ROWS and (pair == pair[0]).all() and (pair == pair.round()).all()
        if same and pair[0].any() and len(others):
            low, high = others.min(axis=0), others.max(axis=0)
            if (np.maximum(low - pair[0], pair[0] - high) > (high - low) / 4).any():
                raise KeypointError(
                    f"its {what} two columns are {pair[0, 0]:g}, {pair[0, 1]:g} in every row, and no joint",
                    subject=source,
                    remedy="the columns of the joints alone, or a header that names them",
                    code="E_KEYPOINTS_FORMAT",
                )


def _no_table(cells: Sequence[str], source: str) -> KeypointError:
    return KeypointError(
        f"is no keypoint table: its header {_quoted(','.join(cells))} names no joints, "
        "and is no row of keypoints",
        subject=source,
        remedy="columns time, nose_x, nose_y, …; rows of x, y in COCO order; or --set keypoints.order=…",
        code="E_KEYPOINTS_FORMAT",
    )


def _quoted(line: str) -> str:
    return repr(printable(line[:_SHOWN]) + ("…" if len(line) > _SHOWN else ""))


def _take(table: np.ndarray, columns: Sequence[int | None]) -> np.ndarray:
    out = np.full((len(table), len(columns)), np.nan)
    for index, column in enumerate(columns):
        if column is not None:
            out[:, index] = table[:, column]
    return out
