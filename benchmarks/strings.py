"""Long recordings with known events: two real sets, and strings of clips with movements between them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from datasets import Item, body_gesture, need, utd_openpose, utd_skeleton
from videos import with_videos

from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence

_KINECT = (3, 2, 8, 9, 10, 4, 5, 6, 16, 17, 18, 12, 13, 14)
"""Joints of Kinect v1 for the first fourteen of COCO-18: head, shoulder centre, arms, legs, right first."""
_BEFORE, _AFTER = 1.0, 0.5
"""Seconds of an example before its action point, where a gesture is under way, and after it."""

_ARMS = ("a1", "a6", "a7", "a9")
"""Actions of UTD-MHAD that the arms alone perform; the other two move the whole body."""


@dataclass(frozen=True)
class Recording:
    """A long recording, who performs in it, and (label, start, end) of what is done, in seconds."""

    pose: PoseSequence
    subject: str
    truth: tuple[tuple[str, float, float], ...]


def utkinect(shared: Path) -> tuple[list[Recording], list[Item]]:
    """10 recordings of 5 people; the labelled intervals are the examples for the other people."""
    root = need(shared / "data" / "utkinect_continuous")
    intervals: dict[str, list[tuple[str, float, float]]] = {}
    for line in (root / "labels.txt").read_text("utf-8").split("\n"):
        if match := re.match(r"(\w+): *(\d+) +(\d+)", line):
            label, start, end = match.groups()
            intervals[name].append((label, int(start) / 60, int(end) / 60))  # noqa: F821 - set below
        elif line.strip():
            name = line.strip()
            intervals[name] = []
    recordings, items = [], []
    with np.load(root / "joints.npz", allow_pickle=False) as archive:
        for name, truth in intervals.items():
            pose = _kinect(archive[f"{name}_mm"], archive[f"{name}_frame"] / 60, name)
            recordings.append(Recording(pose, name[:3], tuple(truth)))
            for number, (label, start, end) in enumerate(truth):
                clip = cut(pose, start, end, f"{name}_{number}")
                if len(clip) >= 5:
                    items.append(Item(clip, label, name[:3], clip.source))
    return recordings, items


def msrc12(shared: Path) -> tuple[list[Recording], list[Item], dict[str, float]]:
    """60 recordings of 12 gestures by 5 people, and examples with the seconds of their action points.

    An action point is the one moment at which a gesture should be recognised, marked by people. The examples
    are what lies around every other one of the first six of a recording.
    """
    root = need(shared / "data" / "msrc12_p1")
    points = json.loads((root / "action_points.json").read_text("utf-8"))
    recordings, items, moments = [], [], {}
    with np.load(root / "joints.npz", allow_pickle=False) as archive:
        for name, marks in points.items():
            micro = archive[f"{name}_us"]
            times = (micro - micro[0]) / 1e6
            pose = _kinect(archive[f"{name}_mm"], np.maximum.accumulate(times), name)
            subject, label = name.split("_")[-1][:3], marks[0][1].split(" ")[0]
            seconds = [(mark - int(micro[0])) / 1e6 for mark, _ in marks]
            recordings.append(Recording(pose, subject, tuple((label, point, point) for point in seconds)))
            for number in range(0, 6, 2):
                point = seconds[number]
                clip = cut(pose, point - _BEFORE, point + _AFTER, f"{name}_{number}")
                items.append(Item(clip, label, subject, clip.source))
                moments[clip.source] = point
    return recordings, items, moments


def strings_of(
    items: Sequence[Item], wanted: Sequence[str], seed: int = 0, repeats: int = 1
) -> list[Recording]:
    """One recording of each subject: all clips in some order, half a second to a second between them.

    Between two clips the joints move straight from the last pose of one to the first of the next.
    """
    rng = np.random.default_rng(seed)
    recordings = []
    for subject in sorted({item.subject for item in items}):
        own = [item for item in items if item.subject == subject]
        order = [own[i] for i in rng.permutation(len(own)) for _ in range(repeats)]
        points, times, truth, now = [], [], [], 0.0
        last: np.ndarray | None = None
        for item in order:
            clip = item.pose.keypoints.astype(np.float64)
            neck = clip[:, 1][~np.isnan(clip[:, 1]).any(axis=1)]
            clip = clip - neck[0]
            step = float(np.median(np.diff(item.pose.times)))
            if last is not None:
                rest = max(2, round(rng.uniform(0.5, 1.0) / step))
                share = np.linspace(0, 1, rest + 2)[1:-1, None, None]
                points.append(last * (1 - share) + clip[0] * share)
                times.append(now + step * np.arange(1, rest + 1))
                now = float(times[-1][-1]) + step
            own_times = item.pose.times - item.pose.times[0] + now
            points.append(clip)
            times.append(own_times)
            if item.label in wanted:
                truth.append((item.label, float(own_times[0]), float(own_times[-1])))
            last, now = clip[-1], float(own_times[-1])
        every = np.concatenate(points)
        pose = PoseSequence(
            every, np.ones(every.shape[:2]), np.concatenate(times), COCO18.name, source=f"string of {subject}"
        )
        recordings.append(Recording(pose, subject, tuple(truth)))
    return recordings


def string_sets(shared: Path, videos: Path | None = None) -> Mapping[str, tuple[list[Recording], list[Item]]]:
    """Recordings and examples by the name of the set; examples of other movements are called ``_none``.

    ``videos`` is a folder with the keypoints that ``videos.py`` found in the clips of body_gesture.
    """
    actions = [f"a{n}" for n in range(1, 28, 2)]
    skeleton = utd_skeleton(shared)
    openpose = utd_openpose(shared)
    four = sorted({item.label for item in openpose})[:4]
    landmarks = body_gesture(shared)
    moving = sorted({item.label for item in landmarks if item.group == "dynamic"})
    sets = {
        "UTD-27 strings": (strings_of(skeleton, actions), [i for i in skeleton if i.label in actions]),
        "OpenPose strings": (strings_of(openpose, four), [i for i in openpose if i.label in four]),
        "OpenPose strings, arms": (strings_of(openpose, _ARMS), [i for i in openpose if i.label in _ARMS]),
    }
    for name, clips in {
        "body_gesture strings": landmarks,
        "body_gesture strings, videos": [
            replace(item, pose=item.pose.onto("coco18"))
            for item in (with_videos(landmarks, videos) if videos else [])
        ],
    }.items():
        if clips:
            none = [item if item.label in moving else replace(item, label="_none") for item in clips]
            sets[name] = (strings_of(clips, moving), [i for i in clips if i.label in moving])
            sets[f"{name}, _none"] = (sets[name][0], none)
    return sets


def cut(pose: PoseSequence, start: float, end: float, name: str) -> PoseSequence:
    """The frames from ``start`` to ``end`` seconds."""
    inside = (pose.times >= start) & (pose.times <= end)
    return replace(
        pose,
        keypoints=pose.keypoints[inside],
        scores=pose.scores[inside],
        times=pose.times[inside],
        source=name,
    )


def _kinect(millimetres: np.ndarray, times: np.ndarray, name: str) -> PoseSequence:
    points: np.ndarray = np.full((len(millimetres), 18, 2), np.nan)
    points[:, :14] = millimetres[:, _KINECT, :2] * (-1.0, -1.0) / 1000
    points[(millimetres == 0).all(axis=(1, 2))] = np.nan
    return PoseSequence(points, np.ones(points.shape[:2]), times, COCO18.name, source=name)
