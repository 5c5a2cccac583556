"""Follows one person through a video with a square of their own, turned so that they stand upright in it.

A network such as BlazePose (Bazarevsky et al. 2020) sees nothing but this square, and says where the next
one lies: around the middle of the body, as wide as the body can reach. Where the network says that nobody is
in it, another network searches the whole frame.

What it says of a frame jitters, and the next square with it; both are smoothed as MediaPipe does, by what is
known so far, so that a recording and a live stream give the same keypoints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.plugin.abilities import RegionFollowing
from gesture_core.pose.follow import PAUSE, Anatomy, Body, Follower, Frame
from gesture_core.skeletons import COCO18, mapped, skeleton
from gesture_core.types import Person

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import PoseBackend

ROOM = 1.25
"""Side of the square over the diameter of the circle around the body, as BlazePose was trained with."""
REACH = 1.75
"""Radius of that circle in torso lengths: the median of what BlazePose says in 3,300 frames."""
_FARTHEST = 1e5
"""Pixels."""
# Cutoff at rest in Hz, and how far it rises with the speed, in body sizes a second: MediaPipe's own figures.
JOINTS, CIRCLE = (0.05, 80.0), (0.01, 10.0)
_SPEED = 1.0
"""Cutoff of the speed itself, in Hz."""
LOOKS = 3
"""Times that a find is looked at, each time in the region that follows from it."""
AGREED = 0.45
"""Median distance in torso lengths between the joints of both networks up to which they see the same body. On
drawn shapes and clouds that BlazePose takes for a person three times it is 0.7 to 1.9, on most people 0.1."""
BELIEVED = 0.5
"""Probability that a person is there which the network of the search must give to that body."""


@dataclass(frozen=True)
class Region:
    """A square of a frame: its centre and side in pixels, and how far it is turned clockwise, in radians."""

    x: float
    y: float
    side: float
    angle: float = 0.0

    @classmethod
    def around(cls, middle: np.ndarray, top: np.ndarray) -> Region | None:
        """The square around a circle, from its middle and its top as the person stands; None for none.

        Nor for one that no picture can show: a network may give any number.
        """
        if not np.abs([middle, top]).max() < _FARTHEST:  # NaN neither
            return None
        up = top - middle
        radius = float(np.hypot(*up))
        if not radius > 2:
            return None
        x, y = middle.tolist()
        return cls(x, y, 2 * ROOM * radius, float(np.arctan2(up[0], -up[1])))

    @classmethod
    def of(cls, body: Body) -> Region | None:
        """The square of a body that another network found, and that is taken to stand upright."""
        shoulders = np.array(body.shoulders)
        down = np.array([0.0, body.torso])
        return cls.around(shoulders + down, shoulders + down - REACH * down)

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

        if self.side > 4 * pixels:  # thin limbs would fall between the samples
            half = replace(self, x=self.x / 2 - 0.25, y=self.y / 2 - 0.25, side=self.side / 2)
            size = max(frame.shape[1] // 2, 1), max(frame.shape[0] // 2, 1)
            return half.view(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), pixels)
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        picture: np.ndarray = cv2.warpAffine(frame, self._onto_frame(pixels), (pixels, pixels), flags=how)
        return picture

    def back(self, person: Person, pixels: int) -> Person:
        """A person found in `view`, in pixels of the frame."""
        onto = self._onto_frame(pixels)

        def back(points: np.ndarray) -> np.ndarray:
            moved: np.ndarray = points @ onto[:, :2].T + onto[:, 2]
            return moved.astype(np.float32)

        region = None if person.region is None else back(person.region)
        depth = None if person.depth is None else person.depth * np.float32(self.side / pixels)
        return replace(person, keypoints=back(person.keypoints), region=region, depth=depth)


_USUAL_GAP = 1 / 30
"""Seconds between two frames that have the same time."""


class OneEuro:
    """A low pass that opens with the speed of what it smooths (Casiez, Roussel and Vogel 2012).

    Parameters
    ----------
    least : float
        Cutoff of what stands still, in Hz.
    rise : float
        By how much the cutoff rises for each size that is covered in a second.
    """

    def __init__(self, least: float, rise: float) -> None:
        self._least, self._rise = least, rise
        self._time = -np.inf
        self._raw = self._smooth = np.array(np.nan)
        self._speed = np.array(0.0)

    def __call__(self, time: float, values: np.ndarray, size: float) -> np.ndarray:
        """``values`` of a second, smoothed; NaN stays NaN, and what comes after it is taken as it is."""
        gap, self._time = time - self._time, time
        gap = gap if gap > 0 else _USUAL_GAP  # a clock that stands still, or steps back, stops nothing
        speed = (values - self._raw) / size / max(gap, 1e-3)
        self._speed = self._speed + _share(_SPEED, gap) * (np.nan_to_num(speed) - self._speed)
        step = _share(self._least + self._rise * np.abs(self._speed), gap) * (values - self._smooth)
        self._raw, self._smooth = values, np.where(np.isnan(step), values, self._smooth + step)
        return self._smooth


def _share(cutoff: float | np.ndarray, gap: float) -> float | np.ndarray:
    """Of a new value in what a low pass says, ``gap`` seconds after the last one."""
    return 1 - 1 / (1 + 2 * np.pi * cutoff * gap)


class RegionFollower:
    """Finds one person in each frame of a video, given in order."""

    def __init__(self, backend: PoseBackend) -> None:
        assert isinstance(backend, RegionFollowing)
        self.backend = backend
        self.searches = 0
        self._finder = Follower(backend.finder())
        self._anatomy = Anatomy(COCO18)
        self._region: Region | None = None
        self._pause = 0
        self._wait = 0
        self._joints, self._circle = OneEuro(*JOINTS), OneEuro(*CIRCLE)

    def estimate(self, frames: Sequence[Frame]) -> list[Person | None]:
        """The person in each of ``frames``, which follow those given before."""
        return [self._next(*frame) for frame in frames]

    def _next(self, time: float, frame: np.ndarray) -> Person | None:
        person = self._look(frame, self._region)
        if person is None and self._wait == 0:
            person = self._search(frame)
            self._joints, self._circle = OneEuro(*JOINTS), OneEuro(*CIRCLE)
            # Searched for at once, then ever more seldom.
            self._pause = min(2 * self._pause + 1, PAUSE) if person is None else 0
            self._wait = self._pause
        elif person is None:
            self._wait -= 1
        if person is not None:
            person = self._smoothed(person, time)
        self._region = around(person)
        return person

    def _smoothed(self, person: Person, time: float) -> Person:
        """A person without jitter, in a square that does not jitter either."""
        if person.region is None:
            return person
        size = max(2 * float(np.hypot(*(person.region[1] - person.region[0]))), 1.0)
        depth = () if person.depth is None else (person.depth,)
        joints = self._joints(time, np.column_stack([person.keypoints, *depth]), size)
        return replace(
            person,
            keypoints=joints[:, :2],
            region=self._circle(time, person.region, size),
            depth=joints[:, 2] if depth else None,
        )

    def _search(self, frame: np.ndarray) -> Person | None:
        """The person in a frame of which nothing is known; nobody is found who is not confirmed."""
        self.searches += 1
        high, wide = frame.shape[:2]
        body = self._finder.search(frame)
        regions = [Region((wide - 1) / 2, (high - 1) / 2, max(wide, high))]
        if body is not None and (region := Region.of(body)):
            regions.insert(0, region)
        return next((person for region in regions if (person := self._confirmed(frame, region))), None)

    def _confirmed(self, frame: np.ndarray, region: Region) -> Person | None:
        """The person in a region, if they are still there in those that follow, and both networks agree."""
        found: Region | None = region
        person: Person | None = None
        for _ in range(LOOKS):
            person = self._look(frame, found)
            found = around(person)
        return person if person and self._agreed(frame, person) else None

    def _agreed(self, frame: np.ndarray, person: Person) -> bool:
        """Whether the network of the search sees the same body in a window of its own."""
        own = _in_coco18(person, self.backend)
        body = self._anatomy.body(own)
        other = self._finder.look_at(frame, body) if body else None
        if body is None or other is None or other.presence < BELIEVED:
            return False
        away = np.linalg.norm(_in_coco18(other, self._finder.backend).keypoints - own.keypoints, axis=1)
        known = away[~np.isnan(away)]
        return bool(len(known) and np.median(known) <= AGREED * body.torso)

    def _look(self, frame: np.ndarray, region: Region | None) -> Person | None:
        if region is None:
            return None
        pixels = self.backend.region
        people = self.backend.estimate([region.view(frame, pixels)])[0]
        return region.back(people[0], pixels) if people else None


def around(person: Person | None) -> Region | None:
    """The next square of a person."""
    return None if person is None or person.region is None else Region.around(*person.region)


def _in_coco18(person: Person, backend: PoseBackend) -> Person:
    own = skeleton(backend.skeleton)
    points, scores = mapped(person.keypoints[None], person.scores[None], own, COCO18)
    return Person(points[0], scores[0])
