"""Draws keypoint tables as other tools write them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from gesture_pose_files.csv_table import CsvReader

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import COCO17, COCO18
from gesture_core.testing import draw_pose
from gesture_core.types import PoseSequence

FRAMES = 12


def person(joints: Sequence[str] = COCO18.joints, at: float = 0.0) -> np.ndarray:
    """(T, J, 2) whole pixels of somebody who waves, ``at`` pixels to the right."""
    points = draw_pose(frames=FRAMES).keypoints[:, [COCO18.index(joint) for joint in joints]]
    return np.asarray((points + np.array([at, 0])).round())


def cells(row: Iterable[object]) -> list[str]:
    return [str(int(cell)) if isinstance(cell, float | np.floating) else str(cell) for cell in row]


def save(
    path: Path, header: Sequence[object] | None, rows: Iterable[Iterable[object]], mark: str = ","
) -> Path:
    lines = [mark.join(map(str, header))] if header is not None else []
    path.write_text("\n".join([*lines, *(mark.join(cells(row)) for row in rows)]) + "\n", encoding="utf-8")
    return path


def named(joints: Sequence[str] = COCO18.joints, form: str = "{}_{}") -> list[str]:
    return [form.format(joint, axis) for joint in joints for axis in "xy"]


def flat(points: np.ndarray) -> list[list[float]]:
    return [row.reshape(-1).tolist() for row in points]


def read(path: Path, people: str = "single", **said: object) -> list[PoseSequence]:
    """What the reader takes and makes of a table."""
    reader = CsvReader(ReadOptions(**said), people)  # type: ignore[arg-type]
    assert reader.accepts(path)
    return reader.read(path)


def refused(path: Path, **said: object) -> KeypointError:
    try:
        CsvReader(ReadOptions(**said)).read(path)  # type: ignore[arg-type]
    except KeypointError as error:
        assert error.subject
        return error
    raise AssertionError(f"{path.read_text()[:200]} was read")


def same(pose: PoseSequence, points: np.ndarray, joints: Sequence[str] = COCO18.joints) -> None:
    """The joints of a sequence are these; compared in COCO-18."""
    found = pose.onto("coco18")
    for number, joint in enumerate(joints):
        if joint in COCO18.joints:
            np.testing.assert_allclose(found.keypoints[:, COCO18.index(joint)], points[:, number], atol=1e-3)


__all__ = [
    "COCO17",
    "COCO18",
    "FRAMES",
    "cells",
    "flat",
    "named",
    "person",
    "read",
    "refused",
    "same",
    "save",
]
