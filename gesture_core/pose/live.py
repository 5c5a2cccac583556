"""Keypoints of one person in a stream of frames, frame by frame as they come."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.plugin.interfaces import Person, PoseBackend
from gesture_core.pose.extract import follower_of, is_steady
from gesture_core.pose.temporal import JointChoice
from gesture_core.skeletons import skeleton
from gesture_core.types import PoseSequence

if TYPE_CHECKING:
    from gesture_core.pose.parts import Parts

MEMORY = 0.7
"""Seconds of frames together with which the limbs of the newest one are chosen."""


class LivePose:
    """What `extract_poses` does with the best person of a whole video, without the frames to come.

    Parameters
    ----------
    backend : PoseBackend
    follow, steady, parts : optional
        As in `extract_poses`.
    source : str
        What to call the input.
    """

    def __init__(
        self,
        backend: PoseBackend,
        *,
        follow: bool | None = None,
        steady: bool | None = None,
        parts: Parts | None = None,
        source: str = "",
    ) -> None:
        self._backend, self._parts, self._source = backend, parts, source
        self._skeleton = parts.skeleton.name if parts else backend.skeleton
        self._body = skeleton(backend.skeleton)
        self._follower = follower_of(backend, follow)
        steady = is_steady(backend) if steady is None else steady
        self._choice = JointChoice(self._body) if steady else None
        self._recent: deque[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = deque()

    def push(self, time: float, frame: np.ndarray) -> PoseSequence:
        """The person in the next frame, (H, W, 3) uint8 in BGR, at its second: a sequence of one frame."""
        person = self._find(time, frame)
        joints = len(self._body.joints)
        points = np.full((joints, 2), np.nan) if person is None else person.keypoints
        scores = np.zeros(joints) if person is None else person.scores
        if self._choice:
            self._recent.append((time, points, scores, self._choice.peaks_of(person)))
            while self._recent[0][0] < time - MEMORY:
                self._recent.popleft()
            times, where, certain, peaks = (np.stack(part) for part in zip(*self._recent, strict=True))
            chosen, sure = self._choice.choose(where, certain, peaks, times)
            points, scores = chosen[-1], sure[-1]
        size = (frame.shape[1], frame.shape[0])
        at, depth = np.array([time]), None if person is None or person.depth is None else person.depth[None]
        if self._parts:
            fine = self._parts.find(frame, person)
            points, scores = self._parts.beside(points, scores, fine.keypoints, fine.scores)
            depth = None if depth is None else self._parts.depth(depth)
        name = self._skeleton
        return PoseSequence(points[None], scores[None], at, name, size, 0, self._source, depth=depth)

    def _find(self, time: float, frame: np.ndarray) -> Person | None:
        if self._follower:
            return self._follower.estimate([(time, frame)])[0]
        people = self._backend.estimate([frame])[0]
        return people[0] if people else None
