"""One clip of numbered frames with the people in each: to sequences, whatever format they come from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import Person, PoseSequence
from gesture_pose_files.files import MAX_FRAMES
from gesture_pose_files.json_people import Found
from gesture_pose_files.layout import are_shares, by_count, sequence
from gesture_pose_files.people import left_out, tracks
from gesture_pose_files.reader import with_lost
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
    said : collection of int
        Numbers of joints whose order the format itself says.
    """

    source: str
    reader: str
    numbers: list[int] = field(default_factory=list)
    frames: list[Found] = field(default_factory=list)
    lost: list[KeypointError] = field(default_factory=list)
    said: Collection[int] = ()

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
        self, options: ReadOptions, people: str, size: tuple[int, int] | None = None
    ) -> list[PoseSequence]:
        """One sequence, or one for each person where ``people`` is ``"multi"``.

        ``size`` is that of the picture where the file tells it.

        Raises
        ------
        KeypointError
            That of the first frame where none can be read, `E_KEYPOINTS_FORMAT` where the layout changes,
            `E_KEYPOINTS_TIMES`, `E_KEYPOINTS_VALUE`.
        """
        if self.lost and len(self.lost) == len(self.frames):
            raise self.lost[0]
        joints = self._one_layout()
        numbers = np.array(self.numbers, np.float64)
        notes = sorted({note for frame in self.frames for note in frame.notes})
        every = [one for frame in self.frames for one in frame.people]
        shares = False
        if every:
            points = np.stack([one.keypoints for one in every])
            scores, note = in_unit(np.stack([one.scores for one in every]), points, self.source)
            notes += [note] if note else []
            shares = are_shares(points, centred=True)
            every = [Person(*pair) for pair in zip(points, scores, strict=True)]
        rest = iter(every)
        frames = [[next(rest) for _ in frame.people] for frame in self.frames]
        identities = [frame.identities for frame in self.frames]
        notes += left_out(frames, people, identities)
        found = [
            sequence(
                points,
                options,
                source=self.source,
                reader=self.reader,
                scores=scores,
                numbers=numbers,
                body=by_count(options)[joints] if joints in self.said else None,
                axes=None if options.axes == "yx" else "xy",
                unit="shares" if shares else "pixels",
                frame_size=size,
                person=person,
                notes=notes,
            )
            for person, (points, scores) in enumerate(tracks(frames, joints, people, identities))
        ]
        return [with_lost(one, self.lost) for one in found]

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
