"""Keypoints of a stream of frames, batch by batch; the video is never held as a whole."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.plugin.interfaces import PoseBackend
from gesture_core.pose.follow import Follower
from gesture_core.pose.steady import Steady
from gesture_core.pose.tracks import Tracker
from gesture_core.skeletons import skeleton
from gesture_core.types import PoseSequence

if TYPE_CHECKING:
    from gesture_core.settings import Settings

Frame = tuple[float, np.ndarray]
REVISION = 2
"""Goes up when the same network gives other keypoints than before: stored ones are then not used again."""


def open_backend(settings: Settings, threads: int = 0) -> PoseBackend:
    """The pose backend that the settings name, with its network loaded.

    Parameters
    ----------
    settings : Settings
    threads : int
        Of the runtime; 0 leaves it to the runtime.

    Raises
    ------
    GestureError
        From the plugin registry, from `find_model`, or from loading the network.
    """
    from gesture_core.plugin import registry
    from gesture_core.pose.models import find_model

    pose = settings.pose
    found = registry()
    # A backend takes what it knows: one that asks a service has no height and no threads.
    takes = inspect.signature(found.load("pose", pose.backend)).parameters
    every = any(parameter.kind is parameter.VAR_KEYWORD for parameter in takes.values())
    common: dict[str, float] = {"threads": threads}
    given = {"height": pose.height, "score": pose.score}
    common |= {name: value for name, value in given.items() if value is not None}
    options = {name: value for name, value in common.items() if every or name in takes}
    options |= settings.plugin_options(pose.backend)
    backend: PoseBackend = found.make("pose", pose.backend, options, model=find_model(pose.model))
    return backend


def extract_poses(
    frames: Iterable[Frame],
    backend: PoseBackend,
    people: str = "single",
    *,
    follow: bool | None = None,
    steady: bool | None = None,
    source: str = "",
) -> list[PoseSequence]:
    """The keypoints of everybody in a video.

    Parameters
    ----------
    frames : iterable of (seconds, frame)
        Frames (H, W, 3) uint8 in BGR, upright, times not descending; a
        `gesture_core.plugin.interfaces.Video` is one.
    backend : PoseBackend
    people : "single" or "multi"
        One sequence with the most visible person of each frame, or one for each person tracked.
    follow : bool, optional
        Crop to the person and follow them; None lets the network's contract decide. Only with
        ``people="single"``.
    steady : bool, optional
        Choose every limb for all frames together (`gesture_core.pose.steady`); None lets the backend
        decide, which does unless its option ``steady`` says no. Only with ``people="single"``.
    source : str
        What to call the input.

    Returns
    -------
    list of PoseSequence
        Of ``"single"``, exactly one, as long as the video (NaN where nobody was found), none for no
        frames. Of ``"multi"``, one for each track, the largest sum of scores first.

    Raises
    ------
    GestureError
        Whatever the backend or the reader raises; no partial result is returned.
    """
    stream = iter(frames)
    times: list[float] = []
    size: tuple[int, int] | None = None
    body = skeleton(backend.skeleton)
    joints = len(body.joints)
    if steady is None:
        steady = bool(getattr(backend, "steady", True))
    chooser = Steady(body) if steady and people == "single" else None
    peaks: list[np.ndarray] = []
    points: list[np.ndarray] = []
    scores: list[np.ndarray] = []
    tracker = Tracker(joints)
    if follow is None:
        follow = bool(getattr(getattr(backend, "contract", None), "follow", False))
    follower = Follower(backend) if follow and people == "single" else None
    for batch in _batches(stream, backend.batch_size):
        pictures = [frame for _, frame in batch]
        times += [time for time, _ in batch]
        if size is None:
            size = pictures[0].shape[1], pictures[0].shape[0]
        if people == "multi":
            for everybody in backend.estimate(pictures, people):
                tracker.add(everybody)
            continue
        best = (
            follower.estimate(pictures)
            if follower
            else [found[0] if found else None for found in backend.estimate(pictures, people)]
        )
        for person in best:
            points.append(person.keypoints if person else np.full((joints, 2), np.nan))
            scores.append(person.scores if person else np.zeros(joints))
            if chooser:
                peaks.append(chooser.peaks_of(person))
    provenance = {
        "people": people,
        "follow": str(follower is not None),
        "steady": str(chooser is not None),
    }
    provenance |= getattr(backend, "provenance", {})
    at = np.array(times, np.float64)
    if people == "multi":
        return [
            PoseSequence(p, s, at[first : first + len(p)], backend.skeleton, size, i, source, provenance)
            for i, (first, p, s) in enumerate(tracker.tracks())
        ]
    if not times:
        return []
    where, sure = np.stack(points), np.stack(scores)
    if chooser:
        where, sure = chooser.choose(where, sure, np.stack(peaks), at)
    return [PoseSequence(where, sure, at, backend.skeleton, size, 0, source, provenance)]


def _batches(stream: Iterator[Frame], size: int) -> Iterator[list[Frame]]:
    while batch := list(islice(stream, size)):
        yield batch
