"""Follows one person through a video with a crop, so that a small network sees them large.

The first frame is searched: the whole picture, and where nobody is found for certain, overlapping
tiles of it. A find counts where somebody is seen in other cuts around it as well. From then on a batch of
frames shares one window around the body of the batch before, wide enough for every reach of the arms. The
search is repeated where the confidence drops.

A window is a view of the frame and an offset, so a backend needs to know nothing of it. The idea of
cropping around the last keypoints is MoveNet's (Google 2021); here the window follows the torso, which
moves little, and stays the same for a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import dist, isnan
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.plugin.abilities import CropFollowing, PresenceLimit
from gesture_core.pose.contract import ModelContract
from gesture_core.skeletons import Skeleton, skeleton
from gesture_core.types import Person

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import PoseBackend

Frame = tuple[float, np.ndarray]
"""Seconds, and a picture (H, W, 3) uint8 in BGR."""

# Rough proportions of an adult in torso lengths (shoulders to hips; cf. Drillis and Contini 1966): a raised
# hand ends 1.5 above the shoulders, the feet 2.8 below them; the shoulders are 0.75 wide. How far a
# joint may lie from the middle of the shoulders has some room on top, because the torso is judged by
# two or four joints.
ABOVE, BELOW = 1.5, 2.8
REACH = ABOVE + BELOW
SHOULDERS = 0.75
_FARTHEST = {
    "nose": 1.0, "head_top": 1.3, "neck": 0.5, "shoulder": np.inf, "elbow": 1.2, "wrist": 2.0, "hip": 1.6
}  # fmt: skip
_LEAST = 32
"""Pixels: nobody can be recognised in less."""
_INPUT = 192
"""Pixels of a side of a small network's input, down to which a view is halved."""

# Confidences are mean scores in 0..1.
CERTAIN = 0.65
"""Confidence from which a find needs no further search."""
LOST = 0.5
"""Confidence below which the person is searched for again, as a share of the confidence so far."""
NOBODY = 0.15
"""Confidence below which nobody is there."""
TILE = 0.6
"""Side of the tiles of the search over the shorter side of the picture."""
GAIN = 0.1
"""Confidence that a tile must add: a part of a large person may pass for a small one."""
ZOOMS = 2
"""Times that a find is looked at again in a window of its own."""
CUTS = (0.7, 0.85, 1.2)
"""A find that is less than certain to be a person is looked at again, mirrored and in windows around the body
of these sides over the usual one."""
STRICTER = 0.6
"""Exponent of the least presence that those cuts must have on average: 0.66 where a person needs 0.5."""
PAUSE = 16
"""Frames between two searches while nobody is found."""
RECHECK = 250
"""Frames after which a person of whom the network is not certain is searched for again."""
DRIFT = 0.08
"""The window is moved once the body has moved or grown by this share of the window."""


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
        # Even sides are halved exactly, and so fast, where the view is scaled down: large ones repeatedly.
        even = 2 ** max(1, (max(right - left, bottom - top) // _INPUT).bit_length() - 1)
        right, bottom = right - (right - left) % even, bottom - (bottom - top) % even
        return cls(left, top, max(right, left + 1), max(bottom, top + 1))

    def view(self, frame: np.ndarray) -> np.ndarray:
        """That part of the frame; no pixel is copied."""
        return frame[self.top : self.bottom, self.left : self.right]

    def back(self, person: Person) -> Person:
        """A person found in `view`, in pixels of the frame."""
        offset = np.array((self.left, self.top, 0), np.float32)
        peaks = None if person.peaks is None else person.peaks + offset
        return replace(person, keypoints=person.keypoints + offset[:2], peaks=peaks)


class Anatomy:
    """The joints of a skeleton that say where a body is."""

    def __init__(self, layout: Skeleton) -> None:
        self._shoulders = [layout.index("right_shoulder"), layout.index("left_shoulder")]
        self._hips = [layout.index("right_hip"), layout.index("left_hip")]
        self._upper: list[int] = []
        self._farthest: list[float] = []
        for i, joint in enumerate(layout.joints):
            part = joint.removeprefix("left_").removeprefix("right_")
            if part in _FARTHEST:
                self._upper.append(i)
                self._farthest.append(_FARTHEST[part])

    # A frame's few joints are reckoned with as plain numbers: an array operation on two of them takes longer
    # than all of this.

    def confidence(self, person: Person | None) -> float:
        """Mean score of head, arms and hips, 0 for nobody.

        Joints that no body of this size could reach do not count: some networks are as sure of a
        wrist on the far wall as of one on an arm.
        """
        body = self.body(person)
        if person is None or body is None:
            return 0.0
        joints = zip(
            person.keypoints[self._upper].tolist(),
            person.scores[self._upper].tolist(),
            self._farthest,
            strict=True,
        )
        near = [score for joint, score, far in joints if dist(joint, body.shoulders) <= far * body.torso]
        return float(sum(near)) / len(self._upper)

    def body(self, person: Person | None) -> Body | None:
        """The body of a person, None where no shoulder was found.

        Without hips the torso is judged by the shoulders, and the body is taken to be upright.
        """
        if person is None:
            return None
        shoulders = person.keypoints[self._shoulders].tolist()
        middle, hips = _middle(shoulders), _middle(person.keypoints[self._hips].tolist())
        if middle is None:
            return None
        across = dist(*shoulders)
        torso, down = 0.0 if isnan(across) else across / SHOULDERS, (0.0, 1.0)
        if hips is not None:
            length = dist(middle, hips)
            # A person who bends forward or turns aside has not become smaller: the larger of both.
            if length > 0.5 * torso:
                torso, down = max(length, torso), (hips[0] - middle[0], hips[1] - middle[1])
                down = down[0] / max(length, 1e-6), down[1] / max(length, 1e-6)
        if torso < 2:
            return None
        away = torso * (BELOW - ABOVE) / 2
        return Body(middle[0] + down[0] * away, middle[1] + down[1] * away, torso, middle)


def _middle(points: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """The middle of those points that are known, None of none."""
    known = [point for point in points if not isnan(point[0])]
    if not known:
        return None
    across, down = zip(*known, strict=True)
    return sum(across) / len(known), sum(down) / len(known)


class Follower:
    """Finds one person in each frame of a video, given in order."""

    def __init__(self, backend: PoseBackend) -> None:
        self.backend = backend
        self.anatomy = Anatomy(skeleton(backend.skeleton))
        self.size = backend.crop if isinstance(backend, CropFollowing) else ModelContract.crop
        least = backend.presence if isinstance(backend, PresenceLimit) else 0.5
        self._needed: float = least**STRICTER
        self.searches = 0
        self._window: Window | None = None
        self._level = 0.0
        self._known = False
        self._pause = 0
        self._since_search = 0

    def estimate(self, frames: Sequence[Frame]) -> list[Person | None]:
        """The person in each of ``frames``, which follow those given before."""
        found: list[Person | None] = []
        pictures = [picture for _, picture in frames]
        while len(found) < len(pictures):
            rest = pictures[len(found) :]
            uncertain = self._level < CERTAIN and self._since_search >= RECHECK
            if self._window is None or uncertain:
                self._window = self._search(rest[0])
            people = self._believed(rest, self._window)
            end = self._until_lost(people)
            if end == 0:  # lost in the very first frame of this window: search, and accept the result
                self._window = self._search(rest[0])
                people = self._believed(rest, self._window)
                self._pause = PAUSE
                end = len(people)
            found += people[:end]
            self._pause = max(0, self._pause - end)
            self._since_search += end
            self._window = self._moved(self._window, people[:end], pictures[0])
        return found

    def search(self, frame: np.ndarray) -> Body | None:
        """The best body in a picture of its own, None where nobody is found."""
        self._window = None
        return self.anatomy.body(self._look([frame], self._search(frame))[0])

    def look_at(self, frame: np.ndarray, body: Body) -> Person | None:
        """What the backend sees in the window around a body that is known from elsewhere."""
        window = Window.around(body, self.size, (frame.shape[1], frame.shape[0]))
        return self._look([frame], window)[0]

    def _look(self, frames: Sequence[np.ndarray], window: Window) -> list[Person | None]:
        found = self.backend.estimate([window.view(frame) for frame in frames])
        return [window.back(people[0]) if people else None for people in found]

    def _believed(self, frames: Sequence[np.ndarray], window: Window) -> list[Person | None]:
        """What is seen in a window; nobody where nobody was known so far and other cuts show nobody."""
        people = self._look(frames, window)
        for i, person in enumerate(people):
            if person and not self._known and person.presence < 1:
                self._known = self._stands(frames[i], window, person)
                people[i] = person if self._known else None
        return people

    def _stands(self, frame: np.ndarray, window: Window, person: Person) -> bool:
        """Whether somebody is seen in other cuts around a person who was found in a window as well."""
        body, size = self.anatomy.body(person), (frame.shape[1], frame.shape[0])
        if body is None:
            return False
        views = [Window.around(body, cut * self.size, size).view(frame) for cut in CUTS]
        views.append(np.ascontiguousarray(window.view(frame)[:, ::-1]))
        seen = [people[0].presence if people else 0.0 for people in self.backend.estimate(views)]
        return sum(seen) >= len(seen) * self._needed

    def _until_lost(self, people: Sequence[Person | None]) -> int:
        """Number of leading frames in which the person is still there; all of them during a pause."""
        floor = max(LOST * self._level, NOBODY)
        for i, person in enumerate(people):
            if not self._pause and self.anatomy.confidence(person) < floor:
                return i
        return len(people)

    def _moved(self, window: Window, people: Sequence[Person | None], frame: np.ndarray) -> Window:
        """The window for the next frames; sets the confidence that they are measured by."""
        level = float(np.mean([self.anatomy.confidence(person) for person in people]))
        self._level = 0.7 * self._level + 0.3 * level if self._level else level
        bodies = [body for person in people if (body := self.anatomy.body(person)) is not None]
        if not bodies or level < NOBODY:
            return window
        # The latest place, but the usual size: a person turning aside does not shrink. Medians,
        # so that one frame in which left and right are confused does not move the window.
        places = np.array([(body.x, body.y, body.torso) for body in bodies])
        x, y = np.median(places[len(places) // 2 :, :2], axis=0)
        body = Body(float(x), float(y), float(np.median(places[:, 2])))
        wanted = Window.around(body, self.size, (frame.shape[1], frame.shape[0]))
        slack = DRIFT * max(window.right - window.left, window.bottom - window.top)
        moved = (
            abs(wanted.left - window.left),
            abs(wanted.top - window.top),
            abs(wanted.right - window.right),
            abs(wanted.bottom - window.bottom),
        )
        return wanted if max(moved) > slack else window

    def _search(self, frame: np.ndarray) -> Window:
        """The window around the best person in the frame; the whole frame where nobody is."""
        self.searches += 1
        self._since_search = 0
        high, wide = frame.shape[:2]
        whole = Window(0, 0, wide, high)
        window, confidence = self._zoom(frame, whole)
        if self._window is not None and confidence < CERTAIN:
            kept, before = self._zoom(frame, self._window)
            if before > confidence:
                window, confidence = kept, before
        if confidence < CERTAIN:
            side = max(_LEAST, round(TILE * min(wide, high)))
            tiles = [
                Window(left, top, min(left + side, wide), min(top + side, high))
                for top in _starts(high, side)
                for left in _starts(wide, side)
            ]
            seen = self.backend.estimate([tile.view(frame) for tile in tiles])
            levels = [self.anatomy.confidence(people[0] if people else None) for people in seen]
            for i in np.argsort(np.negative(levels), kind="stable")[:3]:
                again, better = self._zoom(frame, tiles[i])
                if better > confidence + GAIN:
                    window, confidence = again, better
        self._level, self._known = confidence, confidence > 0
        return window if confidence > 0 else whole

    def _zoom(self, frame: np.ndarray, window: Window) -> tuple[Window, float]:
        """Look again at a person found in `window`, in a window of their own; the best, its confidence.

        The confidence is 0 where other cuts of the best window show nobody.
        """
        best, highest, found = window, 0.0, None
        for _ in range(ZOOMS + 1):
            person = self._look([frame], window)[0]
            confidence = self.anatomy.confidence(person)
            if confidence >= highest:
                best, highest, found = window, confidence, person
            body = self.anatomy.body(person)
            if body is None:
                break
            window = Window.around(body, self.size, (frame.shape[1], frame.shape[0]))
            if window == best:
                break
        known = found is None or found.presence == 1 or self._stands(frame, best, found)
        return best, highest if known else 0.0


def _starts(length: int, side: int) -> list[int]:
    """Starts of tiles of `side` pixels that cover `length` and overlap by half."""
    if side >= length:
        return [0]
    steps = -(-2 * (length - side) // side)
    return [round(i * (length - side) / steps) for i in range(steps + 1)]
