"""One clip of numbered frames with the people in each: to sequences, whatever format they come from."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.plugin.interfaces import Person
from gesture_core.types import PoseSequence
from gesture_pose_files.files import MAX_FRAMES
from gesture_pose_files.json_people import Found
from gesture_pose_files.layout import (
    BY_COUNT,
    are_shares,
    assumed_picture,
    assumed_rate,
    check_seconds,
)
from gesture_pose_files.people import tracks
from gesture_pose_files.scores import in_unit

# A frame with other joints than most is damaged; where more than this share is, the clip is two clips.
_MOST_ODD = 0.1


@dataclass
class Clip:
    """Frames in the order of their numbers.

    Attributes
    ----------
    source, reader : str
        The input as the user named it, and the plugin that reads it.
    numbers : list of int
        Of the frames, ascending.
    frames : list of Found
        An empty one where the frame cannot be read.
    lost : list of KeypointError
        Why frames cannot be read.
    """

    source: str
    reader: str
    numbers: list[int] = field(default_factory=list)
    frames: list[Found] = field(default_factory=list)
    lost: list[KeypointError] = field(default_factory=list)

    def add(self, number: int, found: Found | KeypointError) -> None:
        """A further frame, or why it cannot be read; then it counts as one in which nobody was found.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_FORMAT` where there is a frame of this number.
        """
        if self.numbers and self.numbers[-1] == number:
            raise KeypointError(
                f"has two frames with the number {number}",
                subject=self.source,
                remedy="one folder for each clip",
                code="E_KEYPOINTS_FORMAT",
            )
        self.numbers.append(number)
        if isinstance(found, KeypointError):
            self.lost.append(found)
            found = Found()
        self.frames.append(found)

    def fill(self) -> None:
        """Put empty frames where numbers are left out, for formats that leave out frames without people."""
        steps = np.diff(self.numbers)
        step = int(np.median(steps)) if len(steps) else 0
        if not step or (steps % step).any() or steps.sum() // step >= MAX_FRAMES:
            return
        known = dict(zip(self.numbers, self.frames, strict=True))
        self.numbers = list(range(self.numbers[0], self.numbers[-1] + 1, step))
        self.frames = [known.get(number, Found()) for number in self.numbers]

    def sequences(
        self,
        fps: float,
        people: str,
        frame_size: tuple[int, int],
        size: tuple[int, int] | None = None,
    ) -> list[PoseSequence]:
        """One sequence, or one for each person where ``people`` is ``"multi"``.

        ``size`` is that of the picture where the file tells it; ``frame_size`` what is assumed otherwise.

        Raises
        ------
        KeypointError
            That of the first frame where none can be read, `E_KEYPOINTS_FORMAT` where the layout changes,
            `E_KEYPOINTS_TIMES`, `E_KEYPOINTS_VALUE`.
        """
        if self.lost and len(self.lost) == len(self.frames):
            raise self.lost[0]
        joints = self._one_layout()
        body = BY_COUNT[joints]
        times = np.array(self.numbers, np.float64) / fps
        check_seconds(times, self.source, remedy="frame numbers that count frames, or --set pose.fps=…")
        notes = sorted({note for frame in self.frames for note in frame.notes})
        every = [one for frame in self.frames for one in frame.people]
        provenance = {
            "reader": self.reader,
            "times": f"frame numbers at {fps:g} frames/s",
            "assumed": assumed_rate(fps),
        }
        if every:
            points = np.stack([one.keypoints for one in every])
            scores, note = in_unit(np.stack([one.scores for one in every]), points, self.source)
            notes += [note] if note else []
            if are_shares(points):
                used = size or frame_size
                points = points * np.array(used, np.float32)
                provenance["scaled"] = f"shares of {used[0]} x {used[1]} pixels"
                provenance["assumed"] += "" if size else f", {assumed_picture(used)}"
            every = [Person(*pair) for pair in zip(points, scores, strict=True)]
        if self.lost:
            provenance["lost"] = (
                f"{len(self.lost)} of {len(self.frames)} frames cannot be read: {self.lost[0].message}"
            )
        if notes:
            provenance["notes"] = "; ".join(notes)
        rest = iter(every)
        frames = [[next(rest) for _ in frame.people] for frame in self.frames]
        identities = [frame.identities for frame in self.frames]
        return [
            PoseSequence(points, scores, times, body.name, size, person, self.source, provenance)
            for person, (points, scores) in enumerate(tracks(frames, joints, people, identities))
        ]

    def _one_layout(self) -> int:
        """The number of joints of nearly all frames; the others count as lost."""
        counts = Counter(frame.joints for frame in self.frames if frame.joints)
        if not counts:
            return 25
        joints, _ = counts.most_common(1)[0]
        odd = [index for index, frame in enumerate(self.frames) if frame.joints not in (0, joints)]
        for index in odd:
            error = KeypointError(
                f"frame {self.numbers[index]} has {self.frames[index].joints} joints, others have {joints}",
                subject=self.source,
                code="E_KEYPOINTS_FORMAT",
            )
            if len(odd) > _MOST_ODD * sum(counts.values()):
                raise error
            self.lost.append(error)
            self.frames[index] = Found()
        return joints
