"""Files that name their joints in words of their own: which of ours they are, and what is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.joint_names import joints_named
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import Skeleton, skeleton_of
from gesture_core.types import PoseSequence
from gesture_pose_files.layout import sequence
from gesture_pose_files.scores import in_unit

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
    for index, joint in enumerate(joints_named(names)):
        if joint is None or joint in found:
            unused.append(names[index])
        else:
            found[joint] = index
    body = skeleton_of(tuple(found))
    if not (body.has_neck or (options.whole and body.has_hands)):
        raise KeypointError(
            f"names the joints {_some(names)}, among which is neither a neck nor both shoulders",
            subject=source,
            remedy=f"--set keypoints.order=… with {len(names)} names such as neck, right_wrist",
            code="E_KEYPOINTS_SKELETON",
        )
    notes = (f"joints that are not used: {_some(unused)}",) if unused else ()
    return Named(body, list(found.values()), notes)


def order_of(names: Sequence[str]) -> tuple[str, ...]:
    """``names`` as `ReadOptions.order`; empty where they tell neither a neck nor both shoulders."""
    order: list[str] = []
    for number, joint in enumerate(joints_named(names)):
        order.append(joint if joint and joint not in order else f"unknown {number}")
    return tuple(order) if skeleton_of(tuple(order)).has_neck else ()


def people_of(
    named: Named,
    points: np.ndarray,
    scores: np.ndarray | None,
    options: ReadOptions,
    *,
    source: str,
    notes: Sequence[str] = (),
    **said: Any,
) -> list[PoseSequence]:
    """Each of P people whose joints a file names.

    Parameters
    ----------
    named : Named
    points : (P, T, N, 2) array
        x and y of all N names of the file, NaN where missing.
    scores : (P, T, N) array or None
    options : ReadOptions
    source : str
    notes : sequence of str
    said
        What else the file says, as `layout.sequence` takes it.
    """
    points = points[:, :, named.columns].astype(np.float64)
    sure = np.ones(points.shape[:3]) if scores is None else np.nan_to_num(scores[:, :, named.columns])
    sure, note = in_unit(sure, points, source)  # of all people alike
    missing = ~np.isfinite(points).all(axis=-1) | ~(sure > 0)
    notes = [*named.notes, *notes, *([note] if note else [])]
    return [
        sequence(
            np.where(missing[person][..., None], np.nan, points[person]),
            options,
            source=source,
            scores=np.where(missing[person], 0, sure[person]),
            body=named.body,
            axes="xy",
            notes=notes,
            **said,
        )
        for person in range(len(points))
    ]


def _some(names: Sequence[str]) -> str:
    shown = [name[:40] for name in names[:_SHOWN]]
    return ", ".join(shown) + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")
