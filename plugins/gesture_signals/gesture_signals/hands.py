"""Hands at their wrists and a face at its eyes, each in its own scale and turn, beside the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gesture_core.errors import PoseError
from gesture_core.joints import FACE
from gesture_core.skeletons import COCO18, HANDS42, with_parts
from gesture_core.types import PoseSequence
from gesture_signals.normalizers import Torso, median_over_time

PALM, EYES = 0.2, 0.13
"""Torso lengths from the wrist to the knuckles of the fingers, and from pupil to pupil: of a body, everything
then has one unit."""
_WHOLE = with_parts(COCO18.name, ("hands", "face"))
_AT = {joint: place for place, joint in enumerate(_WHOLE.joints)}
_BODY = slice(0, len(COCO18.joints))
_KNUCKLES = ("index_mcp", "middle_mcp", "ring_mcp", "pinky_mcp")
_ACROSS = 1.2
"""Lengths of a palm in its breadth, which is seen where the palm points at the camera."""
_TINY = 1e-6


@dataclass(frozen=True)
class HandsNormalizer(Torso):
    """The body as `TorsoNormalizer` has it, hands and face each in a frame of its own.

    A hand has its wrist at the origin and its palm at `PALM` torso lengths; a face has the middle of its eyes
    at the origin, its pupils `EYES` apart on a level line. Where there is no body at all, the wrists take the
    place of one: they are seen from the middle of their ways, in the unit of the palms.

    Parameters
    ----------
    turn : "forearm", "hand" or "none"
        What points up in the frame of a hand: the forearm, or the hand itself where none is seen; always the
        hand; or what does so in the picture.
    steady : float
        Seconds of the running median of the size of a palm.
    face : bool
        Take the face, too.
    """

    turn: Literal["forearm", "hand", "none"] = "forearm"
    steady: float = 1.0
    face: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.turn not in ("forearm", "hand", "none") or not self.steady >= 0:
            raise ValueError(
                f"turn {self.turn!r} is none of forearm, hand, none, or steady {self.steady} < 0"
            )

    @property
    def skeleton(self) -> str:
        """``coco18+hands``, and ``+face`` where it is taken."""
        return _WHOLE.name if self.face else _WHOLE.name.removesuffix("+face")

    def normalize(self, pose: PoseSequence) -> np.ndarray:
        """(T, 60 or 80, 2) float64 in torso lengths; NaN where a joint or its frame is missing."""
        points = pose.keypoints.astype(np.float64)
        if points.shape[2] != 2:
            raise PoseError(
                "hands are compared in the plane",
                subject=pose.source,
                remedy="--set keypoints.depth=false",
                code="E_POSE_SCALE",
            )
        out = np.full(points.shape, np.nan)
        palms = {side: self._palm(points, side, pose.times) for side in ("left", "right")}
        if np.isfinite(points[:, _AT["neck"]]).any():
            out[:, _BODY] = self.scaled(pose)[:, _BODY]
        else:
            out[:, _BODY] = _wrists(points, palms, pose)
        for side, palm in palms.items():
            own = [_AT[joint] for joint in HANDS42.joints if joint.startswith(side)]
            hand = points[:, own] - points[:, own[:1]]
            up = hand[:, HANDS42.joints.index("left_middle_mcp")]
            if self.turn == "forearm":
                arm = points[:, _AT[f"{side}_wrist"]] - points[:, _AT[f"{side}_elbow"]]
                up = np.where(np.isfinite(arm).all(axis=1, keepdims=True), arm, up)
            if self.turn != "none":
                hand = _turned(hand, np.stack([-up[:, 1], up[:, 0]], axis=1))
            out[:, own] = PALM * hand / palm[:, None, None]
        if not self.face:
            return out
        face = [_AT[joint] for joint in FACE]
        right, left = (_eye(points, side) for side in ("right", "left"))
        apart = np.linalg.norm(left - right, axis=1)
        apart = np.where(apart > _TINY, apart, np.nan)
        seen = points[:, face] - ((right + left) / 2)[:, None]
        out[:, face] = EYES * _turned(seen, left - right) / apart[:, None, None]
        return out

    def on_stream(self) -> HandsNormalizer:
        """The same: its scales are running ones."""
        return self

    def _palm(self, points: np.ndarray, side: str, times: np.ndarray) -> np.ndarray:
        """(T,) length of a palm in the unit of ``points``, NaN where the hand is never seen."""
        wrist = points[:, _AT[f"{side}_hand_wrist"]]
        knuckles = np.stack([points[:, _AT[f"{side}_{joint}"]] for joint in _KNUCKLES])
        lengths = np.stack(
            [
                *np.linalg.norm(knuckles - wrist, axis=2),
                _ACROSS * np.linalg.norm(knuckles[0] - knuckles[-1], axis=1),
            ]
        )
        palm = lengths.max(axis=0)
        palm = np.where(palm > _TINY, palm, np.nan)
        if not np.isfinite(palm).any():
            return palm
        return median_over_time(palm, times, self.steady)


def _eye(points: np.ndarray, side: str) -> np.ndarray:
    """(T, 2) an eye: the middle of its corners, else what the body's network calls the eye."""
    corners = (points[:, _AT[f"{side}_eye_inner"]] + points[:, _AT[f"{side}_eye_outer"]]) / 2
    return np.where(np.isfinite(corners), corners, points[:, _AT[f"{side}_eye"]])


def _turned(points: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(T, N, 2) ``points`` as seen where the (T, 2) vectors ``right`` point to the right."""
    length = np.linalg.norm(right, axis=1, keepdims=True)
    x = np.divide(right, length, out=np.full_like(right, np.nan), where=length > _TINY)
    y = np.stack([-x[:, 1], x[:, 0]], axis=1)
    turned: np.ndarray = np.stack([np.einsum("tnc,tc->tn", points, axis) for axis in (x, y)], axis=2)
    return turned


def _wrists(points: np.ndarray, palms: dict[str, np.ndarray], pose: PoseSequence) -> np.ndarray:
    """(T, 18, 2) a body of which the wrists alone are known, by the hands."""
    out = np.full((len(points), len(COCO18.joints), 2), np.nan)
    sizes = np.concatenate([palm[np.isfinite(palm)] for palm in palms.values()])
    if not len(sizes):
        raise PoseError(
            "neither a neck nor a hand is seen, so that nothing has an origin",
            subject=pose.source,
            remedy="a clip in which a body or a hand is seen; --set keypoints.parts=body,hands keeps hands",
            code="E_POSE_SCALE",
        )
    wrists = np.stack([points[:, _AT[f"{side}_hand_wrist"]] for side in palms], axis=1)
    middle = np.mean(
        [np.nanmean(way, axis=0) for way in wrists.swapaxes(0, 1) if np.isfinite(way).any()], axis=0
    )
    out[:, [_AT[f"{side}_wrist"] for side in palms]] = (wrists - middle) * PALM / float(np.median(sizes))
    return out
