"""From the people of each frame to one sequence for each person."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np

from gesture_core.pose import Tracker
from gesture_core.types import Person

# Joining people over frames is quadratic in them; those with the lowest scores are left out beyond this.
MAX_PEOPLE = 32
_SMALL = 10.0
Track = tuple[np.ndarray, np.ndarray]


def tracks(
    frames: Sequence[Sequence[Person]],
    joints: int,
    people: str,
    identities: Sequence[Sequence[int | None]] = (),
) -> list[Track]:
    """Keypoints (T, J, 2) and scores (T, J) of each person, strongest first, each as long as the file.

    Parameters
    ----------
    frames : sequence of sequences of Person
    joints : int
    identities : sequence of sequences of int or None, optional
        Of the same people, as the file numbers them; used where each has one of its own in every frame.
    people : "single" or "multi"
        ``"single"`` gives exactly one track: the person of each frame where no frame has two, else
        the strongest track, carried on by others that begin where it was last seen.
    """
    if people == "single" and all(len(frame) <= 1 for frame in frames):
        return [_alone(frames, joints)]
    if identities and all(_apart(frame) for frame in identities):
        found = _identified(frames, joints, identities)
    else:
        found = _tracked(frames, joints)
    if people == "multi":
        return found or [_alone([[] for _ in frames], joints)]
    return [_joined(found)] if found else [_alone([frame[:1] for frame in frames], joints)]


def left_out(
    frames: Sequence[Sequence[Person]], people: str, identities: Sequence[Sequence[int | None]] = ()
) -> list[str]:
    """A clause where more people are wanted than `tracks` gives."""
    numbered = bool(identities) and all(_apart(frame) for frame in identities)
    most = len({*chain(*identities)}) if numbered else max(map(len, frames), default=0)
    crowd = people == "multi" and most > MAX_PEOPLE
    return [f"of {most} people the {MAX_PEOPLE} best seen are read"] if crowd else []


def _alone(frames: Sequence[Sequence[Person]], joints: int) -> Track:
    points = np.full((len(frames), joints, 2), np.nan, np.float32)
    scores = np.zeros((len(frames), joints), np.float32)
    for index, frame in enumerate(frames):
        for person in frame:
            points[index], scores[index] = person.keypoints, person.scores
    return points, scores


def _apart(identities: Sequence[int | None]) -> bool:
    return None not in identities and len(set(identities)) == len(identities)


def _identified(
    frames: Sequence[Sequence[Person]], joints: int, identities: Sequence[Sequence[int | None]]
) -> list[Track]:
    by_person: dict[int | None, dict[int, Person]] = {}
    for index, (frame, names) in enumerate(zip(frames, identities, strict=True)):
        for one, name in zip(frame, names, strict=True):
            by_person.setdefault(name, {})[index] = one
    strongest = sorted(
        by_person.values(), key=lambda mine: -sum(float(p.scores.sum()) for p in mine.values())
    )
    return [
        _alone([[mine[index]] if index in mine else [] for index in range(len(frames))], joints)
        for mine in strongest[:MAX_PEOPLE]
    ]


def _tracked(frames: Sequence[Sequence[Person]], joints: int) -> list[Track]:
    factor = _to_pixels(frames)
    tracker = Tracker(joints)
    for frame in frames:
        best = sorted(frame, key=lambda person: -float(np.sum(person.scores)))[:MAX_PEOPLE]
        tracker.add([Person(person.keypoints * factor, person.scores) for person in best])
    out = []
    for first, points, scores in tracker.tracks():
        whole = np.full((len(frames), joints, 2), np.nan, np.float32)
        whole_scores = np.zeros((len(frames), joints), np.float32)
        whole[first : first + len(points)] = points / factor
        whole_scores[first : first + len(points)] = scores
        out.append((whole, whole_scores))
    return out


def _to_pixels(frames: Sequence[Sequence[Person]]) -> float:
    """The tracker measures in pixels; coordinates in shares of the picture are enlarged for it."""
    largest = max(
        (float(np.nanmax(np.abs(p.keypoints), initial=0)) for frame in frames for p in frame), default=0.0
    )
    return 1000.0 if 0 < largest < _SMALL else 1.0


def _joined(found: list[Track]) -> Track:
    """The strongest track, with later and earlier ones that meet it at one of its ends."""
    points, scores = found[0][0].copy(), found[0][1].copy()
    for other, other_scores in found[1:]:
        seen, also = _span(scores), _span(other_scores)
        if also[0] > seen[1]:
            meet = near(points[seen[1]], other[also[0]])
        elif also[1] < seen[0]:
            meet = near(points[seen[0]], other[also[1]])
        else:
            continue
        if meet:
            points[also[0] : also[1] + 1] = other[also[0] : also[1] + 1]
            scores[also[0] : also[1] + 1] = other_scores[also[0] : also[1] + 1]
    return points, scores


def _span(scores: np.ndarray) -> tuple[int, int]:
    seen = np.flatnonzero((scores > 0).any(axis=1))
    return (int(seen[0]), int(seen[-1])) if len(seen) else (0, len(scores) - 1)


def near(one: np.ndarray, two: np.ndarray) -> bool:
    """Whether two poses overlap: their joints are no further apart than the larger body's extent."""
    common = ~np.isnan(one[:, 0]) & ~np.isnan(two[:, 0])
    if not common.any():
        return False
    extent = max(float(np.nanmax(np.ptp(pose[~np.isnan(pose[:, 0])], axis=0))) for pose in (one, two))
    return float(np.linalg.norm(one[common] - two[common], axis=1).mean()) <= extent
