"""Joins the people found in each frame into tracks over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gesture_core.plugin.interfaces import Person


@dataclass
class _Track:
    first: int
    last: int
    points: list[np.ndarray] = field(default_factory=list)
    scores: list[np.ndarray] = field(default_factory=list)
    latest: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))


class Tracker:
    """Assigns people to tracks, frame by frame, by the mean distance of the joints that both show.

    Parameters
    ----------
    joints : int
    reach : float
        A person continues a track within this distance, in units of the person's extent.
    patience : int
        Frames for which a track may be unseen and still go on.
    shortest : int
        Tracks seen in fewer frames are dropped as false finds.
    """

    def __init__(self, joints: int, reach: float = 0.35, patience: int = 15, shortest: int = 5) -> None:
        self.joints = joints
        self.reach = reach
        self.patience = patience
        self.shortest = shortest
        self._frame = 0
        self._open: list[_Track] = []
        self._closed: list[_Track] = []

    def add(self, people: Sequence[Person]) -> None:
        """Take the people of the next frame."""
        from scipy.optimize import linear_sum_assignment

        self._close(self._frame - self.patience)
        cost = np.full((len(self._open), len(people)), 1e6)
        for i, track in enumerate(self._open):
            for j, person in enumerate(people):
                cost[i, j] = _distance(track.latest, person.keypoints)
        taken = set()
        rows, columns = linear_sum_assignment(cost)
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
            if cost[i, j] <= self.reach:
                self._extend(self._open[i], people[j])
                taken.add(j)
        for j, person in enumerate(people):
            if j not in taken:
                track = _Track(self._frame, self._frame, latest=np.full((self.joints, 2), np.nan))
                self._open.append(track)
                self._extend(track, person)
        self._frame += 1

    def tracks(self) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """(first frame, keypoints (T, J, 2), scores (T, J)) of each track, the largest sum first."""
        self._close(self._frame)
        return [
            (track.first, np.stack(track.points), np.stack(track.scores))
            for track in sorted(self._closed, key=lambda t: (-float(np.sum(t.scores)), t.first))
        ]

    def _extend(self, track: _Track, person: Person) -> None:
        missed = self._frame - track.first - len(track.points)
        track.points += [np.full((self.joints, 2), np.nan, np.float32)] * missed + [person.keypoints]
        track.scores += [np.zeros(self.joints, np.float32)] * missed + [person.scores]
        track.last = self._frame
        # A joint that is hidden now is remembered where it was last seen.
        track.latest = np.where(np.isnan(person.keypoints), track.latest, person.keypoints)

    def _close(self, before: int) -> None:
        over = [track for track in self._open if track.last < before]
        self._open = [track for track in self._open if track.last >= before]
        shortest = min(self.shortest, self._frame)
        self._closed += [t for t in over if sum(s.any() for s in t.scores) >= shortest]


def _distance(one: np.ndarray, two: np.ndarray) -> float:
    """Mean distance of common joints over the extent of the larger person; large where none is common."""
    common = ~np.isnan(one[:, 0]) & ~np.isnan(two[:, 0])
    if not common.any():
        return 1e6
    extent = max(float(np.nanmax(np.ptp(p[~np.isnan(p[:, 0])], axis=0))) for p in (one, two))
    return float(np.linalg.norm(one[common] - two[common], axis=1).mean()) / max(extent, 1.0)
