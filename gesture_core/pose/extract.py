"""Keypoints of a stream of frames, batch by batch; the video is never held as a whole."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from gesture_core.errors import ConfigError, PluginError, PoseError
from gesture_core.plugin.abilities import CropFollowing, RegionFollowing, Traceable, lacking
from gesture_core.plugin.registry import calling
from gesture_core.pose.follow import Follower, Frame
from gesture_core.pose.temporal import JointChoice
from gesture_core.skeletons import skeleton
from gesture_core.types import Person, PoseSequence

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import PoseBackend
    from gesture_core.pose.parts import Parts
    from gesture_core.pose.region import RegionFollower
    from gesture_core.settings import Settings

REVISION = 8
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
    from gesture_core.pose.models import choose_pose, find_model

    settings = choose_pose(settings)
    pose, plugins = settings.pose, registry()
    device = pose.target if pose.provider == "auto" else pose.provider
    shared = {"threads": threads, "height": pose.height, "score": pose.score, "device": device}
    options: dict[str, Any] = {}
    for key, value in shared.items():
        if value in (None, "auto"):
            continue
        if plugins.takes("pose", pose.backend, key):
            options[key] = value
        elif key in ("height", "score"):
            raise ConfigError(
                f"pose.{key} is nothing to the pose backend {pose.backend}",
                remedy=f"no pose.{key}; 'gesture plugins {pose.backend}' lists its options",
                code="E_OPTION",
            )
    options |= settings.options.get(pose.backend, {})
    backend: PoseBackend = plugins.make("pose", pose.backend, options, model=find_model(pose.model))
    if part := lacking("pose", backend):
        raise PluginError(
            f"{plugins.find('pose', pose.backend)}: {part}",
            remedy="another --pose, or report it",
            code="E_PLUGIN_CONTRACT",
        )
    return backend


def try_backend(backend: PoseBackend, people: str) -> None:
    """Run a pose network twice on a picture of a figure; a PoseError says what is wrong with its answer.

    Whether it finds anybody does not count: that both answers are equal, and of the right form, does.
    """
    picture = np.full((240, 320, 3), 90, np.uint8)
    picture[:, 110:210] += np.arange(240, dtype=np.uint8)[:, None, None] // 4
    picture[30:70, 145:175] = (140, 170, 210)  # a head above a trunk, arms and legs
    picture[75:150, 135:185] = (60, 60, 180)
    picture[80:95, 80:240] = (140, 170, 210)
    picture[150:230, 137:157] = picture[150:230, 163:183] = (120, 80, 50)
    with calling(backend):
        answers = [backend.estimate([picture], people) for _ in range(2)]
    width, fault = len(skeleton(backend.skeleton).joints), ""
    for answer in answers:
        if len(answer) != 1:
            raise PoseError(f"answered with {len(answer)} pictures for one", code="E_MODEL_PROBE")
        for person in answer[0]:
            if np.shape(person.keypoints) != (width, 2) or np.shape(person.scores) != (width,):
                fault = f"keypoints {np.shape(person.keypoints)} and scores {np.shape(person.scores)}"
                fault += f" for {width} joints"
            elif np.isinf(person.keypoints).any() or not np.isfinite(person.scores).all():
                fault = "infinite keypoints or scores"
            if fault:
                raise PoseError(fault, code="E_MODEL_PROBE")
    first, second = [np.array([p.keypoints for p in answer[0]]) for answer in answers]
    if first.shape != second.shape or not np.allclose(first, second, atol=0.01, equal_nan=True):
        raise PoseError("two answers to one picture differ", code="E_MODEL_PROBE")


def extract_poses(
    frames: Iterable[Frame],
    backend: PoseBackend,
    people: str = "single",
    *,
    follow: bool | None = None,
    steady: bool | None = None,
    parts: Parts | None = None,
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
    parts : Parts, optional
        From `gesture_core.pose.parts.open_parts`: people have hands or a face, and a skeleton with ``+hands``
        or ``+face``.
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
    joints = len(skeleton(backend.skeleton).joints)
    single = people == "single"
    follower = follower_of(backend, follow) if single else None
    steady = is_steady(backend) if steady is None else steady
    choice = JointChoice(skeleton(backend.skeleton)) if steady and single else None
    provenance = {
        "people": people,
        "follow": str(follower is not None),
        "steady": str(choice is not None),
        **(backend.provenance if isinstance(backend, Traceable) else {}),
    }
    tracker = None
    if not single:
        from gesture_core.pose.people import Tracker

        tracker = Tracker(len(parts.skeleton.joints) if parts else joints)
    name = parts.skeleton.name if parts else backend.skeleton
    size: tuple[int, int] | None = None
    times: list[float] = []
    points: list[np.ndarray] = []
    scores: list[np.ndarray] = []
    peaks: list[np.ndarray] = []
    found: list[Person] = []
    depths: list[np.ndarray | None] = []
    others = 0
    stream = iter(frames)
    while batch := list(islice(stream, backend.batch_size)):
        pictures = [frame for _, frame in batch]
        times += [time for time, _ in batch]
        size = size or (pictures[0].shape[1], pictures[0].shape[0])
        if tracker:
            for frame, everybody in zip(pictures, backend.estimate(pictures, people), strict=True):
                tracker.add([parts.whole(frame, one) for one in everybody] if parts else everybody)
            continue
        seen = follower.estimate(batch) if follower else _best(backend, pictures)
        if parts:
            found += [parts.find(frame, person) for frame, person in zip(pictures, seen, strict=True)]
        for person in seen:
            points.append(person.keypoints if person else np.full((joints, 2), np.nan))
            scores.append(person.scores if person else np.zeros(joints))
            depths.append(person.depth if person else None)
            others += bool(person and person.others)
            if choice:
                peaks.append(choice.peaks_of(person))
    at = np.array(times, np.float64)
    if tracker:
        return [
            PoseSequence(p, s, at[first : first + len(p)], name, size, i, source, provenance)
            for i, (first, p, s) in enumerate(tracker.tracks())
        ]
    if not times:
        return []
    if others:
        provenance["others"] = str(others)
    where, certain = np.stack(points), np.stack(scores)
    if choice:
        where, certain = choice.choose(where, certain, np.stack(peaks), at)
    depth = None
    if any(one is not None for one in depths):
        depth = np.stack([np.full(joints, np.nan) if one is None else one for one in depths])
    if parts:
        fine = [np.stack([getattr(one, kind) for one in found]) for kind in ("keypoints", "scores")]
        where, certain = parts.beside(where, certain, *fine)
        depth = None if depth is None else parts.depth(depth)
    return [PoseSequence(where, certain, at, name, size, 0, source, provenance, depth)]


def _best(backend: PoseBackend, pictures: Sequence[np.ndarray]) -> list[Person | None]:
    return [people[0] if people else None for people in backend.estimate(pictures)]


def follower_of(backend: PoseBackend, follow: bool | None = None) -> Follower | RegionFollower | None:
    """What follows one person for ``backend``; None where it is given whole pictures."""
    if follow is None:
        follow = isinstance(backend, CropFollowing) and backend.follow
    if not follow:
        return None
    if isinstance(backend, RegionFollowing) and backend.region:
        from gesture_core.pose.region import RegionFollower

        return RegionFollower(backend)
    return Follower(backend)


def is_steady(backend: PoseBackend) -> bool:
    """Whether limbs are chosen over time, where nobody says otherwise."""
    return backend.steady if isinstance(backend, CropFollowing) else True
