"""Folders of Ultralytics' text files, one numbered file a frame: what ``save_txt=True`` leaves of a video."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import Person, PoseSequence
from gesture_pose_files.clip import Clip
from gesture_pose_files.files import MAX_JSON_BYTES, head_of, open_keypoints
from gesture_pose_files.json_people import Found
from gesture_pose_files.layout import BY_COUNT
from gesture_pose_files.numbering import clip_in, clips_in, some_files
from gesture_pose_files.reader import Reader

_LOOKED_AT = 3
_BOX = 5
"""Values before the joints: the class, and middle and size of a box."""
_MORE = 2
"""Values behind them at most: the confidence, and the number of the person."""
_HEAD_BYTES = 1 << 13


class YoloTextReader(Reader):
    """Reads ``labels/clip_1.txt``, …: a line for each person, with a class, a box, then x, y and a score of
    each joint as shares of the picture, perhaps with a confidence and the number of a track behind them.

    Frames without people have no file; their numbers are left out and count as such.
    """

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is a folder with a numbered ``.txt`` of such lines."""
        for file in some_files(path, ".txt", _LOOKED_AT):
            line = head_of(file, _HEAD_BYTES).decode("utf-8", "replace").partition("\n")[0]
            if _person(line.split(), self.options) is not None:
                return True
        return False

    def members(self, path: Path) -> list[str]:
        """Names of the sequences in the folder; ``[""]`` where there is only one."""
        names = list(clips_in(path, ".txt"))
        return names if len(names) > 1 else [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The people of one sequence.

        Raises
        ------
        KeypointError
            As `OpenPoseJsonReader.read`.
        """
        clip = Clip(printable(path) + (f"::{member}" if member else ""), "yolo-text")
        for number, file in clip_in(path, member, ".txt", "clip_1.txt, clip_2.txt, …"):
            try:
                clip.add(number, self._frame(file))
            except KeypointError as error:
                clip.add(number, KeypointError(error.cause, subject=error.subject, code=error.code))
        clip.fill()
        return clip.sequences(self.options, self.people)

    def _frame(self, path: Path) -> Found:
        with open_keypoints(path, MAX_JSON_BYTES) as file:
            lines = file.read(MAX_JSON_BYTES + 1).decode("utf-8", "replace").splitlines()
        people: list[Person] = []
        identities: list[int | None] = []
        for number, line in enumerate(lines, 1):
            if not line.strip():
                continue
            found = _person(line.split(), self.options)
            if found is None:
                raise KeypointError(
                    f"line {number} is no class, box and joints",
                    subject=printable(path),
                    code="E_KEYPOINTS_FORMAT",
                )
            person, identity = found
            if (person.scores > 0).any():
                people.append(person)
                identities.append(identity)
        joints = len(people[0].scores) if people else 0
        return Found(people, identities, joints)


def _person(cells: Sequence[str], options: ReadOptions) -> tuple[Person, int | None] | None:
    """The person in a line, and the number of the track where there is one; None where it is no such line."""
    try:
        values = np.array([float(cell) for cell in cells])
    except ValueError:
        return None
    counts = list(BY_COUNT) if options.skeleton is None else [len(options.skeleton.joints)]
    for width in (3, 2):
        for behind in range(_MORE + 1):
            joints, rest = divmod(len(values) - _BOX - behind, width)
            if rest or joints not in counts or not np.isfinite(values).all():
                continue
            if values[0] != round(values[0]) or not ((values[1:_BOX] >= 0) & (values[1:_BOX] <= 1)).all():
                continue
            points = values[_BOX : len(values) - behind].reshape(joints, width)
            scores = points[:, 2] if width == 3 else (points > 0).all(axis=1).astype(float)
            seen = (scores > 0) & (points[:, :2] != 0).any(axis=1)
            place = np.where(seen[:, None], points[:, :2], np.nan).astype(np.float32)
            track = int(values[-1]) if behind == _MORE else None
            return Person(place, np.where(seen, scores, 0).astype(np.float32)), track
    return None
