"""How far keypoints of one network lie from those of another, in shoulder widths."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence

NECK, WRISTS = 1, [4, 7]
SHOULDERS = (2, 5)
SIDES = [
    (i, j)
    for i, j in enumerate(COCO18.mirror)
    if i < j and COCO18.joints[i].split("_")[1][:3] not in ("eye", "ear")
]
VISIBLE = 0.3
"""Score from which a joint of the teacher counts as visible."""


@dataclass(frozen=True)
class Comparison:
    """A student beside a teacher, over the joints that the teacher sees.

    Attributes
    ----------
    joints : (T, 18) array
        Distance in shoulder widths; NaN where the teacher or the student sees no joint.
    visible, found : (T, 18) bool arrays
        The teacher sees the joint; the student reports it.
    swapped, pairs : int
        Pairs of left and right joints that the student confuses, of those that can be told apart.
    """

    joints: np.ndarray
    visible: np.ndarray
    found: np.ndarray
    swapped: int
    pairs: int

    @classmethod
    def join(cls, parts: Iterable[Comparison]) -> Comparison:
        """All of them as one."""
        every = list(parts)
        return cls(
            np.concatenate([part.joints for part in every]),
            np.concatenate([part.visible for part in every]),
            np.concatenate([part.found for part in every]),
            sum(part.swapped for part in every),
            sum(part.pairs for part in every),
        )

    @property
    def wrist_median(self) -> float:
        """Of the wrists that both see."""
        return float(np.nanmedian(self.joints[:, WRISTS]))

    @property
    def pck(self) -> float:
        """Share of visible joints within half a shoulder width; a joint that is not found is outside."""
        return float((self.joints[self.visible] < 0.5).mean())

    @property
    def joints_found(self) -> float:
        """Share of visible joints that are reported at all."""
        return float(self.found[self.visible].mean())

    @property
    def frames_found(self) -> float:
        """Share of frames in which every visible joint is reported."""
        return float((self.found | ~self.visible).all(axis=1).mean())

    @property
    def swaps(self) -> float:
        """Share of pairs in which left and right are confused."""
        return self.swapped / max(self.pairs, 1)


def compare(student: PoseSequence, teacher: PoseSequence, witness: np.ndarray | None = None) -> Comparison:
    """Compare the same frames; the shoulder width is the teacher's median over the video.

    With a ``witness`` (T, 18, 2), only pairs whose sides it sees as the teacher does can be swapped: the
    peaks of a teacher who looks at whole pictures are at times those of a passer-by.
    """
    mine, theirs = student.onto("coco18"), teacher.onto("coco18")
    points = mine.keypoints
    visible = theirs.scores >= VISIBLE
    truth = np.where(visible[..., None], theirs.keypoints, np.nan)
    right, left = SHOULDERS
    width = float(np.nanmedian(np.linalg.norm(truth[:, right] - truth[:, left], axis=1)))
    swapped = pairs = 0
    for a, b in SIDES:
        straight = _length(points[:, a] - truth[:, a]) + _length(points[:, b] - truth[:, b])
        crossed = _length(points[:, a] - truth[:, b]) + _length(points[:, b] - truth[:, a])
        apart = ~np.isnan(straight) & (_length(truth[:, a] - truth[:, b]) > 0.4 * width)
        if witness is not None:
            kept = _length(witness[:, a] - truth[:, a]) + _length(witness[:, b] - truth[:, b])
            turned = _length(witness[:, a] - truth[:, b]) + _length(witness[:, b] - truth[:, a])
            apart &= kept < turned
        pairs += int(apart.sum())
        swapped += int((apart & (crossed < 0.5 * straight)).sum())
    return Comparison(_length(points - truth) / width, visible, ~np.isnan(points[..., 0]), swapped, pairs)


def _length(vectors: np.ndarray) -> np.ndarray:
    length: np.ndarray = np.linalg.norm(vectors, axis=-1)
    return length


def to_authors(pose: PoseSequence, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (T,18) to the published keypoints of a clip, as they are and after a fit of each frame.

    The authors' first frame is lost, and frames with a missing joint: where the table is shorter
    than that, the offset with the smallest mean distance counts. Only frames with all 18 joints count.
    """
    points = pose.onto("coco18").keypoints.astype(np.float64)
    best = (np.full((0, 18), np.inf), np.full((0, 18), np.inf))
    for offset in range(1, max(2, len(points) - len(table) + 1)):
        mine = points[offset : offset + len(table)]
        theirs = table[: len(mine)]
        whole = ~np.isnan(mine).any(axis=(1, 2))
        if not whole.any():
            continue
        mine, theirs = mine[whole], theirs[whole]
        right, left = SHOULDERS
        unit = np.linalg.norm(mine[:, right] - mine[:, left], axis=1)[:, None, None]
        plain = _length((mine - mine[:, NECK : NECK + 1]) / unit - theirs)
        if not len(best[0]) or plain.mean() < best[0].mean():
            best = plain, _length(_fitted(mine, theirs) - theirs)
    return best


def _fitted(mine: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Each frame moved and scaled onto the other with least squares."""
    a = mine - mine.mean(axis=1, keepdims=True)
    middle = theirs.mean(axis=1, keepdims=True)
    scale = (a * (theirs - middle)).sum(axis=(1, 2)) / (a**2).sum(axis=(1, 2))
    return a * scale[:, None, None] + middle
