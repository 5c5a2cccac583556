"""Which rows of a table are of one person, and in which order: frame numbers may repeat or run backwards."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.joint_names import joint_named, words_of
from gesture_core.types import Person
from gesture_pose_files.people import near
from gesture_pose_files.table import number_in, seconds_in

# Rows of one time that lie further apart, in sizes of the body, are those of several people.
_APART = 0.25
_FEWEST = 6
_ONE_EACH = "a column person, or one file for each person and clip"


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of one person, or of a table that does not tell people apart.

    Attributes
    ----------
    values : (N, J, 3|4) float64
        x, y, score, and z where it is wanted, NaN where missing.
    scored : bool
        The table has scores.
    times, numbers : (N,) float64 or None
        Seconds, and numbers of frames.
    place : (N,) int
        Of the rows in the table.
    name : str
        Of the person, as the table has it.
    several : bool
        Rows of one frame are those of several people, whom no column tells apart.
    """

    values: np.ndarray
    scored: bool
    times: np.ndarray | None
    numbers: np.ndarray | None
    place: np.ndarray
    name: str = ""
    several: bool = False

    @property
    def key(self) -> np.ndarray | None:
        """What orders the rows: the numbers of the frames, otherwise their times."""
        return self.times if self.numbers is None else self.numbers

    @property
    def points(self) -> np.ndarray:
        """(N, J, 2) coordinates."""
        return self.values[..., :2]

    @property
    def scores(self) -> np.ndarray | None:
        """(N, J); a joint that has coordinates and no score is taken to be certain."""
        if not self.scored:
            return None
        sure = np.isnan(self.values[..., 2]) & np.isfinite(self.points).all(axis=2)
        return np.where(sure, 1.0, self.values[..., 2])

    @property
    def depth(self) -> np.ndarray | None:
        """(N, J) third coordinates."""
        return self.values[..., 3] if self.values.shape[2] > 3 else None

    def take(self, rows: np.ndarray) -> Rows:
        """Some of the rows, in the order given."""
        return replace(
            self,
            values=self.values[rows],
            times=None if self.times is None else self.times[rows],
            numbers=None if self.numbers is None else self.numbers[rows],
            place=self.place[rows],
        )

    def frames(self) -> tuple[list[list[Person]], Rows]:
        """The people of each frame, and the first row of each."""
        assert self.key is not None
        _, first, which = np.unique(self.key, return_index=True, return_inverse=True)
        found: list[list[Person]] = [[] for _ in first]
        scores = self.scores
        for row, frame in enumerate(which):
            seen = np.isfinite(self.points[row]).all(axis=1)
            seen &= (self.points[row] != 0).any(axis=1) if scores is None else scores[row] > 0
            if seen.any():
                points = np.where(seen[:, None], self.points[row], np.nan).astype(np.float32)
                sure = np.where(seen, 1.0 if scores is None else np.minimum(scores[row], 1), 0)
                found[frame].append(Person(points, sure.astype(np.float32)))
        return found, self.take(first)


def frame_numbers(cells: Sequence[str], source: str) -> np.ndarray | None:
    """Numbers of the frames, of names such as ``img_0012.jpg`` the last digits; None where all are the same.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_TIMES` for a cell without a number.
    """
    numbers = np.empty(len(cells))
    for row, cell in enumerate(cells):
        value = number_in(cell)
        digits = re.findall(r"\d{1,15}", cell) if value is None else []
        value = float(digits[-1]) if digits else value
        if value is None or not np.isfinite(value):
            raise KeypointError(
                f"row {row + 1}: {cell[:40]!r} is no number of a frame",
                subject=source,
                code="E_KEYPOINTS_TIMES",
            )
        numbers[row] = value
    return None if len(numbers) > 1 and (numbers == numbers[0]).all() else numbers


def by_person(rows: Rows, cells: Sequence[str] | None, source: str) -> tuple[list[Rows], list[str]]:
    """The rows of each person, in the order of their names, and what is worth a note.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_VALUE` where there is a column of people and nobody in it.
    """
    if cells is None:
        return [rows], []
    numbers = [number_in(cell) for cell in cells]
    names = [cell if value is None else f"{value:.17g}" for cell, value in zip(cells, numbers, strict=True)]
    names = [
        "" if value is not None and np.isnan(value) else n for n, value in zip(names, numbers, strict=True)
    ]
    known = sorted(
        set(names) - {""}, key=lambda name: (number_in(name) is None, number_in(name) or 0.0, name)
    )
    if not known:
        raise KeypointError("names no person", subject=source, code="E_KEYPOINTS_VALUE")
    if len(known) == len(names) >= _FEWEST:
        return [rows], ["the column of people numbers the rows, and tells nobody apart"]
    of_whom: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        of_whom.setdefault(name, []).append(row)
    found = [replace(rows.take(np.array(of_whom[name])), name=name) for name in known]
    nobody = (np.array(names) == "") & np.isfinite(rows.points).any(axis=(1, 2))
    return found, [f"{int(nobody.sum())} rows of no person left out"] if nobody.any() else []


def by_index(
    indices: Sequence[Sequence[str]], source: str, *, several: bool = False
) -> tuple[np.ndarray | None, np.ndarray | None, list[str]]:
    """What the columns that number the rows tell: times (N,), the order (N,) of the rows, and notes.

    Whole numbers that ascend tell nothing, as some rows may have been left out before; in another order
    they say in which the rows were. Fractions, clocks and dates are times.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_FORMAT` where they repeat and no column tells ``several`` people apart, or name joints.
    """
    for cells in indices:
        values = [seconds_in(cell) for cell in cells]
        named = [cell for cell in cells if joint_named("_".join(words_of(cell)[:-1]))]
        if len(named) > len(cells) / 2:
            raise KeypointError(
                f"has its joints in rows, as {named[0].strip()[:40]!r}, and its frames in columns",
                subject=source,
                remedy="the table turned: a row for each frame",
                code="E_KEYPOINTS_FORMAT",
            )
        if len(values) < _FEWEST or values.count(None) > len(values) / 2:
            continue
        if None in values:
            raise KeypointError(
                f"its row {cells[values.index(None)].strip()[:40]!r} has no number, as others have",
                subject=source,
                remedy="rows of frames alone, without sums and means",
                code="E_KEYPOINTS_FORMAT",
            )
        index = np.array(values, np.float64)
        if not np.isfinite(index).all() or (index == index[0]).all():
            continue
        if (index % 1 != 0).any():
            return index, None, []
        steps = np.diff(index)
        if (steps > 0).all():
            continue
        if len(np.unique(index)) == len(index):
            return None, np.argsort(index), ["rows sorted by their index"]
        if not several:
            value, times = Counter(values).most_common(1)[0]
            raise KeypointError(
                f"the numbers of its rows repeat: {value:g} stands in {times} of them: "
                "several people or clips, and no column tells them apart",
                subject=source,
                remedy=_ONE_EACH,
                code="E_KEYPOINTS_FORMAT",
            )
    return None, None, []


def following(groups: Sequence[Rows]) -> tuple[list[Rows], list[str]]:
    """The people, the one who is seen most with others who begin where that one was last seen, and a note.

    A tracker that loses somebody gives another number afterwards.
    """
    if any(one.key is None for one in groups):
        return [*groups], []
    ordered = sorted(groups, key=lambda one: -np.isfinite(one.points).all(axis=2).sum())
    ordered = [one.take(np.argsort(_key(one), kind="stable")) for one in ordered]
    before, after, left = list[Rows](), ordered[:1], list[Rows]()  # the earliest is the last of those before
    for other in ordered[1:]:
        first, last = (before or after[:1])[-1], after[-1]
        if _follows(last, other):
            after.append(other)
        elif _follows(other, first):
            before.append(other)
        else:
            left.append(other)
    parts = [*before[::-1], *after]
    if len(parts) == 1:
        return [*groups], []
    joined = replace(
        ordered[0],
        values=np.concatenate([part.values for part in parts]),
        times=None if ordered[0].times is None else np.concatenate([part.times for part in parts]),
        numbers=None if ordered[0].numbers is None else np.concatenate([part.numbers for part in parts]),
        place=np.concatenate([part.place for part in parts]),
    )
    return [joined, *left], [f"{len(parts)} people or tracks that follow one another taken as one"]


def _follows(one: Rows, other: Rows) -> bool:
    return bool(_key(other)[0] > _key(one)[-1]) and near(one.points[-1], other.points[0])


def _key(rows: Rows) -> np.ndarray:
    assert rows.key is not None
    return rows.key


def by_joint(rows: Rows, labels: Sequence[str], where: Mapping[str, int], joints: int, source: str) -> Rows:
    """A row for each frame from a row for each joint.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_FORMAT` where a frame has a joint twice, `E_KEYPOINTS_TIMES` without any frame.
    """
    own = [labels[place] for place in rows.place]
    key = rows.key
    if key is None:
        raise KeypointError(
            "has a row for each joint, and no column for the frame or time",
            subject=source,
            remedy="a column frame",
            code="E_KEYPOINTS_TIMES",
        )
    _, first, frame = np.unique(key, return_index=True, return_inverse=True)
    values = np.full((len(first), joints, rows.values.shape[2]), np.nan)
    taken: set[tuple[int, int]] = set()
    for row, label in enumerate(own):
        if label not in where:
            continue
        place = (int(frame[row]), where[label])
        if place in taken:
            raise KeypointError(
                f"frame {key[row]:g} has the joint {label[:40]!r} twice: the rows of several people",
                subject=source,
                remedy=_ONE_EACH,
                code="E_KEYPOINTS_FORMAT",
            )
        taken.add(place)
        values[place] = rows.values[row, 0]
    return replace(rows.take(first), values=values)


def in_order(rows: Rows, source: str) -> tuple[Rows, list[str]]:
    """The rows in the order of their frames, each once, and what had to be done for it.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_TIMES` where a time is missing, `E_KEYPOINTS_FORMAT` where frames repeat apart from each
        other, as where tables of several people or clips were put one below the other.
    """
    if rows.key is None:
        return rows, []
    if not np.isfinite(rows.key).all():
        raise KeypointError("a time is missing", subject=source, code="E_KEYPOINTS_TIMES")
    what = "times" if rows.numbers is None else "frame numbers"
    notes = []
    once = _once(rows)
    if len(once.place) < len(rows.place):
        notes.append(f"{len(rows.place) - len(once.place)} rows that are there twice left out")
    rows = once
    assert rows.key is not None
    steps = np.diff(rows.key)
    repeats = len(rows.key) - len(np.unique(rows.key))
    if repeats and rows.numbers is not None and rows.name:
        best = np.lexsort((-np.isfinite(rows.points).sum(axis=(1, 2)), rows.key))
        _, first = np.unique(rows.key[best], return_index=True)
        notes.append(f"{repeats} rows left out whose frame and person were there already")
        return rows.take(best[first]), notes
    if repeats and not rows.name:
        together = 1 + int((steps != 0).sum()) == len(np.unique(rows.key))
        if not together:
            value, times = Counter(rows.key.tolist()).most_common(1)[0]
            raise KeypointError(
                f"{what} repeat: {value:g} stands in {times} rows that are not together: "
                "several people or clips, and no column tells them apart",
                subject=source,
                remedy=_ONE_EACH,
                code="E_KEYPOINTS_FORMAT",
            )
        rows = replace(rows, several=rows.numbers is not None or _apart(rows))
    if (steps < 0).any():
        assert rows.key is not None
        rows = rows.take(np.argsort(rows.key, kind="stable"))
        notes.append(f"rows sorted by their {what}")
    return rows, notes


def _once(rows: Rows) -> Rows:
    """The rows without those that repeat another one in every value."""
    assert rows.key is not None
    seen: set[bytes] = set()
    kept = []
    for row in range(len(rows.place)):
        mark = rows.key[row].tobytes() + rows.values[row].tobytes()
        if mark not in seen or not np.isfinite(rows.points[row]).any():
            kept.append(row)
        seen.add(mark)
    return rows if len(kept) == len(rows.place) else rows.take(np.array(kept))


def _apart(rows: Rows) -> bool:
    """Whether rows of one time are of several people, and not of a clock that is read too coarsely."""
    assert rows.key is not None
    same = np.flatnonzero(np.diff(rows.key) == 0)
    points = rows.points[np.isfinite(rows.points).all(axis=2).any(axis=1)]
    with np.errstate(invalid="ignore"):
        moved = np.linalg.norm(rows.points[same + 1] - rows.points[same], axis=2)
    moved = moved[np.isfinite(moved)]
    if not moved.size or not len(points):
        return False
    extent = float(np.median((np.nanmax(points, axis=1) - np.nanmin(points, axis=1)).max(axis=1)))
    return float(np.median(moved)) > _APART * extent
