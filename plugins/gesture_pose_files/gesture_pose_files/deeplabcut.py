"""DeepLabCut's tables: three or four header rows (scorer, individuals, bodyparts, coords), a row a frame."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.files import MAX_CSV_BYTES, MAX_FRAMES, check_people, head_of, open_keypoints
from gesture_pose_files.layout import sequence
from gesture_pose_files.named import best, joints_among, seen_or_nan
from gesture_pose_files.numbering import number_in

_LEVELS = ("scorer", "individuals", "bodyparts", "coords")
_SUFFIXES = (".csv", ".tsv")


@dataclass(frozen=True)
class DeepLabCutCsvReader:
    """Reads the CSV files that DeepLabCut writes for a video, of one individual or of several.

    Attributes
    ----------
    options : ReadOptions
        What they leave open; ``order`` where body parts have names of their own.
    people : "single" or "multi"
        The individual with the highest likelihoods, or each.
    """

    options: ReadOptions = field(default_factory=ReadOptions)
    people: str = "single"

    def __post_init__(self) -> None:
        check_people(self.people)

    def accepts(self, path: Path) -> bool:
        """Whether the first line of a ``.csv`` begins with ``scorer`` or ``bodyparts``."""
        if path.suffix.lower() not in _SUFFIXES:
            return False
        return head_of(path, 64).removeprefix(b"\xef\xbb\xbf").lower().startswith((b"scorer,", b"bodyparts,"))

    def members(self, path: Path) -> list[str]:
        """``[""]``: a table is one sequence."""
        return [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The individuals in the table.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_FORMAT`, `E_KEYPOINTS_SKELETON`, `E_KEYPOINTS_LIMIT`, and those of
            `files.open_keypoints`.
        """
        source = printable(path)
        if member:
            raise KeypointError(f"has no member {member!r}", subject=source, code="E_KEYPOINTS_MEMBER")
        header: dict[str, list[str]] = {}
        numbers: list[int | None] = []
        rows: list[np.ndarray] = []
        first = 1
        with open_keypoints(path, MAX_CSV_BYTES) as file:
            try:
                for cells in csv.reader(io.TextIOWrapper(file, encoding="utf-8-sig", newline="")):
                    level = cells[0].strip().lower() if cells else ""
                    if not rows and level in _LEVELS and level not in header:
                        header[level] = [cell.strip() for cell in cells]
                        continue
                    if not rows:
                        first = _first_column(header, source)
                    if len(rows) >= MAX_FRAMES:
                        raise KeypointError(
                            f"holds more than {MAX_FRAMES} rows", subject=source, code="E_KEYPOINTS_LIMIT"
                        )
                    if len(cells) != len(header["coords"]):
                        raise _refused(f"row {len(rows) + 1} has {len(cells)} cells", source)
                    rows.append(np.array([float(cell) if cell.strip() else np.nan for cell in cells[first:]]))
                    numbers.append(_number(cells[first - 1]))
            except (csv.Error, ValueError) as error:
                raise _refused(f"is no table of DeepLabCut: {error}", source) from error
        if not rows:
            raise KeypointError("holds a header and no row", subject=source, code="E_KEYPOINTS_EMPTY")
        blank = [""] * len(header["coords"])
        levels = [header.get(level, blank)[first:] for level in _LEVELS[1:]]
        columns = list(zip(*levels, strict=True))
        return sequences(
            columns, np.stack(rows), numbers, self.options, self.people, source, "deeplabcut-csv"
        )


def sequences(
    columns: Sequence[tuple[str, str, str]],
    values: np.ndarray,
    numbers: Sequence[int | None],
    options: ReadOptions,
    people: str,
    source: str,
    reader: str,
) -> list[PoseSequence]:
    """Individuals in a table whose ``columns`` are (individual, body part, coordinate).

    ``values`` is (T, C); ``numbers`` are those of the frames, or None where one has none.
    """
    where = {column: index for index, column in enumerate(columns)}
    found = []
    for individual in dict.fromkeys(one for one, _, _ in columns):
        parts = list(dict.fromkeys(part for one, part, _ in columns if one == individual))
        if not all((individual, part, coord) in where for part in parts for coord in ("x", "y")):
            raise _refused("has a body part without x or y", source)
        points = np.stack(
            [values[:, [where[individual, part, "x"], where[individual, part, "y"]]] for part in parts],
            axis=1,
        )
        scores = np.ones(points.shape[:2])
        for index, part in enumerate(parts):
            if (individual, part, "likelihood") in where:
                scores[:, index] = values[:, where[individual, part, "likelihood"]]
        points, scores = seen_or_nan(points, scores)
        named = joints_among(parts, options, source)
        plain = [number for number in numbers if number is not None]
        ascending = len(plain) == len(values) and all(np.diff(plain) > 0)
        found.append(
            sequence(
                points[:, named.columns],
                options,
                source=source,
                reader=reader,
                scores=scores[:, named.columns],
                numbers=np.array(plain, np.float64) if ascending else None,
                body=named.body,
                axes="xy",
                notes=named.notes,
            )
        )
    if not found:
        raise _refused("names no body part", source)
    return best(found, people)


def _first_column(header: dict[str, list[str]], source: str) -> int:
    """The first column with coordinates; those before it number the frames or name their pictures."""
    missing = {"bodyparts", "coords"} - header.keys()
    if missing:
        raise _refused(f"has no header row {' nor '.join(sorted(missing))}", source)
    if len({len(cells) for cells in header.values()}) > 1:
        raise _refused("has header rows of different lengths", source)
    return next((i for i, cell in enumerate(header["coords"]) if i and cell), len(header["coords"]))


def _number(cell: str) -> int | None:
    numbered = number_in(cell.strip())
    return numbered[1] if numbered else None


def _refused(cause: str, source: str) -> KeypointError:
    return KeypointError(cause, subject=source, code="E_KEYPOINTS_FORMAT")
