"""Marker files of OpenSim (``.trc``), as Sports2D and Pose2Sim write them: text, a row a frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.types import PoseSequence
from gesture_pose_files.files import MAX_CSV_BYTES, MAX_FRAMES, head_of, open_keypoints
from gesture_pose_files.named import Named, joints_among, people_of
from gesture_pose_files.reader import OneClipReader
from gesture_pose_files.table import numbers_of, rows_of

_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}


class TrcReader(OneClipReader):
    """Reads ``.trc``: Sports2D's two dimensions as they are, Pose2Sim's three as seen from in front.

    Which way is up is what leads from the hips to the neck. Three dimensions are projected onto the plane
    that the shoulders span on average, so that a gesture looks as to a camera before the person. A file is
    one person; the option ``order`` is for markers that have names of their own.
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
        named = joints_among(names, self.options, source)
        points = table[:, 2:].reshape(len(table), -1, 3)
        points = np.where((points == 0).all(axis=2, keepdims=True), np.nan, points)
        flat, notes = _from_in_front(points, named, source, depth=self.options.depth)
        unit, times = facts["Units"].strip().lower(), table[:, 1]
        return people_of(
            named,
            flat[None] * _LENGTHS.get(unit, 1.0),
            None,
            replace(self.options, axes=None),  # the body itself has shown which way is up
            source=source,
            reader="trc",
            times=times - times[0] if np.isfinite(times[0]) else times,
            unit="metres" if unit in _LENGTHS else "pixels",
            notes=notes,
        )


def _from_in_front(
    points: np.ndarray, named: Named, source: str, *, depth: bool
) -> tuple[np.ndarray, list[str]]:
    """(T, J, 2), x to the right of who looks and y down, of (T, J, 3) in whatever axes; and what was done.

    With ``depth`` (T, J, 3), z away from who looks, where there is one.
    """
    if not np.isfinite(points[:, named.columns]).any():
        return points[..., :2], []
    up = _between(points, named, ("mid_hip", "left_hip", "right_hip"), ("neck", "left_shoulder"))
    known = points[:, named.columns]
    spread = np.nanmax(known, axis=(0, 1)) - np.nanmin(known, axis=(0, 1))
    if not spread[2] > 0:
        if up is None or up[1] <= 0:
            return points[..., :2], []
        return points[..., :2] * [1, -1], ["y points up and was turned round"]
    across = _between(points, named, ("right_shoulder", "right_hip"), ("left_shoulder", "left_hip"))
    if up is None or across is None:
        raise KeypointError(
            "has three dimensions, and no hips and shoulders that would tell which way it faces",
            subject=source,
            remedy="a file with markers of both shoulders and the hips",
            code="E_KEYPOINTS_SKELETON",
        )
    vertical = int(np.argmax(np.abs(up)))
    across[vertical] = 0
    across /= max(float(np.linalg.norm(across)), 1e-9)
    sides = [points @ across, -np.sign(up[vertical]) * points[..., vertical]]
    if depth:
        sides.append(points @ np.cross(across, -np.sign(up[vertical]) * np.eye(3)[vertical]))
    flat = np.stack(sides, axis=2)
    return flat, ["three dimensions, seen from in front"]


def _between(
    points: np.ndarray, named: Named, one: tuple[str, ...], two: tuple[str, ...]
) -> np.ndarray | None:
    """The median vector from the first joint of ``one`` that is there to the first of ``two``."""
    starts, ends = ([j for j in joints if j in named.body.joints] for joints in (one, two))
    if not starts or not ends:
        return None
    start, end = (named.columns[named.body.index(joint)] for joint in (starts[0], ends[0]))
    steps = points[:, end] - points[:, start]
    steps = steps[np.isfinite(steps).all(axis=1)]
    return np.asarray(np.median(steps, axis=0)) if len(steps) else None
