"""Files of the library pose-format (``.pose``): MediaPipe's or OpenPose's joints, for sign language."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.joint_names import joint_named
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.files import COPY_AGAIN, MAX_ARRAY_BYTES, check_people, open_keypoints
from gesture_pose_files.layout import sequence
from gesture_pose_files.named import best, joints_among, seen_or_nan
from gesture_pose_files.scores import in_unit


@dataclass(frozen=True)
class PoseFormatReader:
    """Reads ``.pose``, of which the component with most joints of the body is used.

    Attributes
    ----------
    options : ReadOptions
        What the file leaves open; it says the joints, the rate and the size of the picture.
    people : "single" or "multi"
        The person with the highest confidence, or everybody.
    """

    options: ReadOptions = field(default_factory=ReadOptions)
    people: str = "single"

    def __post_init__(self) -> None:
        check_people(self.people)

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.pose``: the format has no mark of its own at its beginning."""
        return path.suffix.lower() == ".pose" and path.is_file()

    def members(self, path: Path) -> list[str]:
        """``[""]``: a file is one sequence."""
        return [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The people in the file.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_BROKEN`, `E_KEYPOINTS_SKELETON`, `E_KEYPOINTS_EMPTY`, and those of
            `files.open_keypoints`.
        """
        from pose_format import Pose

        source = printable(path)
        if member:
            raise KeypointError(f"has no member {member!r}", subject=source, code="E_KEYPOINTS_MEMBER")
        with open_keypoints(path, MAX_ARRAY_BYTES) as file:
            data = file.read(MAX_ARRAY_BYTES + 1)
        try:
            pose = Pose.read(data)
            values = np.ma.getdata(pose.body.data)
            scores = np.asarray(pose.body.confidence, np.float64)
            components = [(part.name, list(part.points)) for part in pose.header.components]
            rate, size = float(pose.body.fps), (pose.header.dimensions.width, pose.header.dimensions.height)
        except (
            ValueError, TypeError, IndexError, KeyError, AttributeError, NotImplementedError, OverflowError,
            EOFError, MemoryError, struct.error,
        ) as error:  # fmt: skip
            raise KeypointError(
                f"is no file of pose-format: {error or type(error).__name__}",
                subject=source,
                remedy=COPY_AGAIN,
                code="E_KEYPOINTS_BROKEN",
            ) from error
        if not components or values.ndim != 4 or values.shape[3] < 2 or scores.shape != values.shape[:3]:
            raise KeypointError("holds no points", subject=source, code="E_KEYPOINTS_EMPTY")
        chosen = max(range(len(components)), key=lambda n: _known(components[n][1]))
        start = sum(len(points) for _, points in components[:chosen])
        points = components[chosen][1]
        named = joints_among(points, self.options, source)
        unused = [other for index, (other, _) in enumerate(components) if index != chosen]
        notes = [*named.notes, *([f"parts that are not used: {', '.join(unused)[:80]}"] if unused else [])]
        columns = [start + column for column in named.columns]
        where = values[:, :, columns, :2].astype(np.float64)
        level, note = in_unit(scores[:, :, columns], where, source)
        found = []
        for person in range(values.shape[1]):
            flat, sure = seen_or_nan(where[:, person], level[:, person])
            found.append(
                sequence(
                    flat,
                    self.options,
                    source=source,
                    reader="pose-format",
                    scores=sure,
                    times=np.arange(len(flat)) / rate if 0 < rate < 1e5 else None,
                    body=named.body,
                    axes="xy",
                    frame_size=size if min(size) > 0 else None,
                    notes=[*notes, *([note] if note else [])],
                )
            )
        if not found:
            raise KeypointError("holds nobody", subject=source, code="E_KEYPOINTS_EMPTY")
        return best(found, self.people)


def _known(names: list[str]) -> int:
    return len({joint_named(name) for name in names} - {None})
