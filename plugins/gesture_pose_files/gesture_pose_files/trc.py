"""Marker files of OpenSim (``.trc``), as Sports2D and Pose2Sim write them: text, a row a frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.types import PoseSequence
from gesture_pose_files.files import MAX_CSV_BYTES, MAX_FRAMES, head_of, open_keypoints
from gesture_pose_files.in_front import seen_from_in_front
from gesture_pose_files.reader import OneClipReader
from gesture_pose_files.table import numbers_of, rows_of


class TrcReader(OneClipReader):
    """Reads ``.trc``: Sports2D's two dimensions as they are, Pose2Sim's three as seen from in front.

    A file is one person; the option ``order`` is for markers that have names of their own.
    """

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.trc`` and begins with ``PathFileType``."""
        return path.suffix.lower() == ".trc" and b"PathFileType" in head_of(path, 32)

    def refusal(self, path: Path) -> str:
        """What it begins with."""
        return f"it does not begin with PathFileType, but with {head_of(path, 12)!r}"

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The person in the file, which says times, unit and names."""
        with open_keypoints(path, MAX_CSV_BYTES) as file:
            rows = rows_of(file, source, "\t")
            head = [next(rows, []) for _ in range(5)]
            facts = dict(zip(head[1], head[2], strict=False))
            names = [name.strip() for name in head[3][2:] if name.strip()]
            if not names or "Units" not in facts:
                raise KeypointError(
                    "is no marker file: its header names no markers or no unit",
                    subject=source,
                    code="E_KEYPOINTS_FORMAT",
                )
            width = 2 + 3 * len(names)
            # Rows may end in tabs or hold nothing else; more markers than names are an error of their width.
            rows = (
                row if any(cell.strip() for cell in row[width:]) else row[:width]
                for row in rows if any(cell.strip() for cell in row)
            )  # fmt: skip
            table, _ = numbers_of(rows, width, range(width), (), MAX_FRAMES, source)
        if not len(table):
            raise KeypointError("holds no frame", subject=source, code="E_KEYPOINTS_EMPTY")
        unit, times = facts["Units"].strip().lower(), table[:, 1]
        points = table[:, 2:].reshape(len(table), -1, 3)
        pose = seen_from_in_front(
            names,
            np.where((points == 0).all(axis=2, keepdims=True), np.nan, points),
            times - times[0] if np.isfinite(times[0]) else times,
            unit,
            self.options,
            source=source,
            reader="trc",
        )
        return [pose]
