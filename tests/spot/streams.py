"""Drawn streams: the gestures of the demonstration one after the other, with rests between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gesture_core import load_poses
from gesture_core.demo.archive import DemoArchive
from gesture_core.types import PoseSequence


def examples_of(drawn: DemoArchive) -> tuple[list[PoseSequence], list[str]]:
    poses = load_poses(drawn.example_keypoints, workers=1)
    return poses, [pose.source.split("/")[-2] for pose in poses]


def strung(
    poses: Sequence[PoseSequence], rest: float = 1.0
) -> tuple[PoseSequence, list[tuple[float, float]]]:
    """One recording of all ``poses``, and when each begins and ends; in the rests the joints move evenly."""
    points: list[np.ndarray] = []
    scores: list[np.ndarray] = []
    times: list[np.ndarray] = []
    marks: list[tuple[float, float]] = []
    now = 0.0
    for number, pose in enumerate(poses):
        keypoints, step = pose.keypoints.astype(np.float64), float(np.median(np.diff(pose.times)))
        if number:
            frames = round(rest / step)
            share = np.linspace(0, 1, frames + 2)[1:-1, None, None]
            points.append(points[-1][-1] * (1 - share) + keypoints[0] * share)
            scores.append(np.repeat(pose.scores[:1], frames, axis=0))
            times.append(now + step * np.arange(1, frames + 1))
            now = float(times[-1][-1]) + step
        own = pose.times - pose.times[0] + now
        points.append(keypoints)
        scores.append(pose.scores)
        times.append(own)
        marks.append((float(own[0]), float(own[-1])))
        now = float(own[-1])
    whole = replace(
        poses[0],
        keypoints=np.concatenate(points),
        scores=np.concatenate(scores),
        times=np.concatenate(times),
        source="string",
    )
    return whole, marks
