"""Files that name their joints in words of their own: which of ours they are, and what is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.joint_names import joint_named
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import Skeleton, skeleton_of
from gesture_core.types import PoseSequence

_SHOWN = 8


@dataclass(frozen=True)
class Named:
    """The joints of a file that are known.

    Attributes
    ----------
    body : Skeleton
    columns : list of int
        Where each of its joints stands among the names of the file.
    notes : tuple of str
        Names that are not used.
    """

    body: Skeleton
    columns: list[int]
    notes: tuple[str, ...] = ()


def joints_among(names: Sequence[str], options: ReadOptions, source: str) -> Named:
    """The joints that ``names`` are; those of ``options.order`` in its place, where it has as many.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_SKELETON` where neither a neck nor both shoulders are among them.
    """
    if options.skeleton and len(options.skeleton.joints) == len(names):
        return Named(options.skeleton, list(range(len(names))))
    found: dict[str, int] = {}
    unused = []
    for index, name in enumerate(names):
        joint = joint_named(name)
        if joint is None or joint in found:
            unused.append(name)
        else:
            found[joint] = index
    body = skeleton_of(tuple(found))
    if not body.has_neck:
        raise KeypointError(
            f"names the joints {_some(names)}, among which is neither a neck nor both shoulders",
            subject=source,
            remedy=f"--set keypoints.order=… with {len(names)} names such as neck, right_wrist",
            code="E_KEYPOINTS_SKELETON",
        )
    notes = (f"joints that are not used: {_some(unused)}",) if unused else ()
    return Named(body, list(found.values()), notes)


def best(found: Sequence[PoseSequence], people: str) -> list[PoseSequence]:
    """Everybody who is ever seen, or of several the person with the highest scores, with a note."""
    seen = [one for one in found if one.frames_with_pose] or list(found[:1])
    if people == "multi" or len(seen) < 2:
        return [replace(one, person=number) for number, one in enumerate(seen)]
    chosen = max(seen, key=lambda one: float(one.scores.sum()))
    notes = [note for note in (chosen.provenance.get("notes"),) if note]
    notes.append(f"the best of {len(seen)} people or tracks")
    return [replace(chosen, person=0, provenance={**chosen.provenance, "notes": "; ".join(notes)})]


def seen_or_nan(points: np.ndarray, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and scores, NaN and zero in joints whose coordinates or score are missing."""
    missing = ~np.isfinite(points).all(axis=-1) | ~(scores > 0)
    return np.where(missing[..., None], np.nan, points), np.where(missing, 0, scores)


def _some(names: Sequence[str]) -> str:
    shown = [name[:40] for name in names[:_SHOWN]]
    return ", ".join(shown) + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")
