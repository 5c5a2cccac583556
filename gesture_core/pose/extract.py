"""Keypoints of a stream of frames, batch by batch; the video is never held as a whole."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.plugin.abilities import CropFollowing, RegionFollowing, Traceable
from gesture_core.pose.follow import Follower
from gesture_core.pose.region import RegionFollower
from gesture_core.pose.temporal import JointChoice
from gesture_core.skeletons import skeleton
from gesture_core.types import Person, PoseSequence

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import PoseBackend
    from gesture_core.settings import Settings

Frame = tuple[float, np.ndarray]
REVISION = 3
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
    from gesture_core.pose.choice import choose_pose
    from gesture_core.pose.models import find_model

    settings = choose_pose(settings)
    pose, plugins = settings.pose, registry()
    device = next((one for one in (pose.provider, pose.target) if one != "auto"), None)
    shared = {"threads": threads, "height": pose.height, "score": pose.score, "device": device}
    options = {
        key: value
        for key, value in shared.items()
        if value is not None and plugins.takes("pose", pose.backend, key)
    }
    options |= settings.plugin_options(pose.backend)
    backend: PoseBackend = plugins.make("pose", pose.backend, options, model=find_model(pose.model))
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
        Crop to the person and follow them; None lets the backend decide. Only with ``people="single"``.
    steady : bool, optional
        Choose every limb for all frames together (`gesture_core.pose.temporal`); None lets the backend
        decide, which does so unless its ``steady`` is false. Only with ``people="single"``.
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
    body = skeleton(backend.skeleton)
    joints = len(body.joints)
    follower = follower_of(backend, follow) if people == "single" else None
    steady = is_steady(backend) if steady is None else steady
    choice = JointChoice(body) if steady and people == "single" else None
    tracker = Tracker(joints) if people == "multi" else None
    others = 0
    size: tuple[int, int] | None = None
    times: list[float] = []
    points: list[np.ndarray] = []
    scores: list[np.ndarray] = []
    peaks: list[np.ndarray] = []
    stream = iter(frames)
    while batch := list(islice(stream, backend.batch_size)):
        pictures = [frame for _, frame in batch]
        times += [time for time, _ in batch]
        size = size or (pictures[0].shape[1], pictures[0].shape[0])
        best: Sequence[Person | None]
        if follower:
            best = follower.estimate(pictures)
        else:
            found = backend.estimate(pictures, people)
            if tracker:
                for everybody in found:
                    tracker.add(everybody)
                continue
            best = [everybody[0] if everybody else None for everybody in found]
        others += sum(1 for person in best if person and person.others)
        for person in best:
            points.append(person.keypoints if person else np.full((joints, 2), np.nan))
            scores.append(person.scores if person else np.zeros(joints))
            if choice:
                peaks.append(choice.peaks_of(person))
    provenance = {
        "people": people,
        "follow": str(follower is not None),
        "steady": str(choice is not None),
        **(backend.provenance if isinstance(backend, Traceable) else {}),
    }
    if others:
        provenance["others"] = str(others)
    at = np.array(times, np.float64)
    if tracker:
        return [
            PoseSequence(p, s, at[first : first + len(p)], backend.skeleton, size, i, source, provenance)
            for i, (first, p, s) in enumerate(tracker.tracks())
        ]
    if not times:
        return []
    where, certain = np.stack(points), np.stack(scores)
    if choice:
        where, certain = choice.choose(where, certain, np.stack(peaks), at)
    return [PoseSequence(where, certain, at, backend.skeleton, size, 0, source, provenance)]


def follower_of(backend: PoseBackend, follow: bool | None = None) -> Follower | RegionFollower | None:
    """What follows one person for ``backend``; None where it is given whole pictures."""
    if follow is None:
        follow = isinstance(backend, CropFollowing) and backend.follow
    if not follow:
        return None
    if isinstance(backend, RegionFollowing) and backend.region:
        return RegionFollower(backend)
    return Follower(backend)


def is_steady(backend: PoseBackend) -> bool:
    """Whether limbs are chosen over time, where nobody says otherwise."""
    return backend.steady if isinstance(backend, CropFollowing) else True


@dataclass
class _Track:
    """One person so far: the numbers of the first and the last frame, and the latest place of each joint."""

    first: int
    last: int
    latest: np.ndarray
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
