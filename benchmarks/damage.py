"""Damage of keypoint sequences, for benchmarks/stress.py: of whole clips, and a few wrong frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gesture_core.skeletons import COCO18, HANDS42, skeleton
from gesture_core.types import PoseSequence


@dataclass(frozen=True)
class Stress:
    """One kind of damage at several strengths; the first strength is none."""

    name: str
    unit: str
    strengths: Sequence[float]
    damage: Callable[[PoseSequence, float, np.random.Generator], PoseSequence]


def dropout(pose: PoseSequence, share: float, random: np.random.Generator) -> PoseSequence:
    """Joints that are missing, each frame anew."""
    gone = random.random(pose.scores.shape) < share
    return replace(pose, keypoints=np.where(gone[..., None], np.nan, pose.keypoints))


def bursts(pose: PoseSequence, share: float, random: np.random.Generator) -> PoseSequence:
    """Joints that are missing for about half a second at a time."""
    length = max(1, round(0.5 / float(np.median(np.diff(pose.times)))))
    gone = np.zeros(pose.scores.shape, bool)
    wanted = share * gone.size
    while gone.sum() < wanted:
        start = random.integers(-length + 1, len(pose))
        gone[max(start, 0) : start + length, random.integers(gone.shape[1])] = True
    return replace(pose, keypoints=np.where(gone[..., None], np.nan, pose.keypoints))


def jitter(pose: PoseSequence, size: float, random: np.random.Generator) -> PoseSequence:
    """Noise on every coordinate; the size is its deviation in shoulder widths."""
    return replace(pose, keypoints=pose.keypoints + random.normal(0, size, pose.keypoints.shape))


def frame_drops(pose: PoseSequence, share: float, random: np.random.Generator) -> PoseSequence:
    """Frames that never arrive; those that do keep their times."""
    return _frames(pose, np.flatnonzero(random.random(len(pose)) >= share))


def frame_rate(pose: PoseSequence, factor: float, random: np.random.Generator) -> PoseSequence:
    """The same movement at another frame rate, with true times."""
    times = np.linspace(pose.times[0], pose.times[-1], max(2, round(len(pose) * factor)))
    flat = pose.keypoints.reshape(len(pose), -1)
    points = np.stack([np.interp(times, pose.times, c) for c in flat.T], axis=1).reshape(-1, 18, 2)
    return PoseSequence(points, np.ones(points.shape[:2]), times, source=pose.source)


def roll(pose: PoseSequence, degrees: float, random: np.random.Generator) -> PoseSequence:
    """A camera that is turned about its axis."""
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    return replace(pose, keypoints=pose.keypoints @ turn.T)


def scale(pose: PoseSequence, factor: float, random: np.random.Generator) -> PoseSequence:
    """A person of another size somewhere else in the picture."""
    return replace(pose, keypoints=pose.keypoints * factor + random.uniform(-500, 500, 2))


def walk(pose: PoseSequence, factor: float, random: np.random.Generator) -> PoseSequence:
    """A person who comes nearer: size grows by the factor from the first to the last frame."""
    growth = np.linspace(1, factor, len(pose))[:, None, None]
    return replace(pose, keypoints=pose.keypoints * growth)


def mirror(pose: PoseSequence, on: float, random: np.random.Generator) -> PoseSequence:
    """The same gesture with the other hand."""
    if not on:
        return pose
    return replace(pose, keypoints=pose.keypoints[:, list(COCO18.mirror)] * (-1, 1))


def clip_ends(pose: PoseSequence, share: float, random: np.random.Generator) -> PoseSequence:
    """A part cut off at the start and as much at the end."""
    cut = round(len(pose) * share)
    return _frames(pose, np.arange(cut, len(pose) - cut))


def _frames(pose: PoseSequence, kept: np.ndarray) -> PoseSequence:
    return replace(pose, keypoints=pose.keypoints[kept], scores=pose.scores[kept], times=pose.times[kept])


def _torso(pose: PoseSequence) -> float:
    neck, right, left = (_joint(pose, name) for name in ("neck", "right_hip", "left_hip"))
    hips = (pose.keypoints[:, right] + pose.keypoints[:, left]) / 2
    return float(np.nanmedian(np.linalg.norm(pose.keypoints[:, neck] - hips, axis=1)))


def _joint(pose: PoseSequence, name: str) -> int:
    return skeleton(pose.skeleton).index(name)


def _hand(pose: PoseSequence, random: np.random.Generator) -> list[int]:
    """The joints of one hand, its wrist first."""
    side = ("right", "left")[random.integers(2)]
    return [_joint(pose, name) for name in HANDS42.joints if name.startswith(side)]


def _palm(pose: PoseSequence, hand: list[int]) -> float:
    """From the wrist to the knuckle of the middle finger; a fifth of the torso where no hand is seen."""
    seen = np.linalg.norm(pose.keypoints[:, hand[9]] - pose.keypoints[:, hand[0]], axis=1)
    return float(np.nanmedian(seen)) if np.isfinite(seen).any() else _torso(pose) / 5


def _directions(pose: PoseSequence, count: int, random: np.random.Generator) -> np.ndarray:
    """(N, 2 or 3) vectors of length 1."""
    if pose.keypoints.shape[2] == 2:
        angle = random.uniform(0, 2 * np.pi, count)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = random.normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def _somewhere(pose: PoseSequence, count: float, random: np.random.Generator) -> np.ndarray:
    return np.sort(random.choice(len(pose), min(round(count), len(pose)), replace=False))


def _in_a_row(pose: PoseSequence, count: float, random: np.random.Generator) -> np.ndarray:
    return random.integers(len(pose) - round(count) + 1) + np.arange(round(count))


def _at_the_start(pose: PoseSequence, count: float, random: np.random.Generator) -> np.ndarray:
    return np.arange(round(count))


def jumps(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator, size: float = 3) -> np.ndarray:
    """A wrist that is ``size`` torso lengths off, each time in another direction."""
    points, wrist = pose.keypoints.copy(), _joint(pose, ("right_wrist", "left_wrist")[random.integers(2)])
    points[frames, wrist] += size * _torso(pose) * _directions(pose, len(frames), random)
    return points


def nearer(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A wrist whose place in the picture is right, and that lies a torso length before or behind it."""
    points, wrist = pose.keypoints.copy(), _joint(pose, ("right_wrist", "left_wrist")[random.integers(2)])
    points[frames, wrist, 2] += _torso(pose) * random.choice((-1, 1), len(frames))
    return points


def fingertip(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The tip of a finger that is two palms off."""
    points, hand = pose.keypoints.copy(), _hand(pose, random)
    points[frames, hand[4 * int(random.integers(1, 6))]] += (
        2 * _palm(pose, hand) * _directions(pose, len(frames), random)
    )
    return points


def hand_elsewhere(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A hand that is found a torso length off."""
    points, hand = pose.keypoints.copy(), _hand(pose, random)
    points[np.ix_(frames, hand)] += _torso(pose) * _directions(pose, len(frames), random)[:, None]
    return points


def shapeless(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A hand whose joints lie anywhere within a palm of its wrist."""
    points, hand = pose.keypoints.copy(), _hand(pose, random)
    shape = (len(frames), len(hand) - 1, points.shape[2])
    points[np.ix_(frames, hand[1:])] = points[frames, hand[0]][:, None] + random.normal(
        0, _palm(pose, hand), shape
    )
    return points


def hand_at_zero(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """All joints of a hand at 0, 0."""
    points = pose.keypoints.copy()
    points[np.ix_(frames, _hand(pose, random))] = 0
    return points


def exchanged(*names: str) -> Callable[[PoseSequence, np.ndarray, np.random.Generator], np.ndarray]:
    """Left and right of the joints called ``names`` change places."""

    def damage(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
        points = pose.keypoints.copy()
        for name in names:
            pair = [_joint(pose, f"right_{name}"), _joint(pose, f"left_{name}")]
            points[np.ix_(frames, pair)] = points[np.ix_(frames, pair[::-1])]
        return points

    return damage


def zeros(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A joint of an arm at 0, 0."""
    names = ("right_wrist", "left_wrist", "right_elbow", "left_elbow")
    points = pose.keypoints.copy()
    points[frames, _joint(pose, names[random.integers(4)])] = 0
    return points


def frozen(pose: PoseSequence, frames: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Frames that show the one before them."""
    points = pose.keypoints.copy()
    for frame in frames:
        points[frame] = points[max(frame - 1, 0)]
    return points


def doubled(pose: PoseSequence, count: float, random: np.random.Generator) -> PoseSequence:
    """Frames that come twice, which makes the clip longer."""
    kept = np.sort(np.concatenate([np.arange(len(pose)), _somewhere(pose, count, random)]))
    times = np.arange(len(kept)) * float(np.median(np.diff(pose.times)))
    return replace(_frames(pose, kept), times=times)


def wrong(
    damage: Callable[[PoseSequence, np.ndarray, np.random.Generator], np.ndarray],
    frames: Callable[[PoseSequence, float, np.random.Generator], np.ndarray] = _somewhere,
) -> Callable[[PoseSequence, float, np.random.Generator], PoseSequence]:
    """``damage`` in as many of the ``frames`` as the strength says."""
    return lambda pose, count, random: replace(
        pose, keypoints=damage(pose, frames(pose, count, random), random)
    )


STRESSES = (
    Stress("joint dropout", "share missing", (0, 0.1, 0.2, 0.3, 0.4, 0.5), dropout),
    Stress("joint dropout in bursts", "share missing", (0, 0.1, 0.2, 0.3, 0.4, 0.5), bursts),
    Stress("jitter", "shoulder widths", (0, 0.05, 0.1, 0.2, 0.3), jitter),
    Stress("frame drops", "share lost", (0, 0.1, 0.2, 0.3, 0.5, 0.7), frame_drops),
    Stress("frame rate", "factor", (1, 0.25, 0.5, 2, 4), frame_rate),
    Stress("camera roll", "degrees", (0, 5, 10, 15, 20, 30), roll),
    Stress("scale and position", "factor", (1, 0.2, 0.5, 2, 10), scale),
    Stress("walking nearer", "growth", (1, 1.2, 1.5, 2), walk),
    Stress("mirrored", "other hand", (0, 1), mirror),
    Stress("clipped start and end", "share of each", (0, 0.05, 0.1, 0.15, 0.2, 0.3), clip_ends),
)
_ARMS = ("shoulder", "elbow", "wrist")
_all = exchanged(*_ARMS, "hip", "knee", "ankle", "eye", "ear")
_COUNTS = (0, 1, 2, 3, 5)
BAD_FRAMES = (
    Stress("a wrist 3 torsos off", "frames", _COUNTS, wrong(jumps)),
    Stress("a wrist off, in a row", "frames", (0, 2, 3, 5), wrong(jumps, _in_a_row)),
    Stress("a wrist off, at the start", "frames", (0, 1, 3), wrong(jumps, _at_the_start)),
    Stress("wrists exchanged", "frames", _COUNTS, wrong(exchanged("wrist"))),
    Stress("arms exchanged", "frames", _COUNTS, wrong(exchanged(*_ARMS))),
    Stress("all exchanged", "frames", _COUNTS, wrong(_all)),
    Stress("all exchanged, at the start", "frames", (0, 1, 3), wrong(_all, _at_the_start)),
    Stress("a joint at 0, 0", "frames", _COUNTS, wrong(zeros)),
    Stress("frozen", "frames", _COUNTS, wrong(frozen)),
    Stress("doubled", "frames", _COUNTS, doubled),
)
_HAND = tuple(name.removeprefix("left_") for name in HANDS42.joints if name.startswith("left_"))
DEPTH_FRAMES = (*BAD_FRAMES, Stress("a wrist a torso before or behind", "frames", _COUNTS, wrong(nearer)))
HAND_FRAMES = (
    Stress("a fingertip two palms off", "frames", _COUNTS, wrong(fingertip)),
    Stress("a hand a torso off", "frames", _COUNTS, wrong(hand_elsewhere)),
    Stress("a hand without shape", "frames", _COUNTS, wrong(shapeless)),
    Stress("fingers of both hands exchanged", "frames", _COUNTS, wrong(exchanged(*_HAND))),
    Stress("arms and hands exchanged", "frames", _COUNTS, wrong(exchanged(*_ARMS, *_HAND))),
    Stress("a hand at 0, 0", "frames", _COUNTS, wrong(hand_at_zero)),
    Stress("a wrist 3 torsos off", "frames", _COUNTS, wrong(jumps)),
    Stress("frozen", "frames", _COUNTS, wrong(frozen)),
)
