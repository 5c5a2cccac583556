"""Follows one person through a video with a crop, so that a small network sees them large.

The first frame is searched: the whole picture, and where nobody is found for certain, overlapping
tiles of it. From then on a batch of frames shares one window around the body of the batch before,
wide enough for every reach of the arms. The search is repeated where the confidence drops.

A window is a view of the frame and an offset, so a backend needs to know nothing of it. The idea of
cropping around the last keypoints is MoveNet's (Google 2021); here the window follows the torso, which
moves little, and stays the same for a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesture_core.plugin.interfaces import Person, PoseBackend
from gesture_core.pose.body import Anatomy, Body, Window
from gesture_core.pose.contracts import ModelContract
from gesture_core.skeletons import skeleton


@dataclass(frozen=True)
class FollowRules:
    """How closely a person is followed.

    Attributes
    ----------
    size : float or None
        Side of the window over the reach of the body (raised hand to foot); None takes the one of
        the network's contract.
    sure : float
        Confidence from which a find needs no further search.
    lost : float
        Confidence below which the person is searched for again, as a share of the confidence so far.
    nobody : float
        Confidence below which nobody is there.
    tiles : tuple of float
        Sides of the tiles of the search over the shorter side of the picture.
    gain : float
        Confidence that a tile must add: a part of a large person may pass for a small one.
    zooms : int
        Times that a find is looked at again in a window of its own.
    rest : int
        Frames between two searches while nobody is found.
    doubt : int
        Frames after which a person of whom the network is not sure is searched for again.
    drift : float
        The window is moved once the body has moved or grown by this share of the window.
    """

    size: float | None = None
    sure: float = 0.65
    lost: float = 0.5
    nobody: float = 0.15
    tiles: tuple[float, ...] = (0.6,)
    gain: float = 0.1
    zooms: int = 2
    rest: int = 16
    doubt: int = 250
    drift: float = 0.08


class Follower:
    """Finds one person in each frame of a video, given in order.

    Parameters
    ----------
    backend : PoseBackend
    rules : FollowRules
    """

    def __init__(self, backend: PoseBackend, rules: FollowRules | None = None) -> None:
        self.backend = backend
        self.rules = rules or FollowRules()
        self.anatomy = Anatomy(skeleton(backend.skeleton))
        contract: ModelContract | None = getattr(backend, "contract", None)
        self.size: float = self.rules.size or (contract.crop if contract else ModelContract.crop)
        self.searches = 0
        self._window: Window | None = None
        self._level = 0.0
        self._resting = 0
        self._since = 0

    def estimate(self, frames: Sequence[np.ndarray]) -> list[Person | None]:
        """The person in each of ``frames``, (H, W, 3) uint8 in BGR, which follow those given before."""
        found: list[Person | None] = []
        while len(found) < len(frames):
            rest = frames[len(found) :]
            doubtful = self._level < self.rules.sure and self._since >= self.rules.doubt
            if self._window is None or doubtful:
                self._window = self._search(rest[0])
            people = self._look(rest, self._window)
            end = self._until_lost(people)
            if end == 0 and self._resting == 0:
                # Lost in the very first frame of this window: search, and take what comes.
                self._window = self._search(rest[0])
                people = self._look(rest, self._window)
                self._resting = self.rules.rest
                end = max(1, self._until_lost(people))
            kept = people[: end or len(people)]
            found += kept
            self._resting = max(0, self._resting - len(kept))
            self._since += len(kept)
            self._move(kept, frames[0])
        return found

    def _look(self, frames: Sequence[np.ndarray], window: Window) -> list[Person | None]:
        views = [window.view(frame) for frame in frames]
        return [window.back(found[0]) if found else None for found in self.backend.estimate(views)]

    def _until_lost(self, people: Sequence[Person | None]) -> int:
        """Number of leading frames in which the person is still there; all of them while resting."""
        if self._resting:
            return len(people)
        floor = max(self.rules.lost * self._level, self.rules.nobody)
        for i, person in enumerate(people):
            if self.anatomy.confidence(person) < floor:
                return i
        return len(people)

    def _move(self, people: Sequence[Person | None], frame: np.ndarray) -> None:
        """Set the window for the next frames, and the confidence that they are measured by."""
        assert self._window is not None
        level = float(np.mean([self.anatomy.confidence(person) for person in people]))
        self._level = 0.7 * self._level + 0.3 * level if self._level else level
        bodies = [body for person in people if (body := self.anatomy.body(person)) is not None]
        if not bodies or level < self.rules.nobody:
            return
        # The latest place, but the usual size: a person turning aside does not shrink. Medians,
        # so that one frame in which left and right are confused does not move the window.
        latest = bodies[len(bodies) // 2 :]
        x, y = (float(np.median([getattr(body, axis) for body in latest])) for axis in "xy")
        torso = float(np.median([body.torso for body in bodies]))
        wanted = self._around(Body(x, y, torso), frame)
        now = self._window
        slack = self.rules.drift * max(now.size)
        edges = zip(
            (wanted.left, wanted.top, wanted.right, wanted.bottom),
            (now.left, now.top, now.right, now.bottom),
            strict=True,
        )
        if any(abs(a - b) > slack for a, b in edges):
            self._window = wanted

    def _around(self, body: Body, frame: np.ndarray) -> Window:
        return Window.around(body, self.size, (frame.shape[1], frame.shape[0]))

    def _search(self, frame: np.ndarray) -> Window:
        """The window around the best person in the frame; the whole frame where nobody is."""
        self.searches += 1
        self._since = 0
        whole = Window.whole((frame.shape[1], frame.shape[0]))
        window, confidence = self._zoom(frame, whole)
        if self._window is not None and confidence < self.rules.sure:
            kept, before = self._zoom(frame, self._window)
            if before > confidence:
                window, confidence = kept, before
        if confidence < self.rules.sure:
            tiles = self._tiles(whole.size)
            views = [tile.view(frame) for tile in tiles]
            people = [found[0] if found else None for found in self.backend.estimate(views)]
            order = np.argsort([-self.anatomy.confidence(person) for person in people], kind="stable")
            for i in order[:3]:
                again, better = self._zoom(frame, tiles[int(i)])
                if better > confidence + self.rules.gain:
                    window, confidence = again, better
        self._level = confidence
        return window if confidence > 0 else whole

    def _zoom(self, frame: np.ndarray, window: Window) -> tuple[Window, float]:
        """Follow a find in `window` into a window of its own; the window with the highest confidence."""
        best, highest = window, 0.0
        for _ in range(self.rules.zooms + 1):
            person = self._look([frame], window)[0]
            confidence = self.anatomy.confidence(person)
            if confidence >= highest:
                best, highest = window, confidence
            body = self.anatomy.body(person)
            if body is None:
                break
            window = self._around(body, frame)
            if window == best:
                break
        return best, highest

    def _tiles(self, frame_size: tuple[int, int]) -> list[Window]:
        wide, high = frame_size
        found = []
        for share in self.rules.tiles:
            side = max(32, round(share * min(wide, high)))
            for top in _starts(high, side):
                for left in _starts(wide, side):
                    found.append(Window(left, top, min(left + side, wide), min(top + side, high)))
        return found


def _starts(length: int, side: int) -> list[int]:
    """Starts of tiles of `side` pixels that cover `length` and overlap by half."""
    if side >= length:
        return [0]
    steps = -(-2 * (length - side) // side)
    return [round(i * (length - side) / steps) for i in range(steps + 1)]
