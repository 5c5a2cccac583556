"""One place for every joint over time: which peak is the wrist, and which hand is the left one.

A network sees each frame by itself. Small ones confuse left and right for a few frames, or are a
little more certain of a chair's arm than of the person's. Both show in time: nobody's shoulders change
places between two frames, and no forearm is longer than the trunk. So the peaks of an arm, both own and
those of the other side, are chosen together for all frames: each frame has a cost for the scores and for
limbs that are too long, each step one for the way that the joints would have to go, and the cheapest
sequence wins (Viterbi 1967; on limbs Felzenszwalb and Huttenlocher 2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gesture_core.pose.follow import SHOULDERS
from gesture_core.skeletons import Skeleton
from gesture_core.types import Person

_BLOCK = 64
"""Frames whose states are listed at once."""
_SPAN = 31
"""Frames of the running median of the torso's length."""
# Parts of a limb, and how long its upper and lower half can look in torso lengths, after Drillis and
# Contini (1966), with a little room for the perspective of a near camera.
_LIMBS = ((("shoulder", "elbow", "wrist"), (0.65, 0.6)), (("hip", "knee", "ankle"), (1.1, 1.1)))


# Costs that decide the choice; lengths in torsos (shoulders to hips), times in seconds.
PEAKS, MIRRORED = 3, 2
"""Peaks of each joint that are considered, and of the same joint of the other side."""
SCORE = 1.5
"""Weight of the logarithm of a peak's score."""
OTHER_SIDE = 1.0
"""Cost of taking a peak that the network gave to the other side; where it confuses the shoulders or hips
too, that is one mistake, and it costs as much not to follow it."""
MISSING = 4.5
"""Cost of a joint that the network does not see, where the other side's peak would be near."""
NEAR, TOGETHER = 0.12, 3.0
"""Below this length the left and the right joint are in one place, which has this cost."""
SWAP = 0.5
"""Cost of exchanging left and right of the shoulders or hips that the network gave."""
FACE = 8.0
"""Cost of a back that is turned to the camera while a face is seen, times the face's score."""
TWIST = 3.0
"""Cost of hips that point the other way than the shoulders."""
SLACK, LONGEST = 0.1, 9.0
"""Length beyond that of a limb at which the cost is 1; it grows with the square, up to the second."""
STILL, SPEED, JUMP = 0.08, 4.0, 6.0
"""A joint may move by ``STILL + SPEED * seconds`` at a cost of 1; it grows with the square, to `JUMP`."""
WEIGHTS = (4.0, 2.0, 0.5)
"""Of that cost for shoulders and hips, elbows and knees, wrists and ankles."""
STATES = 24
"""The cheapest of each frame that are followed."""


class JointChoice:
    """Chooses the arms and legs of one person.

    Attributes
    ----------
    joints : list of int
        Those whose peaks are needed, in the order that `choose` takes them in.
    """

    def __init__(self, body: Skeleton) -> None:
        self._body = body
        self.joints: list[int] = []
        self._limbs: list[list[tuple[int, int]]] = []
        """(root, middle, end) of arms and of legs, each as (right, left)."""
        for parts, _ in _LIMBS:
            limb = [(body.index(f"right_{part}"), body.index(f"left_{part}")) for part in parts]
            self._limbs.append(limb)
            self.joints += [*limb[1], *limb[2]]

    def peaks_of(self, person: Person | None) -> np.ndarray:
        """(len(joints), PEAKS, 3): where each of `joints` may be; without peaks, where it is."""
        found = np.full((len(self.joints), PEAKS, 3), np.nan, np.float32)
        found[..., 2] = 0
        if person is not None:
            peaks = person.peaks
            if peaks is None:
                peaks = np.column_stack([person.keypoints, person.scores])[:, None]
            few = peaks[self.joints, :PEAKS]
            found[:, : few.shape[1]] = few
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
        torso = self._torso_lengths(points)
        if len(points) == 0 or np.isnan(torso).all():
            return points, scores
        face = scores[:, self._body.index("nose")] if "nose" in self._body.joints else scores[:, 0] * 0
        steps = STILL + SPEED * np.clip(np.diff(times), 0, 0.5)
        of_joint = {joint: peaks[:, i] for i, joint in enumerate(self.joints)}
        every = np.arange(len(points))
        across = None
        for (_, lengths), (root, middle, end) in zip(_LIMBS, self._limbs, strict=True):
            # (T, 2 ways, 2 sides, 2): as the network gave them, and exchanged.
            roots = np.stack([points[:, root], points[:, root[::-1]]], axis=1)
            away = np.nan_to_num(roots[:, :, 0, 0] - roots[:, :, 1, 0]) / torso[:, None]
            exchange = FACE * face[:, None] * np.clip(away / 0.3, 0, 1) + np.array([0.0, SWAP])
            if across is not None:  # hips against the line from the left to the right shoulder
                hips = roots[:, :, 0] - roots[:, :, 1]
                length = np.maximum(np.linalg.norm(across, axis=1), 1e-6)
                along = (hips * across[:, None]).sum(-1) / length[:, None]
                exchange += TWIST * np.nan_to_num(np.clip(-along / (0.3 * torso[:, None]), 0, 1))
            pools = [
                _Pool.of(of_joint[own], of_joint[other], torso)
                for pair in (middle, end)
                for own, other in (pair, pair[::-1])
            ]
            chosen = _Sequence(lengths, torso, roots, pools, exchange).cheapest(steps)
            way, *picks = np.unravel_index(chosen, (2, *[pool.costs.shape[2] for pool in pools]))
            points[:, root] = roots[every, way]
            turned = way == 1
            scores[np.ix_(turned, root)] = scores[np.ix_(turned, root[::-1])]
            for joint, pool, pick in zip((*middle, *end), pools, picks, strict=True):
                points[:, joint], scores[:, joint] = pool.points[every, pick], pool.scores[every, pick]
            across = points[:, root[0]] - points[:, root[1]]
        return points, scores

    def _torso_lengths(self, points: np.ndarray) -> np.ndarray:
        """(T,) length of the torso in each frame of (T, J, 2) keypoints, in pixels, smoothed over time.

        The larger of the distance from shoulders to hips and of what the width of the shoulders suggests, as
        a person who turns aside has not become smaller; a running median, the nearest value where nothing is
        seen. NaN throughout where it is never seen.
        """
        from scipy.ndimage import median_filter

        shoulders, hips = (points[:, limb[0]].astype(np.float64) for limb in self._limbs)
        down = np.linalg.norm(shoulders.mean(axis=1) - hips.mean(axis=1), axis=1)
        across = np.linalg.norm(shoulders[:, 0] - shoulders[:, 1], axis=1) / SHOULDERS
        length = np.fmax(down, 0.9 * across)
        seen = np.flatnonzero(length > 2)
        if not len(seen):
            return np.full(len(points), np.nan)
        every = np.interp(np.arange(len(points)), seen, length[seen])
        smooth: np.ndarray = median_filter(every, _SPAN, mode="nearest")
        return smooth


class _Pool(NamedTuple):
    """Where one joint may be: points (T, K, 2), scores (T, K), and costs (T, 2, K), infinite beyond the last.

    The second axis of the costs says whether left and right of the roots are exchanged.
    """

    points: np.ndarray
    scores: np.ndarray
    costs: np.ndarray

    @classmethod
    def of(cls, own: np.ndarray, other: np.ndarray, torso: np.ndarray) -> _Pool:
        """The pool of a joint from its own peaks (T, K, 3) and those of the other side's joint."""
        mine, theirs = own[:, :PEAKS], other[:, :MIRRORED]
        both = np.concatenate([mine, theirs], axis=1)
        points, scores = both[..., :2], np.nan_to_num(both[..., 2])
        costs = np.repeat(-SCORE * np.log(np.maximum(scores, 0.03))[:, None], 2, axis=1)
        costs[:, 0, mine.shape[1] :] += OTHER_SIDE
        costs[:, 1, : mine.shape[1]] += OTHER_SIDE
        none = np.isnan(points[..., 0])
        costs = np.where(none[:, None], np.inf, costs)
        # A peak in both maps is one place, at the lower of its costs.
        gaps = np.linalg.norm(theirs[:, None, :, :2] - mine[:, :, None, :2], axis=-1)
        same = (gaps < NEAR * torso[:, None, None])[:, None]
        own_costs, other_costs = np.split(costs, [mine.shape[1]], axis=2)
        dearer = own_costs[..., None] > other_costs[:, :, None]
        drop = np.concatenate([(same & dearer).any(axis=3), (same & ~dearer).any(axis=2)], axis=2)
        costs = np.where(drop, np.inf, costs)
        costs[none[:, 0], :, 0] = MISSING
        return cls(points, scores, costs)


class _Sequence(NamedTuple):
    """The choices for one pair of limbs over all frames.

    Parameters
    ----------
    lengths : two floats
        Of the upper and the lower part, in torso lengths.
    torso : (T,) array
        Pixels.
    roots : (T, 2, 2, 2) array
        Shoulders or hips, as (right, left), as the network gave them and exchanged.
    pools : four pools
        Right and left middle, right and left end.
    exchange : (T, 2) array
        Costs of leaving and of exchanging the roots.
    """

    lengths: tuple[float, float]
    torso: np.ndarray
    roots: np.ndarray
    pools: Sequence[_Pool]
    exchange: np.ndarray

    def cheapest(self, steps: np.ndarray) -> np.ndarray:
        """(T,) number of each frame's choice in the cheapest sequence; ``steps`` (T - 1,) are reaches."""
        frames = len(self.roots)
        sizes = [pool.costs.shape[2] for pool in self.pools]
        width = min(STATES, 2 * int(np.prod(sizes)))
        states = np.empty((frames, width), np.int32)
        before = np.zeros((frames, width), np.int16)
        weights = np.repeat(np.array(WEIGHTS), 2)
        total = np.zeros(0)
        last = np.zeros((0, width, 6, 2), self.roots.dtype)
        for start in range(0, frames, _BLOCK):
            at = slice(start, min(start + _BLOCK, frames))
            costs = self._costs(at).reshape(at.stop - start, -1)
            kept = np.argpartition(costs, width - 1, axis=1)[:, :width]
            states[at] = kept
            way, *picks = np.unravel_index(kept, (2, *sizes))
            each = np.arange(start, at.stop)[:, None]
            places = [self.roots[each, way, side] for side in (0, 1)]
            places += [pool.points[each, pick] for pool, pick in zip(self.pools, picks, strict=True)]
            joints = np.concatenate([last, np.stack(places, axis=2)])  # (1 + B, width, 6, 2)
            own = np.take_along_axis(costs, kept, axis=1)
            if start == 0:
                total, own = own[0], own[1:]
            later = np.arange(at.stop - len(own), at.stop)
            x, y = np.moveaxis(joints, -1, 0)
            moved = np.square(x[1:, None] - x[:-1, :, None]) + np.square(y[1:, None] - y[:-1, :, None])
            moved = moved / ((self.torso[later] * steps[later - 1]) ** 2)[:, None, None, None]
            # A joint that is missing before or after may have gone anywhere.
            ways = np.where(np.isnan(moved), 1.0, np.minimum(moved, JUMP)) @ weights
            for frame, on, cost in zip(later.tolist(), ways, own, strict=True):
                on += total[:, None]
                before[frame] = on.argmin(axis=0)
                total = on.min(axis=0) + cost
            last = joints[-1:]
            total = total - total.min()
        best = np.empty(frames, np.intp)
        state = int(total.argmin())
        for frame in range(frames - 1, -1, -1):
            best[frame] = states[frame, state]
            state = int(before[frame, state])
        return best

    def _costs(self, at: slice) -> np.ndarray:
        """(B, 2, M, M, E, E) costs of every choice in the frames ``at``."""
        torso, root = self.torso[at], self.roots[at]
        points = [pool.points[at] for pool in self.pools]
        costs = [pool.costs[at] for pool in self.pools]
        limbs = []
        for side in (0, 1):
            middle, end = points[side], points[2 + side]
            upper = self._too_long(root[:, :, side, None] - middle[:, None], self.lengths[0], torso)
            lower = self._too_long(middle[:, :, None] - end[:, None], self.lengths[1], torso)
            upper += costs[side]
            limbs.append(upper[:, :, :, None] + (lower[:, None] + costs[2 + side][:, :, None]))
        # Axes: the way of the roots, right and left middle, right and left end.
        total: np.ndarray = limbs[0][:, :, :, None, :, None] + limbs[1][:, :, None, :, None, :]
        for right, axes in ((0, (1, 4, 5)), (2, (1, 2, 3))):  # left and right in one place
            gaps = np.linalg.norm(points[right][:, :, None] - points[right + 1][:, None], axis=-1)
            near = np.where(gaps < NEAR * torso[:, None, None], TOGETHER, 0.0)
            total += np.expand_dims(near, axes)
        total += self.exchange[at][:, :, None, None, None, None]
        return total

    def _too_long(self, gaps: np.ndarray, length: float, torso: np.ndarray) -> np.ndarray:
        """Costs of limbs from joint to joint, ``gaps`` (B, ..., 2); a missing joint costs a little."""
        excess = np.linalg.norm(gaps, axis=-1) / torso.reshape(-1, *[1] * (gaps.ndim - 2)) - length
        cost = np.minimum(np.square(np.maximum(excess, 0) / SLACK), LONGEST)
        costs: np.ndarray = np.nan_to_num(cost, nan=1.0)
        return costs
