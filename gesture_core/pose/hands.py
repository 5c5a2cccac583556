"""Finds both hands of a person whose body is known: in a square at each wrist, turned along the forearm.

The network is BlazeHand (Zhang et al. 2020). The side is that of the arm.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gesture_core.joints import HANDS
from gesture_core.pose.parts import PartFinder
from gesture_core.pose.region import Region
from gesture_core.types import Person

_SIDES = ("left", "right")
# Lengths in forearms: the upper arm, the torso and the shoulders of a body of which less is seen.
_UPPER_ARM, _TORSO, _SHOULDERS = 0.9, 0.5, 0.65
_MIDDLE, _SIDE = 0.2, 1.0
"""Forearms from the wrist to the middle of the square, and its side."""
_WIDE = 1.4
"""Side of the square around the wrist in which a hand is looked for last."""
_ROOM, _SHIFT = 2.0, 0.1
"""Side of the next square over the box around palm and lower fingers, and its way towards the tips."""
_PALM = (0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18)


class HandFinder(PartFinder):
    """Finds both hands."""

    part, model, revision = "hands", "blazehand", 2
    joints, each = HANDS, _SIDES
    needs = tuple(f"{side}_{joint}" for side in _SIDES for joint in ("wrist", "elbow", "shoulder", "hip"))
    smallest = 25.0  # fingers of two pixels are guessed

    def squares(self, at: Mapping[str, np.ndarray], one: str) -> list[Region]:
        """At the end of an arm, none where wrist or elbow is missing: along the forearm; upright, for one
        that points at the camera; and a wider one, where the wrist is not where it was found."""
        wrist, elbow = at[f"{one}_wrist"], at[f"{one}_elbow"]
        if np.isnan([*wrist, *elbow]).any():
            return []
        shoulders, hips = (
            np.array([at[f"{side}_{joint}"] for side in _SIDES]) for joint in ("shoulder", "hip")
        )
        along = wrist - elbow
        lengths = (
            np.linalg.norm(along),
            _UPPER_ARM * np.linalg.norm(elbow - at[f"{one}_shoulder"]),
            _TORSO * np.linalg.norm(shoulders.mean(axis=0) - hips.mean(axis=0)),
            _SHOULDERS * np.linalg.norm(shoulders[0] - shoulders[1]),
        )
        length = float(np.nanmax(lengths))
        if not (lengths[0] > 0 and 2 < length < 1e5):
            return []
        squares = []
        for way in (along / lengths[0], np.array([0.0, -1.0])):
            x, y = (wrist + _MIDDLE * length * way).tolist()
            squares.append(Region(x, y, _SIDE * length, float(np.arctan2(way[0], -way[1]))))
        x, y = wrist.tolist()
        return [*squares, Region(x, y, _WIDE * length, squares[0].angle)]

    def after(self, found: Person) -> Region | None:
        """As `after_landmarks`."""
        return after_landmarks(found.keypoints)


def after_landmarks(hand: np.ndarray) -> Region | None:
    """The square in which a hand with the (21, 2) joints ``hand`` is seen best; None for none."""
    fingers = (hand[6] + hand[14]) / 4 + hand[10] / 2
    along = fingers - hand[0]
    length = float(np.linalg.norm(along))
    if not 1 < length < 1e5:
        return None
    along = along / length
    across = np.array([-along[1], along[0]])
    places = np.stack([hand[list(_PALM)] @ across, hand[list(_PALM)] @ along])
    low, high = places.min(axis=1), places.max(axis=1)
    side = float((high - low).max())
    middle = (low + high) / 2
    x, y = (middle[0] * across + (middle[1] + _SHIFT * side) * along).tolist()
    return Region(x, y, _ROOM * side, float(np.arctan2(along[0], -along[1])))
