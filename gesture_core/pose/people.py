"""Several people: told apart in one picture by part-affinity fields, and followed from frame to frame.

The field of a limb points from its first joint to its second wherever the limb is, so that a pair of peaks
belongs together as far as the field along the straight line between them points the same way (Cao et al.
2017, "Realtime Multi-Person 2D Pose Estimation using Part Affinity Fields").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gesture_core.pose.decode import LEAST_SCORE, find_peaks
from gesture_core.types import Person

# Of the assembly of people; the figures are OpenPose's where it names one.
ALONG = 0.05
"""Field strength that counts as "along the limb" at one sample."""
SHARE = 0.8
"""Share of samples on the line between two joints that must be along the limb."""
SAMPLES = 10
LEAST_JOINTS = 4
"""Joints of a person."""

LIMBS: dict[str, tuple[tuple[int, int], ...]] = {
    "coco18": (
        (1, 8), (8, 9), (9, 10), (1, 11), (11, 12), (12, 13), (1, 2), (2, 3), (3, 4), (2, 16),
        (1, 5), (5, 6), (6, 7), (5, 17), (1, 0), (0, 14), (0, 15), (14, 16), (15, 17),
    ),
    "body25": (
        (1, 8), (9, 10), (10, 11), (8, 9), (8, 12), (12, 13), (13, 14), (1, 2), (2, 3), (3, 4),
        (2, 17), (1, 5), (5, 6), (6, 7), (5, 18), (1, 0), (0, 15), (0, 16), (15, 17), (16, 18),
        (14, 19), (19, 20), (14, 21), (11, 22), (22, 23), (11, 24),
    ),
    "mpi15": (
        (0, 1), (1, 2), (2, 3), (3, 4), (1, 5), (5, 6), (6, 7), (1, 14), (14, 8), (8, 9), (9, 10),
        (14, 11), (11, 12), (12, 13),
    ),
}  # fmt: skip
"""Joints of each limb in the channel order of the fields: channels 2k (x) and 2k + 1 (y) are limb k's."""


def limb_scores(field: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(A, B) mean of the field along the lines from each of A `starts` to each of B `ends`.

    Zero where too few samples point along the line.

    Parameters
    ----------
    field : (2, h, w) array
    starts, ends : (A, 2) and (B, 2) arrays, x and y in cells
    """
    high, wide = field.shape[1:]
    step = ends[None] - starts[:, None]
    length = np.linalg.norm(step, axis=2)
    unit = step / np.maximum(length, 1e-6)[..., None]
    at = np.linspace(0, 1, SAMPLES, dtype=np.float32)
    line = starts[:, None, None] + step[:, :, None] * at[:, None]
    x = np.clip(np.rint(line[..., 0]).astype(np.intp), 0, wide - 1)
    y = np.clip(np.rint(line[..., 1]).astype(np.intp), 0, high - 1)
    along = field[0, y, x] * unit[..., None, 0] + field[1, y, x] * unit[..., None, 1]
    good = (along > ALONG).mean(axis=2) >= SHARE
    # Lines longer than half the picture are seldom limbs: OpenPose's own penalty.
    far = np.minimum(0.5 * max(high, wide) / np.maximum(length, 1e-6) - 1, 0)
    return np.where(good, np.maximum(along.mean(axis=2) + far, 0), 0)


def assemble(
    maps: np.ndarray, fields: np.ndarray, skeleton: str, floor: float
) -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """People in each picture of a batch, best first.

    Parameters
    ----------
    maps : (N, J, h, w) array
        Heat maps without the background.
    fields : (N, 2 L, h, w) array
        Part-affinity fields, channels as `LIMBS`.
    skeleton : str
        A key of `LIMBS`.
    floor : float
        Least height of a peak.

    Returns
    -------
    for each picture a list of (points (J, 2) in cells, scores (J,)); NaN and 0 where missing
    """
    picture, joint, points, scores = find_peaks(maps, floor)
    found = []
    for n in range(len(maps)):
        mine = np.nonzero(picture == n)[0]
        of_joint = [mine[joint[mine] == j] for j in range(maps.shape[1])]
        whole = []
        for person in _people(fields[n], points, scores, of_joint, LIMBS[skeleton]):
            has = person >= 0
            if has.sum() >= LEAST_JOINTS and scores[person[has]].mean() >= LEAST_SCORE:
                xy = np.full((len(person), 2), np.nan, np.float32)
                xy[has] = points[person[has]]
                score = np.zeros(len(person), np.float32)
                score[has] = scores[person[has]]
                whole.append((xy, score))
        found.append(sorted(whole, key=lambda one: -float(one[1].sum())))
    return found


def _people(
    fields: np.ndarray,
    points: np.ndarray,
    scores: np.ndarray,
    of_joint: list[np.ndarray],
    limbs: tuple[tuple[int, int], ...],
) -> list[np.ndarray]:
    """For each person a (J,) array of peak numbers, -1 where missing: limbs joined, strongest first."""
    edges: list[tuple[float, int, int, int, int]] = []
    for k, (a, b) in enumerate(limbs):
        starts, ends = of_joint[a], of_joint[b]
        if not len(starts) or not len(ends):
            continue
        strength = limb_scores(fields[2 * k : 2 * k + 2], points[starts], points[ends])
        first, second = np.nonzero(strength > 0)
        rank = strength[first, second] + 0.5 * scores[starts][first] + 0.5 * scores[ends][second]
        used: set[int] = set()  # each peak belongs to one limb of a kind
        for pair in np.argsort(-rank, kind="stable"):
            i, j = int(first[pair]), int(second[pair])
            p, q = int(starts[i]), int(ends[j])
            if not used & {p, q}:
                used |= {p, q}
                edges.append((float(strength[i, j]), a, p, b, q))
    people: list[np.ndarray] = []
    owner: dict[int, int] = {}
    for _, a, p, b, q in sorted(edges, key=lambda edge: -edge[0]):
        one, two = owner.get(p), owner.get(q)
        if one is None and two is None:
            person = np.full(len(of_joint), -1)
            person[[a, b]] = p, q
            owner[p] = owner[q] = len(people)
            people.append(person)
        elif one is not None and two is not None:
            if one == two or ((people[one] >= 0) & (people[two] >= 0)).any():
                continue
            people[one] = np.maximum(people[one], people[two])
            for peak in people[two][people[two] >= 0]:
                owner[int(peak)] = one
            people[two] = np.full(len(of_joint), -1)
        else:
            joined, new, place = (one, q, b) if one is not None else (two, p, a)
            if joined is not None and people[joined][place] < 0:
                people[joined][place] = new
                owner[new] = joined
    return [person for person in people if (person >= 0).any()]


@dataclass
class _Track:
    """One person so far: the numbers of the first and the last frame, the latest place of each joint, and how
    far the body moves from frame to frame.
    """

    first: int
    last: int
    latest: np.ndarray
    speed: np.ndarray = field(default_factory=lambda: np.zeros(2))
    points: list[np.ndarray] = field(default_factory=list)
    scores: list[np.ndarray] = field(default_factory=list)


class Tracker:
    """Joins the people of each frame into tracks over time, by the distance of the joints that both show.

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

    steadiness = 0.2
    """Share of the newest step in the speed of a track."""

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
            # Behind somebody else a person walks on.
            expected = track.latest + track.speed * min(self._frame - track.last, self.patience)
            for j, person in enumerate(people):
                cost[i, j] = _distance(expected, person.keypoints)
        track_of: dict[int, _Track] = {}
        for i, j in zip(*linear_sum_assignment(cost), strict=True):
            if cost[i, j] <= self.reach:
                track_of[int(j)] = self._open[i]
        for j, person in enumerate(people):
            if j not in track_of:
                track_of[j] = _Track(self._frame, self._frame, np.full((self.joints, 2), np.nan))
                self._open.append(track_of[j])
            track = track_of[j]
            missed = self._frame - track.first - len(track.points)
            track.points += [np.full((self.joints, 2), np.nan, np.float32)] * missed + [person.keypoints]
            track.scores += [np.zeros(self.joints, np.float32)] * missed + [person.scores]
            moved = (person.keypoints - track.latest) / max(self._frame - track.last, 1)
            if not np.isnan(moved).all():
                track.speed = track.speed + self.steadiness * (np.nanmedian(moved, axis=0) - track.speed)
            track.last = self._frame
            # A joint that is hidden now is remembered where it was last seen.
            track.latest = np.where(np.isnan(person.keypoints), track.latest, person.keypoints)
        self._frame += 1

    def tracks(self) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """(first frame, keypoints (T, J, 2), scores (T, J)) of each track, the largest sum first."""
        self._close(self._frame)
        return [
            (track.first, np.stack(track.points), np.stack(track.scores))
            for track in sorted(self._closed, key=lambda t: (-float(np.sum(t.scores)), t.first))
        ]

    def _close(self, before: int) -> None:
        """Set the tracks aside that were last seen before a frame."""
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
