"""Follows one person through a video with a square of their own, turned so that they stand upright in it.

A network such as BlazePose (Bazarevsky et al. 2020) sees nothing but this square. It lies around the hips of
the frame before, is as wide as the body can reach, and follows in every frame. Where the network says that
nobody is in it, another network searches the whole frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gesture_core.plugin.interfaces import Person, RegionFollowing
from gesture_core.pose.follow import PAUSE, Follower
from gesture_core.skeletons import skeleton

SIDE = 4.35
"""Side of the square in torso lengths (middle of the shoulders to middle of the hips): the median of the
squares that BlazePose's own auxiliary points ask for, in 3,300 frames; half of them lie within 2 % of it."""


@dataclass(frozen=True)
class Region:
    """A square of a frame: its centre and side in pixels, and how far it is turned clockwise, in radians."""

    x: float
    y: float
    side: float
    angle: float = 0.0

    @classmethod
    def around(cls, hips: np.ndarray, shoulders: np.ndarray) -> Region | None:
        """The square of a body, from the middle of its hips and of its shoulders; None where they are one."""
        up = shoulders - hips
        torso = float(np.hypot(*up))
        if not torso > 2:
            return None
        return cls(float(hips[0]), float(hips[1]), SIDE * torso, float(np.arctan2(up[0], -up[1])))

    def _onto_frame(self, pixels: int) -> np.ndarray:
        """(2, 3) affine map from the square, seen in so many pixels, to the frame."""
        step = self.side / pixels
        cos, sin = step * np.cos(self.angle), step * np.sin(self.angle)
        turn = np.array([[cos, -sin], [sin, cos]])
        middle = (pixels - 1) / 2
        return np.column_stack([turn, (self.x, self.y) - turn @ (middle, middle)])

    def view(self, frame: np.ndarray, pixels: int) -> np.ndarray:
        """(pixels, pixels, 3) picture of the square; what lies outside the frame is black."""
        import cv2

        while self.side > 4 * pixels:  # thin limbs would fall between the samples
            return replace(self, x=self.x / 2, y=self.y / 2, side=self.side / 2).view(
                cv2.resize(frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), pixels
            )
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        picture: np.ndarray = cv2.warpAffine(frame, self._onto_frame(pixels), (pixels, pixels), flags=how)
        return picture

    def back(self, person: Person, pixels: int) -> Person:
        """A person found in `view`, in pixels of the frame."""
        onto = self._onto_frame(pixels)
        points = person.keypoints @ onto[:, :2].T + onto[:, 2]
        return replace(person, keypoints=points.astype(np.float32))


class RegionFollower:
    """Finds one person in each frame of a video, given in order."""

    def __init__(self, backend: RegionFollowing) -> None:
        self.backend = backend
        self.searches = 0
        self._finder = Follower(backend.finder)
        layout = skeleton(backend.skeleton)
        self._shoulders = [layout.index(f"{side}_shoulder") for side in ("left", "right")]
        self._hips = [layout.index(f"{side}_hip") for side in ("left", "right")]
        self._region: Region | None = None
        self._pause = 0
        self._wait = 0

    def estimate(self, frames: Sequence[np.ndarray]) -> list[Person | None]:
        """The person in each of ``frames``, (H, W, 3) uint8 in BGR, which follow those given before."""
        return [self._next(frame) for frame in frames]

    def _next(self, frame: np.ndarray) -> Person | None:
        person = self._look(frame, self._region)
        if person is None and self._wait == 0:
            person = self._search(frame)
            # Searched for at once, then ever more seldom.
            self._pause = min(2 * self._pause + 1, PAUSE) if person is None else 0
            self._wait = self._pause
        elif person is None:
            self._wait -= 1
        self._region = self._around(person)
        return person

    def _search(self, frame: np.ndarray) -> Person | None:
        """The person in a frame of which nothing is known; a find is looked at again in its own region."""
        self.searches += 1
        high, wide = frame.shape[:2]
        body = self._finder.search(frame)
        regions = [Region((wide - 1) / 2, (high - 1) / 2, max(wide, high))]
        if body is not None:
            shoulders = np.array(body.shoulders)
            region = Region.around(shoulders + np.array([0, body.torso]), shoulders)
            regions = [region, *regions] if region else regions
        for region in regions:
            person = self._look(frame, region)
            if person is not None:
                return self._look(frame, self._around(person)) or person
        return None

    def _look(self, frame: np.ndarray, region: Region | None) -> Person | None:
        if region is None:
            return None
        pixels = self.backend.region
        people = self.backend.estimate([region.view(frame, pixels)])[0]
        return region.back(people[0], pixels) if people else None

    def _around(self, person: Person | None) -> Region | None:
        if person is None:
            return None
        points = person.keypoints
        return Region.around(points[self._hips].mean(0), points[self._shoulders].mean(0))
