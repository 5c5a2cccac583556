"""One place for every joint over time: which peak is the wrist, and which hand is the left one.

A network sees each frame by itself. Small ones confuse left and right for a few frames, or are a
little surer of a chair's arm than of the person's. Both show in time: nobody's shoulders change places
between two frames, and no forearm is longer than the trunk. So the peaks of an arm, both own and
those of the other side, are chosen together for all frames: each frame has a cost for the scores and for
limbs that are too long, each step one for the way that the joints would have to go, and the cheapest
sequence wins (Viterbi 1967; on limbs Felzenszwalb and Huttenlocher 2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesture_core.plugin.interfaces import Person
from gesture_core.pose.body import torso_lengths
from gesture_core.pose.sighting import Sighting
from gesture_core.skeletons import Skeleton

_BLOCK = 256
"""Frames whose states are listed at once."""


@dataclass(frozen=True)
class SteadyRules:
    """What speaks for a choice; lengths in torsos (shoulders to hips), times in seconds.

    Attributes
    ----------
    peaks : int
        Of each joint that are considered, and of the same joint of the other side `mirrored` of them.
    mirrored : int
    score : float
        Weight of the logarithm of a peak's score.
    other_side : float
        Cost of taking a peak that the network gave to the other side; where it confuses the shoulders or
        hips too, that is one mistake, and it costs as much not to follow it.
    missing : float
        Cost of a joint that the network does not see, where the other side's peak would be near.
    together : float
        Cost of putting the left and the right joint into one place, nearer than `near`.
    near : float
    swap : float
        Cost of exchanging left and right of the shoulders or hips that the network gave.
    face : float
        Cost of a back that is turned to the camera while a face is seen, times the face's score.
    twist : float
        Cost of hips that point the other way than the shoulders.
    slack : float
        Length beyond that of a limb at which the cost is 1; it grows with the square, to `most`.
    most : float
    still, speed : float
        A joint may move by ``still + speed * seconds`` at a cost of 1; it grows with the square, to `jump`.
    jump : float
    weights : three floats
        Of that cost for shoulders and hips, elbows and knees, wrists and ankles.
    states : int
        The cheapest of each frame that are followed.
    """

    peaks: int = 3
    mirrored: int = 2
    score: float = 1.5
    other_side: float = 1.0
    missing: float = 4.5
    together: float = 3.0
    near: float = 0.12
    swap: float = 0.5
    face: float = 8.0
    twist: float = 3.0
    slack: float = 0.1
    most: float = 9.0
    still: float = 0.08
    speed: float = 4.0
    jump: float = 6.0
    weights: tuple[float, float, float] = (4.0, 2.0, 0.5)
    states: int = 24


@dataclass(frozen=True)
class _Limbs:
    """A pair of limbs: joints as (right, left), and how long the upper and the lower part can look."""

    root: tuple[int, int]
    middle: tuple[int, int]
    end: tuple[int, int]
    lengths: tuple[float, float]


# Lengths after Drillis and Contini (1966), with a little room for the perspective of a near camera.
_PAIRS = (
    (("shoulder", "elbow", "wrist"), (0.65, 0.6)),
    (("hip", "knee", "ankle"), (1.1, 1.1)),
)


def _limbs(body: Skeleton, names: tuple[str, ...], lengths: tuple[float, float]) -> _Limbs | None:
    pairs = [(f"right_{name}", f"left_{name}") for name in names]
    if not all(joint in body.joints for pair in pairs for joint in pair):
        return None
    root, middle, end = ((body.index(right), body.index(left)) for right, left in pairs)
    return _Limbs(root, middle, end, lengths)


@dataclass(frozen=True)
class _Pool:
    """Where one joint may be: points (T, K, 2), scores (T, K), and costs (T, 2, K), infinite beyond the last.

    The second axis of the costs says whether left and right of the roots are exchanged.
    """

    points: np.ndarray
    scores: np.ndarray
    costs: np.ndarray


class Steady:
    """Chooses the limbs of one person.

    Parameters
    ----------
    body : Skeleton
        Limbs that it lacks are left alone.
    rules : SteadyRules
    """

    def __init__(self, body: Skeleton, rules: SteadyRules | None = None) -> None:
        self.rules = rules or SteadyRules()
        self._limbs = [limbs for pair in _PAIRS if (limbs := _limbs(body, *pair)) is not None]
        self._body = body
        self.joints = tuple(j for limbs in self._limbs for j in (*limbs.middle, *limbs.end))
        """Joints whose peaks are needed, in the order that `choose` takes them in."""

    def peaks_of(self, person: Person | None) -> np.ndarray:
        """(len(joints), rules.peaks, 3): where each of `joints` may be; of a plain `Person`, where it is."""
        found = np.full((len(self.joints), self.rules.peaks, 3), np.nan, np.float32)
        found[..., 2] = 0
        if person is None:
            return found
        if isinstance(person, Sighting):
            peaks = person.peaks[list(self.joints), : self.rules.peaks]
        else:
            peaks = np.column_stack([person.keypoints, person.scores])[list(self.joints), None]
        found[:, : peaks.shape[1]] = peaks
        return found

    def choose(
        self, points: np.ndarray, scores: np.ndarray, peaks: np.ndarray, times: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The keypoints with every limb where time and body say that it is.

        Parameters
        ----------
        points : (T, J, 2) array
            As the network gave them, NaN where missing.
        scores : (T, J) array
        peaks : (T, len(joints), K, 3) array
            x, y and score of the peaks of each of `joints`, the highest first, NaN beyond the last.
        times : (T,) array
            Seconds, not descending.

        Returns
        -------
        points, scores
            New arrays of the same shapes.
        """
        points, scores = np.array(points, np.float32), np.array(scores, np.float32)
        torso = torso_lengths(points, self._body)
        if len(points) == 0 or np.isnan(torso).all():
            return points, scores
        face = scores[:, self._body.index("nose")] if "nose" in self._body.joints else scores[:, 0] * 0
        steps = self.rules.still + self.rules.speed * np.clip(np.diff(times), 0, 0.5)
        of_joint = {joint: peaks[:, i] for i, joint in enumerate(self.joints)}
        shoulders = None
        for limbs in self._limbs:
            _Choice(limbs, self.rules, torso, steps).apply(points, scores, of_joint, face, shoulders)
            shoulders = limbs.root
        return points, scores


class _Choice:
    """The choice for one pair of limbs over a whole sequence."""

    def __init__(self, limbs: _Limbs, rules: SteadyRules, torso: np.ndarray, steps: np.ndarray) -> None:
        self.limbs = limbs
        self.rules = rules
        self.torso = torso
        self.steps = steps

    def apply(
        self,
        points: np.ndarray,
        scores: np.ndarray,
        peaks: dict[int, np.ndarray],
        face: np.ndarray,
        shoulders: tuple[int, int] | None,
    ) -> None:
        """Write the chosen joints into ``points`` and ``scores``; ``shoulders`` are those chosen before."""
        limbs = self.limbs
        right, left = limbs.root
        # (T, 2 ways, 2 sides, 2): as the network gave them, and exchanged.
        roots = np.stack([points[:, [right, left]], points[:, [left, right]]], axis=1)
        pools = [
            self._pool(peaks[own], peaks[other])
            for pair in (limbs.middle, limbs.end)
            for own, other in (pair, pair[::-1])
        ]
        exchange = self._exchange(roots, face)
        if shoulders is not None:
            exchange += self._twisted(roots, points[:, shoulders[0]] - points[:, shoulders[1]])
        chosen = self._cheapest(roots, pools, exchange)
        every = np.arange(len(points))
        way, *picks = np.unravel_index(chosen, (2, *(pool.costs.shape[2] for pool in pools)))
        points[:, [right, left]] = roots[every, way]
        turned = way == 1
        scores[np.ix_(turned, [right, left])] = scores[np.ix_(turned, [left, right])]
        for joint, pool, pick in zip((*limbs.middle, *limbs.end), pools, picks, strict=True):
            points[:, joint], scores[:, joint] = pool.points[every, pick], pool.scores[every, pick]

    def _pool(self, own: np.ndarray, other: np.ndarray) -> _Pool:
        rules = self.rules
        mine, theirs = own[:, : rules.peaks], other[:, : rules.mirrored]
        both = np.concatenate([mine, theirs], axis=1)
        points, scores = both[..., :2], np.nan_to_num(both[..., 2])
        costs = np.repeat(-rules.score * np.log(np.maximum(scores, 0.03))[:, None], 2, axis=1)
        costs[:, 0, mine.shape[1] :] += rules.other_side
        costs[:, 1, : mine.shape[1]] += rules.other_side
        none = np.isnan(points[..., 0])
        costs = np.where(none[:, None], np.inf, costs)
        # A peak in both maps is one place, at the lower of its costs.
        gaps = np.linalg.norm(theirs[:, None, :, :2] - mine[:, :, None, :2], axis=-1)
        same = (gaps < rules.near * self.torso[:, None, None])[:, None]
        own_costs, other_costs = np.split(costs, [mine.shape[1]], axis=2)
        dearer = own_costs[..., None] > other_costs[:, :, None]
        drop = np.concatenate([(same & dearer).any(axis=3), (same & ~dearer).any(axis=2)], axis=2)
        costs = np.where(drop, np.inf, costs)
        costs[none[:, 0], :, 0] = rules.missing
        return _Pool(points, scores, costs)

    def _exchange(self, roots: np.ndarray, face: np.ndarray) -> np.ndarray:
        """(T, 2) costs of leaving and of exchanging the roots."""
        away = np.nan_to_num(roots[:, :, 0, 0] - roots[:, :, 1, 0]) / self.torso[:, None]
        turned = self.rules.face * face[:, None] * np.clip(away / 0.3, 0, 1)
        costs: np.ndarray = turned + np.array([0.0, self.rules.swap])
        return costs

    def _twisted(self, roots: np.ndarray, across: np.ndarray) -> np.ndarray:
        """(T, 2) costs of roots against the line from the left to the right shoulder, ``across`` (T, 2)."""
        hips = roots[:, :, 0] - roots[:, :, 1]
        along = (hips * across[:, None]).sum(-1) / np.maximum(np.linalg.norm(across, axis=1), 1e-6)[:, None]
        against = np.clip(-along / (0.3 * self.torso[:, None]), 0, 1)
        costs: np.ndarray = self.rules.twist * np.nan_to_num(against)
        return costs

    def _too_long(self, gaps: np.ndarray, length: float, torso: np.ndarray) -> np.ndarray:
        """Costs of limbs from joint to joint, ``gaps`` (B, ..., 2); a missing joint costs a little."""
        excess = np.linalg.norm(gaps, axis=-1) / torso.reshape(-1, *[1] * (gaps.ndim - 2)) - length
        cost = np.minimum(np.square(np.maximum(excess, 0) / self.rules.slack), self.rules.most)
        return np.nan_to_num(cost, nan=1.0)

    def _costs(
        self, roots: np.ndarray, pools: Sequence[_Pool], exchange: np.ndarray, at: slice
    ) -> np.ndarray:
        """(B, 2, M, M, E, E) costs of every choice in the frames ``at``."""
        torso, root = self.torso[at], roots[at]
        points = [pool.points[at] for pool in pools]
        costs = [pool.costs[at] for pool in pools]
        limbs = []
        for side in (0, 1):
            middle, end = points[side], points[2 + side]
            upper = self._too_long(root[:, :, side, None] - middle[:, None], self.limbs.lengths[0], torso)
            lower = self._too_long(middle[:, :, None] - end[:, None], self.limbs.lengths[1], torso)
            upper += costs[side]
            limbs.append(upper[:, :, :, None] + (lower[:, None] + costs[2 + side][:, :, None]))
        # Axes: the way of the roots, right and left middle, right and left end.
        total = limbs[0][:, :, :, None, :, None] + limbs[1][:, :, None, :, None, :]
        total += self._together(points[0], points[1], torso)[:, None, :, :, None, None]
        total += self._together(points[2], points[3], torso)[:, None, None, None, :, :]
        return total + exchange[at][:, :, None, None, None, None]

    def _together(self, right: np.ndarray, left: np.ndarray, torso: np.ndarray) -> np.ndarray:
        gaps = np.linalg.norm(right[:, :, None] - left[:, None], axis=-1)
        return np.where(gaps < self.rules.near * torso[:, None, None], self.rules.together, 0.0)

    def _cheapest(self, roots: np.ndarray, pools: Sequence[_Pool], exchange: np.ndarray) -> np.ndarray:
        """(T,) number of the choice in each frame, of the cheapest sequence."""
        frames = len(roots)
        sizes = [pool.costs.shape[2] for pool in pools]
        width = min(self.rules.states, 2 * int(np.prod(sizes)))
        states = np.empty((frames, width), np.int32)
        before = np.zeros((frames, width), np.int16)
        weights = np.repeat(np.array(self.rules.weights), 2)
        total = np.zeros(0)
        last = np.zeros((0, 6, 2))
        for start in range(0, frames, _BLOCK):
            at = slice(start, min(start + _BLOCK, frames))
            costs = self._costs(roots, pools, exchange, at).reshape(at.stop - start, -1)
            kept = np.argpartition(costs, width - 1, axis=1)[:, :width]
            states[at] = kept
            way, *picks = np.unravel_index(kept, (2, *sizes))
            each = np.arange(start, at.stop)[:, None]
            places = [roots[each, way, side] for side in (0, 1)]
            places += [pool.points[each, pick] for pool, pick in zip(pools, picks, strict=True)]
            joints = np.stack(places, axis=2)  # (B, width, 6, 2)
            own = np.take_along_axis(costs, kept, axis=1)
            for i in range(len(kept)):
                frame = start + i
                if frame == 0:
                    total = own[0]
                else:
                    gaps = joints[i][None] - last[:, None]
                    moved = np.square(gaps).sum(-1) / (self.torso[frame] * self.steps[frame - 1]) ** 2
                    # A joint that is missing before or after may have gone anywhere.
                    steps = np.nan_to_num(np.minimum(moved, self.rules.jump), nan=1.0) @ weights
                    steps += total[:, None]
                    before[frame] = steps.argmin(axis=0)
                    total = steps.min(axis=0) + own[i]
                last = joints[i]
            total = total - total.min()
        best = np.empty(frames, np.intp)
        state = int(total.argmin())
        for frame in range(frames - 1, -1, -1):
            best[frame] = states[frame, state]
            state = int(before[frame, state])
        return best
