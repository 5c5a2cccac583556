"""Size and place of a body from its keypoints: what the crop around a person is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.plugin.interfaces import Person
from gesture_core.pose.sighting import moved
from gesture_core.skeletons import Skeleton

# Rough proportions of an adult in torso lengths (shoulders to hips; cf. Drillis and Contini 1966): a raised
# hand ends 1.5 above the shoulders, the feet 2.8 below them; the shoulders are 0.75 wide. How far a
# joint may lie from the middle of the shoulders has some room on top, because the torso is judged by
# two or four joints.
ABOVE, BELOW = 1.5, 2.8
_FARTHEST = {"nose": 1.0, "head_top": 1.3, "neck": 0.5, "elbow": 1.2, "wrist": 2.0, "hip": 1.6}
REACH = ABOVE + BELOW
SHOULDERS = 0.75


@dataclass(frozen=True)
class Body:
    """Where a body is, in pixels: the middle of all that it can reach, its torso length, its shoulders."""

    x: float
    y: float
    torso: float
    shoulders: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Window:
    """A rectangle of whole pixels, half open."""

    left: int
    top: int
    right: int
    bottom: int

    @classmethod
    def around(cls, body: Body, size: float, frame_size: tuple[int, int]) -> Window:
        """The square of `size` times the body's reach around it, as far as it lies in the frame."""
        half = 0.5 * size * REACH * body.torso
        wide, high = frame_size
        least = min(_LEAST, wide, high)
        left = int(np.clip(round(body.x - half), 0, wide - least))
        top = int(np.clip(round(body.y - half), 0, high - least))
        right = int(np.clip(round(body.x + half), left + least, wide))
        bottom = int(np.clip(round(body.y + half), top + least, high))
        # Even sides are halved exactly, and so fast, where the view is scaled down.
        right, bottom = right - (right - left) % 2, bottom - (bottom - top) % 2
        return cls(left, top, max(right, left + 1), max(bottom, top + 1))

    @classmethod
    def whole(cls, frame_size: tuple[int, int]) -> Window:
        """All of the frame."""
        return cls(0, 0, *frame_size)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height)"""
        return self.right - self.left, self.bottom - self.top

    def view(self, frame: np.ndarray) -> np.ndarray:
        """That part of the frame; no pixel is copied."""
        return frame[self.top : self.bottom, self.left : self.right]

    def back(self, person: Person) -> Person:
        """A person found in `view`, in pixels of the frame."""
        return moved(person, (self.left, self.top))


_LEAST = 32
"""Pixels: nobody can be recognised in less."""


class Anatomy:
    """The joints of a skeleton that say where a body is."""

    def __init__(self, skeleton: Skeleton) -> None:
        self._shoulders = [skeleton.index("right_shoulder"), skeleton.index("left_shoulder")]
        self._hips = [skeleton.index("right_hip"), skeleton.index("left_hip")]
        parts = [joint.removeprefix("left_").removeprefix("right_") for joint in skeleton.joints]
        reach = {**_FARTHEST, "shoulder": np.inf}
        self._upper = [i for i, part in enumerate(parts) if part in reach]
        self._reach = np.array([reach[parts[i]] for i in self._upper])

    def confidence(self, person: Person | None) -> float:
        """Mean score of head, arms and hips, 0 for nobody.

        Joints that no body of this size could reach do not count: some networks are as sure of a
        wrist on the far wall as of one on an arm.
        """
        body = self.body(person)
        if person is None or body is None:
            return 0.0
        scores = person.scores[self._upper]
        away = np.linalg.norm(person.keypoints[self._upper] - body.shoulders, axis=1) / body.torso
        return float(np.where(away <= self._reach, scores, 0).mean())

    def body(self, person: Person | None) -> Body | None:
        """The body of a person, None where no shoulder was found.

        Without hips the torso is judged by the shoulders, and the body is taken to be upright.
        """
        if person is None:
            return None
        points = person.keypoints
        shoulders, hips = points[self._shoulders], points[self._hips]
        seen = ~np.isnan(shoulders[:, 0])
        if not seen.any():
            return None
        middle = shoulders[seen].mean(0)
        across = float(np.linalg.norm(shoulders[0] - shoulders[1])) if seen.all() else 0.0
        torso, down = across / SHOULDERS, np.array([0.0, 1.0])
        if not np.isnan(hips[:, 0]).all():
            line = np.nanmean(hips, axis=0) - middle
            length = float(np.linalg.norm(line))
            # A person who bends forward or turns aside has not become smaller: the larger of both.
            if length > 0.5 * torso:
                torso, down = max(length, torso), line / max(length, 1e-6)
        if torso < 2:
            return None
        centre = middle + down * torso * (BELOW - ABOVE) / 2
        return Body(float(centre[0]), float(centre[1]), torso, (float(middle[0]), float(middle[1])))


_SPAN = 31
"""Frames of the running median of `torso_lengths`."""


def torso_lengths(points: np.ndarray, body: Skeleton) -> np.ndarray:
    """(T,) length of the torso in each frame of (T, J, 2) keypoints, in pixels, steady over time.

    The larger of shoulders to hips and what the width of the shoulders says of it, as a person who turns
    aside has not become smaller; a running median, the nearest value where nothing is seen. NaN
    throughout where it is never seen.
    """
    from scipy.ndimage import median_filter

    shoulders, hips = (
        points[:, [body.index(f"right_{part}"), body.index(f"left_{part}")]].astype(np.float64)
        for part in ("shoulder", "hip")
    )
    down = np.linalg.norm(shoulders.mean(axis=1) - hips.mean(axis=1), axis=1)
    across = np.linalg.norm(shoulders[:, 0] - shoulders[:, 1], axis=1) / SHOULDERS
    length = np.fmax(down, 0.9 * across)
    seen = np.flatnonzero(length > 2)
    if not len(seen):
        return np.full(len(points), np.nan)
    every = np.interp(np.arange(len(points)), seen, length[seen])
    steady: np.ndarray = median_filter(every, _SPAN, mode="nearest")
    return steady
