"""Files of the library pose-format (``.pose``): MediaPipe's or OpenPose's joints, for sign language."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.joint_names import joint_named
from gesture_core.types import PoseSequence
from gesture_pose_files.files import COPY_AGAIN, MAX_ARRAY_BYTES, open_keypoints
from gesture_pose_files.named import joints_among, people_of
from gesture_pose_files.reader import OneClipReader


class PoseFormatReader(OneClipReader):
    """Reads ``.pose``, of which the component with most joints of the body is used."""

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.pose``: the format has no mark of its own at its beginning."""
        return path.suffix.lower() == ".pose" and path.is_file()

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The people in the file, which says the joints, the rate and the size of the picture."""
        from pose_format import Pose

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
        unused = ", ".join(other for index, (other, _) in enumerate(components) if index != chosen)
        part = slice(start, start + len(points))
        found = people_of(
            joints_among(points, self.options, source),
            values[:, :, part, :2].transpose(1, 0, 2, 3),
            scores[:, :, part].transpose(1, 0, 2),
            self.options,
            source=source,
            reader="pose-format",
            times=np.arange(len(values)) / rate if 0 < rate < 1e5 else None,
            frame_size=size if min(size) > 0 else None,
            notes=[f"parts that are not used: {unused[:80]}"] if unused else [],
        )
        return self.best(found, source)


def _known(names: list[str]) -> int:
    return len({joint_named(name) for name in names} - {None})
