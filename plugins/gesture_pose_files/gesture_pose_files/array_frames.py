"""Folders with one ``.npy`` a frame, numbered: ``hello/0/12.npy`` holds the landmarks of one frame."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence
from gesture_pose_files.files import open_keypoints
from gesture_pose_files.layout import sequence
from gesture_pose_files.npy import MAX_FILE_BYTES, read_array, read_header
from gesture_pose_files.numbering import clip_in, clips_in, some_files
from gesture_pose_files.reader import with_lost
from gesture_pose_files.whole_body import is_one_frame, is_one_person, people_in

_LOOKED_AT = 3


@dataclass(frozen=True)
class ArrayFramesReader:
    """Reads a folder of numbered ``.npy``, each the joints of one frame: (J, 2|3|4), or a flat row of them.

    A file that cannot be read, or has another shape than most, costs its frame.

    Attributes
    ----------
    options : ReadOptions
        What the files leave open; a frame's time is its number over the rate.
    """

    options: ReadOptions = field(default_factory=ReadOptions)

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is a folder with a numbered ``.npy`` that is one frame, and no sequence."""
        shapes = [*map(self._shape, some_files(path, ".npy", _LOOKED_AT))]
        if any(is_one_frame(shape, self.options) for shape in shapes if shape):
            return True
        # As networks give one person; clips of one frame would be as good as none.
        alone = [shape is not None and is_one_person(shape) for shape in shapes]
        return bool(alone) and all(alone)

    def _shape(self, file: Path) -> tuple[int, ...] | None:
        try:
            with open_keypoints(file, MAX_FILE_BYTES) as opened:
                return read_header(opened, printable(file))[0]
        except KeypointError:
            return None

    def members(self, path: Path) -> list[str]:
        """Names of the sequences in the folder; ``[""]`` where there is only one."""
        names = list(clips_in(path, ".npy"))
        return names if len(names) > 1 else [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The person in one sequence.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_MEMBER`, `E_KEYPOINTS_EMPTY`, `E_KEYPOINTS_TIMES`, `E_KEYPOINTS_LIMIT`, those of the
            first frame where none can be read, and those of `layout.sequence`.
        """
        source = printable(path) + (f"::{member}" if member else "")
        clip = clip_in(path, member, ".npy", "0.npy, 1.npy, …")
        numbers = np.array([number for number, _ in clip], np.float64)
        frames, lost = _frames([file for _, file in clip])
        (array, *_), notes = people_in(frames, self.options, source)
        one = sequence(
            array, self.options, source=source, reader="array-frames", numbers=numbers, notes=notes
        )
        return [with_lost(one, lost)]


def _frames(files: list[Path]) -> tuple[np.ndarray, list[KeypointError]]:
    """The frames, NaN where they cannot be read, and why."""
    arrays: list[np.ndarray | None] = []
    lost: list[KeypointError] = []
    for file in files:
        try:
            with open_keypoints(file, MAX_FILE_BYTES) as opened:
                arrays.append(read_array(opened, printable(file)).astype(np.float64))
        except KeypointError as error:
            lost.append(KeypointError(error.cause, subject=error.subject, code=error.code))
            arrays.append(None)
    shapes = Counter(array.shape for array in arrays if array is not None)
    if not shapes:
        raise lost[0]
    shape = shapes.most_common(1)[0][0]
    for index, array in enumerate(arrays):
        if array is not None and array.shape != shape:
            cause = f"has the shape {array.shape}, others have {shape}"
            lost.append(KeypointError(cause, subject=printable(files[index]), code="E_KEYPOINTS_SHAPE"))
            arrays[index] = None
    blank = np.full(shape, np.nan)
    return np.stack([blank if array is None else array for array in arrays]), lost
