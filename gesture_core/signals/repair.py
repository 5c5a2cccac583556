"""Frames that a pose network or a file got wrong: joints that jump and come back, left taken for right.

One such frame is the largest velocity of a clip and would decide its label. A frame is wrong only where
time says so, and by bodies rather than by data sets: a joint is not thrown off its way by a third of the
trunk and back again between frames that lie less than a tenth of a second apart (a rejection of outliers
after Hampel 1974, over runs of frames), and the two hands do not change places in one frame and again in
another (a choice over time, Viterbi 1967, as `gesture_core.pose.temporal` makes it among the peaks of a
network). A sequence in which nothing is wrong passes bit by bit.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gesture_core.skeletons import skeleton
from gesture_core.types import PoseSequence

SHOULDERS = 0.75
"""Width of the shoulders in torso lengths, for a body whose hips are not seen or that bends forward."""
JUMP = 0.3
"""Torso lengths (about 15 cm) beyond the way between the frames before and after that a joint must have gone
out and back; of 150,000 frames of 30 people of MSRC-12 one in a thousand wrists goes half as far."""
END = 2.0
"""Times as far, at the first and last frames, where nothing tells what was before or came after."""
REACH = 2.0
"""Torso lengths in a tenth of a second that no joint goes, however much a file trembles."""
NOISE, USUAL = 2.5, 70
"""Times a step that so many per cent of the steps around do not exceed; that far trembling may go."""
SCALE = 90
"""Times the change of the torso's length that so many per cent of the steps do not exceed, and the distance
from the neck: files that measure each frame by its own shoulders tremble like that."""
AROUND = 1.0
"""Seconds on each side of a frame whose steps are its usual ones."""
LEAST_SURE = 0.5
"""A jump needs as much less as the joint's score is below its median, down to this share."""
LONGEST = 0.4
"""Seconds from the last right frame to the next one; more is no single fault."""
TENTH = 0.1
"""Seconds between frames from which on `JUMP` grows with them, and what tells of an exchange fades."""
SWAP = 0.3
"""Torso lengths that exchanging a pair must save at each end of the frames in which it is exchanged."""
SWAPPED = 1.0
"""Torso lengths that each second of an exchange must save besides."""
_RUN = 8
"""Wide steps after the way out of which one may be the way back."""
_ROUNDING = 1e-3
_CELLS = 1 << 16
"""Frames times joints that are looked at together, so that hours need no more memory than minutes."""


_APART = 20.0
"""Times as far from the median of its channel as all but `_FEW` of the others."""
_FEW = 0.02
_RINGING = 2.0
"""Times as far as these, beside what is apart: a sensor that is hit swings, one that fails does not."""
_SAME = 1e-3
"""Of a full scale, by which two channels that show it may differ."""


class Repair(NamedTuple):
    """A sequence and in how many of its frames something was repaired."""

    pose: PoseSequence
    frames: int


def readings_apart(values: np.ndarray) -> np.ndarray:
    """Which (T, D) readings of channels, NaN where missing, a sensor did not mean: a full scale, a lost bit.

    They are far from all others of their channel, and at most two in a row: what three show is a movement, as
    is what rings before or after, and a tap that several channels feel, each in its own way: a packet that
    failed has the same number in all of them. A channel whose other readings are all the same tells nothing.
    """
    with np.errstate(invalid="ignore"):
        away = np.abs(values - _medians(values))
    away = np.where(np.isfinite(away), away, 0)
    usual = np.sort(away, axis=0)[-(max(1, int(_FEW * len(away))) + 1) :][0]
    apart: np.ndarray = (away > _APART * usual) & (usual > 0)
    unusual = np.pad(away > _RINGING * usual, ((1, 1), (0, 0)))
    middle = unusual[1:-1] & unusual[:-2] & unusual[2:]
    near = np.pad(middle, ((1, 1), (0, 0)))
    apart &= ~(apart & (near[:-2] | near[1:-1] | near[2:])).any(axis=0)
    apart[_felt_by_several(np.abs(values), unusual[1:-1])] = False
    return apart


def _felt_by_several(sizes: np.ndarray, unusual: np.ndarray) -> np.ndarray:
    """(T,) bool: samples in which several channels are unusual, mostly by (T, D) ``sizes`` of their own."""
    found = np.flatnonzero(unusual.sum(axis=1) > 1)
    own = np.sort(np.where(unusual[found], sizes[found], np.nan), axis=1)
    steps = np.diff(own, axis=1) > _SAME * own[:, 1:]
    felt = np.zeros(len(sizes), bool)
    felt[found] = 2 * (steps.sum(axis=1) + 1) > unusual[found].sum(axis=1)
    return felt


def _medians(values: np.ndarray) -> np.ndarray:
    """(D,) medians of what is there, NaN where nothing is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        found: np.ndarray = np.nanmedian(values, axis=0)
    return found


def repaired(pose: PoseSequence) -> Repair:
    """``pose`` without joints that jump and come back, and with left and right where time says they are.

    A joint at exactly 0, 0 in some frames, which is how many files write that it was not found, and one that
    jumps become missing; gaps are filled later. Left and right are exchanged in pairs or for the whole body.

    Returns
    -------
    Repair
        With the same object where nothing was wrong, or where the body has no scale.
    """
    neck, lengths = _torso(pose)
    known = lengths[np.isfinite(lengths)]
    length = float(np.median(known)) if len(known) else 0.0
    if len(pose) < 3 or not length > 0:
        return Repair(pose, 0)
    zero = placeholders(pose)
    keypoints, scores = np.where(zero[..., None], np.float32(np.nan), pose.keypoints), pose.scores
    others = np.array(skeleton(pose.skeleton).mirror)
    turned = _exchanged(keypoints, length, pose.times, others)
    if turned.any():
        rows, joints = np.nonzero(turned)
        keypoints[rows, joints] = keypoints[rows, others[joints]]
        scores = scores.copy()
        scores[rows, joints] = pose.scores[rows, others[joints]]
    trembling, wrong = _trembling(known / length), np.zeros(zero.shape, bool)
    for some in _together(*zero.shape):
        points = _places(keypoints, some, length)
        away = np.nan_to_num(_length(points - neck[:, None] / length)) * trembling
        wrong[:, some] = _jumps(points, scores[:, some], pose.times, away)
    frames = int((turned | wrong).any(axis=1).sum())
    if not (frames or zero.any()):
        return Repair(pose, 0)
    keypoints[wrong] = np.nan
    # No step uses depth, and joints that changed sides would keep that of the other side.
    return Repair(replace(pose, keypoints=keypoints, scores=scores, depth=None), frames)


def _together(frames: int, joints: int) -> list[np.ndarray]:
    """Which of so many joints, or pairs, are looked at together: of a recording of hours one by one."""
    return np.array_split(np.arange(joints), min(joints, frames * joints // _CELLS + 1))


def _places(keypoints: np.ndarray, joints: np.ndarray, length: float) -> np.ndarray:
    """Places in torso lengths."""
    places: np.ndarray = np.take(keypoints, joints, axis=1) / np.float64(length)
    return places


def _length(vectors: np.ndarray) -> np.ndarray:
    """(...) lengths of (..., 2 or 3) vectors."""
    plane: np.ndarray = np.hypot(vectors[..., 0], vectors[..., 1])
    return plane if vectors.shape[-1] == 2 else np.hypot(plane, vectors[..., 2])


def _at(points: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """(..., 2 or 3) where each joint was in its (...) ``frames``."""
    return np.take_along_axis(points, frames[..., None], axis=0)


def _torso(pose: PoseSequence) -> tuple[np.ndarray, np.ndarray]:
    """(T, 2 or 3) middle of the shoulders, and (T,) length of the torso; NaN where they are not seen."""
    body = skeleton(pose.skeleton)
    names = ("right_shoulder", "left_shoulder", "right_hip", "left_hip")
    joints = pose.keypoints[:, [body.index(name) for name in names]].astype(np.float64)
    right, left, right_hip, left_hip = joints.swapaxes(0, 1)
    down, across = _length(right + left - right_hip - left_hip) / 2, _length(right - left) / SHOULDERS
    return (right + left) / 2, np.fmax(down, across)


def _trembling(lengths: np.ndarray) -> float:
    """What a joint one torso length from the neck jumps with the body's scale, from the torso's lengths."""
    return NOISE * float(np.percentile(np.abs(np.diff(lengths)), SCALE)) if len(lengths) > 1 else 0.0


def placeholders(pose: PoseSequence) -> np.ndarray:
    """(T, J) bool: exactly at 0, 0, where nobody's joint is; unless the picture's origin is in the body."""
    zero: np.ndarray = (pose.keypoints == 0).all(axis=2)
    always = (zero | ~pose.seen).all(axis=0) & zero.any(axis=0)
    if always.any() and (pose.keypoints < 0).any():
        return np.zeros_like(zero)  # centred on a joint, upon which others may fall
    return zero


def _last_seen(points: np.ndarray) -> np.ndarray:
    """For each frame the one in which each joint was last seen; the first frame where it was not yet."""
    frames = np.arange(len(points)).reshape(-1, *[1] * (points.ndim - 2))
    last: np.ndarray = np.maximum.accumulate(np.where(np.isnan(points[..., 0]), 0, frames), axis=0)
    return last


def _exchanged(keypoints: np.ndarray, length: float, times: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(T, J) bool: joints that belong to the other side. All pairs together first, then each by itself."""
    out = np.zeros(keypoints.shape[:2], bool)
    own = np.flatnonzero(np.arange(len(others)) < others)
    pairs = np.stack([own, others[own]])
    saved, fading = np.empty((2, len(times) - 1, len(own)))

    def compare(whole: np.ndarray) -> None:
        for some in _together(len(times), len(own)):
            sides = _places(keypoints, pairs[:, some], length)
            last = _last_seen(sides)
            sides = _at(sides, last)
            saved[:, some] = _saved(np.where(whole[:, None, None, None], sides[:, ::-1], sides))
            ago = (times[1:, None, None] - times[last[:-1]]).max(axis=1)
            fading[:, some] = np.maximum(ago / TENTH, 1)

    compare(np.zeros(len(times), bool))
    if not (saved > SWAP).any():
        return out
    held = SWAPPED * np.diff(times, append=times[-1:])
    whole = _cheapest((saved / fading).sum(axis=1) - SWAP * len(own) ** 0.5, held)
    if whole.any():
        compare(whole)
    out[:, pairs] = whole[:, None, None]
    # A pair that has nothing from the exchange of all is left out of it at no cost.
    gains = saved / fading - np.where(np.diff(whole), 0, SWAP)[:, None]
    for pair in np.flatnonzero((gains > 0).any(axis=0)):
        out[:, pairs[:, pair]] ^= _cheapest(gains[:, pair], np.where(whole, 0, held))[:, None]
    return out


def _saved(sides: np.ndarray) -> np.ndarray:
    """(T - 1, P) by how much the ways of pairs' (T, 2, P, 2 or 3) places are shorter to the other's next one.

    A way that goes on as the joint moved before, or as it will move after, counts as none: hands that cross
    go on, those that are confused do not.
    """
    steps = np.diff(sides, axis=0)
    ways, turns = _length(steps), _length(np.diff(steps, axis=0))
    ways[1:] = np.fmin(ways[1:], turns)
    ways[:-1] = np.fmin(ways[:-1], turns)
    across = _length(sides[1:] - sides[:-1, ::-1])
    saved: np.ndarray = np.nan_to_num((ways - across).sum(axis=1))
    return saved


def _cheapest(gains: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(T,) bool: exchanged in the cheapest sequence, which gains (T - 1,) ``gains`` wherever it changes.

    Each exchanged frame costs its (T,) ``held``.
    """
    plain, exchanged, costs = 0.0, float(held[0]), held.tolist()
    before = [(False, False)]
    for gain, cost in zip(gains.tolist(), costs[1:], strict=True):
        changed = exchanged - gain < plain, plain - gain < exchanged
        before.append(changed)
        plain, exchanged = (
            exchanged - gain if changed[0] else plain,
            (plain - gain if changed[1] else exchanged) + cost,
        )
    state, out = exchanged < plain, np.zeros(len(held), bool)
    for frame in range(len(held) - 1, -1, -1):
        out[frame] = state
        state ^= before[frame][state]
    return out


def _jumps(points: np.ndarray, scores: np.ndarray, times: np.ndarray, trembling: np.ndarray) -> np.ndarray:
    """(T, J) bool: joints that are off their way for a few frames; the (T, J) ``trembling`` is no jump."""
    out, last = np.zeros(points.shape[:2], bool), _last_seen(points)
    steps = _length(np.diff(_at(points, last), axis=0))
    if not (steps > LEAST_SURE * JUMP).any():
        return out
    sure = np.clip(scores / np.maximum(np.median(scores, axis=0), 1e-3), LEAST_SURE, 1)
    trembling = np.take_along_axis(trembling, last, axis=0)
    trembling = np.minimum(trembling[1:], trembling[:-1])
    wide = steps > JUMP * np.minimum(sure[1:], sure[:-1]) + trembling
    for joint in np.flatnonzero(wide.any(axis=0)):
        seen = np.flatnonzero(~np.isnan(points[:, joint, 0]))
        if len(seen) < 3:
            continue
        more = trembling[np.minimum(seen, len(steps) - 1), joint]
        out[seen, joint] = _off_its_way(points[seen, joint], sure[seen, joint], times[seen], more)
    return out


def _off_its_way(track: np.ndarray, sure: np.ndarray, times: np.ndarray, more: np.ndarray) -> np.ndarray:
    """(T,) bool: frames of one joint's (T, 2 or 3) track in which it is elsewhere than before and after.

    ``sure`` are the (T,) confidences over their median, at most 1, which scale what a jump needs; ``more`` is
    what it needs besides.
    """
    from scipy.ndimage import percentile_filter

    steps, gaps = _length(np.diff(track, axis=0)), np.diff(times)
    near = round(AROUND * len(gaps) / max(float(times[-1] - times[0]), 1e-3))
    share = min(USUAL, max(100 - 250 / len(steps), 0))  # of few steps, two are those of one jump
    usual = percentile_filter(steps, share, 2 * min(near, len(steps)) + 1, mode="reflect")
    limits = JUMP * np.maximum(gaps / TENTH, 1) * np.minimum(sure[1:], sure[:-1]) + NOISE * usual
    limits = np.append(limits, limits[-1:]) + more
    limits = np.minimum(limits, REACH * np.append(np.maximum(gaps / TENTH, 1), 1))
    kept = np.arange(len(track))
    while len(kept) > 2:
        steps = _length(np.diff(track[kept], axis=0))
        wide = np.flatnonzero(steps > limits[kept[:-1]])
        if len(wide) < 2:
            break
        # Each wide step as the way out, with the next ones as the way back.
        back = np.arange(len(wide))[:, None] + np.arange(1, _RUN)
        there = back < len(wide)
        out, back = wide[:, None], wide[np.minimum(back, len(wide) - 1)]
        before, after = kept[out], kept[back + 1]
        away = np.minimum(steps[out], steps[back]) - _length(track[after] - track[before])
        limit = np.maximum(limits[before], limits[after - 1])
        found = there & (away > limit) & (times[after] - times[before] <= LONGEST + _ROUNDING)
        if not found.any():
            break
        lengths = np.where(found, back - out, len(kept))
        row, column = np.nonzero(lengths == lengths.min())  # the shortest first: they may explain longer ones
        right = np.ones(len(kept), bool)
        for first, end in zip(out[row, 0] + 1, back[row, column] + 1, strict=True):
            right[first:end] = False
        kept = kept[right]
    kept = kept[_wrong_at_start(track[kept], limits[kept], times[kept]) :][::-1]
    kept = kept[_wrong_at_start(track[kept], limits[kept], times[kept]) :]
    wrong = np.ones(len(track), bool)
    wrong[kept] = False
    return wrong


def _wrong_at_start(track: np.ndarray, limits: np.ndarray, times: np.ndarray) -> int:
    """How many frames at the start of a track, which may run backwards, are off the way that follows."""
    near = int(np.count_nonzero(np.abs(times - times[0]) <= LONGEST + _ROUNDING)) - 1
    most = min(near, (len(track) - 1) // 2)
    steps = np.diff(track[: most + 2], axis=0)
    gaps = np.abs(np.diff(times[: most + 1]))
    limits = np.minimum(END * limits[:most], REACH * np.maximum(gaps / TENTH, 1))
    wrong = np.flatnonzero(_length(steps[:most]) > limits)
    wrong = wrong[_length(steps[wrong + 1] - steps[wrong]) > limits[wrong]]
    return int(wrong[-1]) + 1 if len(wrong) else 0
