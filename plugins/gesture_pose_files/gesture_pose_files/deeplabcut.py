"""DeepLabCut's tables: three or four header rows (scorer, individuals, bodyparts, coords), a row a frame."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.files import MAX_CSV_BYTES, MAX_FRAMES, head_of, open_keypoints, suffix_of
from gesture_pose_files.named import joints_among, people_of
from gesture_pose_files.numbering import number_in
from gesture_pose_files.reader import OneClipReader
from gesture_pose_files.table import SUFFIXES, numbers_of, rows_of

_FIRST = re.compile(rb'(?:\xef\xbb\xbf)?"?(?:scorer|bodyparts)"?[,;\t]', re.IGNORECASE)
_LEVELS = ("scorer", "individuals", "bodyparts", "coords")
_COORDINATES = ("x", "y", "likelihood")

Column = tuple[str, str, str]
"""Individual, body part, and coordinate."""


class DeepLabCutCsvReader(OneClipReader):
    """Reads the CSV files that DeepLabCut writes for a video, of one individual or of several.

    The option ``order`` is for body parts that have names of their own.
    """

    def accepts(self, path: Path) -> bool:
        """Whether the first cell of a table is ``scorer`` or ``bodyparts``."""
        return suffix_of(path) in SUFFIXES and is_deeplabcut(head_of(path, 64))

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The individuals in the table."""
        with open_keypoints(path, MAX_CSV_BYTES) as file:
            rows = rows_of(file, source)
            header: dict[str, list[str]] = {}
            row: list[str] = []
            for row in rows:
                level = row[0].strip().lower() if row else ""
                if level not in _LEVELS or level in header:
                    break
                header[level], row = [cell.strip() for cell in row], []
            if missing := {"bodyparts", "coords"} - header.keys():
                raise _refused(f"has no header row {' nor '.join(sorted(missing))}", source)
            width = len(header["coords"])
            if any(len(cells) != width for cells in header.values()):
                raise _refused("has header rows of different lengths", source)
            # What stands before the coordinates numbers the frames, or names their pictures.
            first = next((place for place, cell in enumerate(header["coords"]) if place and cell), width)
            rows = chain([row] if row else [], rows)
            table, texts = numbers_of(rows, width, range(first, width), (), MAX_FRAMES, source)
        if not len(table):
            raise KeypointError("holds a header and no row", subject=source, code="E_KEYPOINTS_EMPTY")
        levels = [header.get(level, [""] * width)[first:] for level in _LEVELS[1:]]
        numbers = [numbered[1] if (numbered := number_in(cells[-1].strip())) else None for cells in texts]
        columns = list(zip(*levels, strict=True))
        found = individuals(columns, table[:, first:], numbers, self.options, source, "deeplabcut-csv")
        return self.best(found, source)


def is_deeplabcut(head: bytes) -> bool:
    """Whether a table that begins with ``head`` is DeepLabCut's."""
    return _FIRST.match(head) is not None


def individuals(
    columns: Sequence[Column],
    values: np.ndarray,
    numbers: Sequence[int | None],
    options: ReadOptions,
    source: str,
    reader: str,
) -> list[PoseSequence]:
    """Those in (T, C) ``values`` of such ``columns``; ``numbers`` of frames are None where unknown."""
    where = {column: index for index, column in enumerate(columns)}
    known = np.array([np.nan if number is None else number for number in numbers])
    found = []
    for individual in dict.fromkeys(one for one, _, _ in columns):
        parts = list(dict.fromkeys(part for one, part, _ in columns if one == individual))
        places = [[where.get((individual, part, coord)) for coord in _COORDINATES] for part in parts]
        if any(place is None for row in places for place in row[:2]):
            raise _refused("has a body part without x or y", source)
        scores = [np.ones(len(values)) if row[2] is None else values[:, row[2]] for row in places]
        found += people_of(
            joints_among(parts, options, source),
            values[None][:, :, np.array([row[:2] for row in places], np.int64)],
            np.stack(scores, axis=1)[None],
            options,
            source=source,
            reader=reader,
            numbers=known if (np.diff(known) > 0).all() and np.isfinite(known).all() else None,
        )
    return found


def _refused(cause: str, source: str) -> KeypointError:
    return KeypointError(cause, subject=source, code="E_KEYPOINTS_FORMAT")
