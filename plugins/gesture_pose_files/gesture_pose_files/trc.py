"""Marker files of OpenSim (``.trc``), as Sports2D and Pose2Sim write them: text, a row a frame."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.files import MAX_CSV_BYTES, MAX_FRAMES, head_of, open_keypoints
from gesture_pose_files.layout import check_seconds, sequence
from gesture_pose_files.named import Named, joints_among, seen_or_nan

_MAX_LINE = 1 << 18
_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}


@dataclass(frozen=True)
class TrcReader:
    """Reads ``.trc``: Sports2D's two dimensions as they are, Pose2Sim's three as seen from in front.

    Which way is up is what leads from the hips to the neck. Three dimensions are projected onto the plane
    that the shoulders span on average, so that a gesture looks as to a camera before the person.

    Attributes
    ----------
    options : ReadOptions
        ``order`` where markers have names of their own; times, units and names stand in the file.
    """

    options: ReadOptions = field(default_factory=ReadOptions)

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.trc`` and begins with ``PathFileType``."""
        return path.suffix.lower() == ".trc" and b"PathFileType" in head_of(path, 32)

    def refusal(self, path: Path) -> str:
        """What it begins with."""
        return f"it does not begin with PathFileType, but with {head_of(path, 12)!r}"

    def members(self, path: Path) -> list[str]:
        """``[""]``: a file is one person."""
        return [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The person in the file.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_FORMAT`, `E_KEYPOINTS_EMPTY`, `E_KEYPOINTS_SKELETON`, `E_KEYPOINTS_TIMES`,
            `E_KEYPOINTS_LIMIT`, and those of `files.open_keypoints`.
        """
        source = printable(path)
        if member:
            raise KeypointError(f"has no member {member!r}", subject=source, code="E_KEYPOINTS_MEMBER")
        unit, names, table = _parsed(path, source)
        named = joints_among(names, self.options, source)
        points = table[:, 2:].reshape(len(table), -1, 3)[:, named.columns]
        points = np.where((points == 0).all(axis=2, keepdims=True), np.nan, points)
        flat, notes = _from_in_front(points, named, source)
        times = table[:, 1]
        check_seconds(times, source)
        flat, scores = seen_or_nan(flat, np.ones(flat.shape[:2]))
        return [
            sequence(
                flat * _LENGTHS.get(unit, 1.0),
                self.options,
                source=source,
                reader="trc",
                scores=scores,
                times=times - times[0] if len(times) and np.isfinite(times[0]) else times,
                body=named.body,
                axes="xy",
                unit="metres" if unit in _LENGTHS else "pixels",
                notes=(*named.notes, *notes),
            )
        ]


def _parsed(path: Path, source: str) -> tuple[str, list[str], np.ndarray]:
    """The unit, the names of the markers, and (T, 2 + 3 N) numbers: frame, time, x, y, z of each marker."""
    rows: list[np.ndarray] = []
    with open_keypoints(path, MAX_CSV_BYTES) as file:
        text = io.TextIOWrapper(file, encoding="utf-8-sig", errors="strict")
        try:
            head = [text.readline(_MAX_LINE).rstrip("\r\n").split("\t") for _ in range(5)]
            facts = dict(zip(head[1], head[2], strict=False))
            names = [name.strip() for name in head[3][2:] if name.strip()]
            width = 2 + 3 * len(names)
            if not names or "Units" not in facts:
                raise ValueError("its header names no markers or no unit")
            while line := text.readline(_MAX_LINE):
                if not line.strip():
                    continue
                cells = line.rstrip("\r\n").split("\t")
                if len(cells) < width or any(cell.strip() for cell in cells[width:]):
                    raise ValueError(f"row {len(rows) + 1} has {len(cells)} cells, expected {width}")
                if len(rows) >= MAX_FRAMES:
                    raise KeypointError(
                        f"holds more than {MAX_FRAMES} rows", subject=source, code="E_KEYPOINTS_LIMIT"
                    )
                rows.append(np.array([float(cell) if cell.strip() else np.nan for cell in cells[:width]]))
        except ValueError as error:
            raise KeypointError(
                f"is no marker file: {error}", subject=source, code="E_KEYPOINTS_FORMAT"
            ) from error
    if not rows:
        raise KeypointError("holds no frame", subject=source, code="E_KEYPOINTS_EMPTY")
    return facts["Units"].strip().lower(), names, np.stack(rows)


def _from_in_front(points: np.ndarray, named: Named, source: str) -> tuple[np.ndarray, list[str]]:
    """(T, J, 2), x to the right of who looks and y down, of (T, J, 3) in whatever axes; and what was done."""
    if not np.isfinite(points).any():
        return points[..., :2], []
    up = _between(points, named, ("mid_hip", "left_hip", "right_hip"), ("neck", "left_shoulder"))
    spread = np.nanmax(points, axis=(0, 1)) - np.nanmin(points, axis=(0, 1))
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
    flat = np.stack([points @ across, -np.sign(up[vertical]) * points[..., vertical]], axis=2)
    return flat, ["three dimensions, seen from in front"]


def _between(
    points: np.ndarray, named: Named, one: tuple[str, ...], two: tuple[str, ...]
) -> np.ndarray | None:
    """The median vector from the first joint of ``one`` that is there to the first of ``two``."""
    starts, ends = ([j for j in joints if j in named.body.joints] for joints in (one, two))
    if not starts or not ends:
        return None
    steps = points[:, named.body.index(ends[0])] - points[:, named.body.index(starts[0])]
    steps = steps[np.isfinite(steps).all(axis=1)]
    return np.asarray(np.median(steps, axis=0)) if len(steps) else None
