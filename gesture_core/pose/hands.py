"""Finds the hands of a person whose body is known: in a square at each wrist, turned along the forearm.

A network such as BlazeHand (Zhang et al. 2020) sees nothing but this square. The next one follows from the
knuckles that it found; where the hand is lost, from the arm. The side is that of the arm.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.pose.region import Region
from gesture_core.skeletons import HANDS42, Skeleton
from gesture_core.types import Person

if TYPE_CHECKING:
    from gesture_core.pose.network import NetworkBackend
    from gesture_core.settings import Settings

MODEL = "blazehand"
REVISION = 2
"""Of what is found by the same network, for what is kept of videos."""
LEAST = 0.5
"""Presence from which a hand is one."""
_MAYBE = 0.1
"""Presence from which a first look at an arm is followed by one at what it showed."""
_SMALLEST = 25.0
"""Pixels of the side of the square of an arm: fingers of two pixels are guessed."""
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
_FAR, _LARGEST = 0.8, 2.5
"""Sides of the square of its arm that a hand may be away, and that its own may have."""


def open_hands(settings: Settings, body: str, threads: int = 0) -> HandFinder | None:
    """What finds the hands that ``settings`` ask for on bodies of the skeleton ``body``; None for none.

    Raises
    ------
    ModelError
        ``E_MODEL_MISSING`` where the network is not here.
    """
    if "hands" not in settings.keypoints.parts:
        return None
    from gesture_core.plugin.registry import registry
    from gesture_core.pose.models import backend_name, find_model
    from gesture_core.skeletons import skeleton

    model = find_model(MODEL)
    network = registry().make("pose", backend_name(model), {"presence": 0.0}, model=model, threads=threads)
    return HandFinder(network, skeleton(body))


@dataclass
class HandFinder:
    """Finds hands in frames, given in order.

    Attributes
    ----------
    network : NetworkBackend
        Of one hand in a square.
    body : Skeleton
        Of the people.
    looks : int
        Squares that were looked at.
    """

    network: NetworkBackend
    body: Skeleton
    looks: int = 0
    _last: dict[str, Region] = field(default_factory=dict)

    def find(self, frame: np.ndarray, person: Person | None, *, follow: bool = True) -> Person:
        """Both hands of ``person`` in ``frame``, (H, W, 3) uint8 in BGR: keypoints (42, 2), scores (42,).

        The score of all joints of a hand is its presence. Without ``follow``, nothing is known of the frames
        before.
        """
        points = np.full((len(HANDS42.joints), 2), np.nan, np.float32)
        scores = np.zeros(len(points), np.float32)
        for number, side in enumerate(_SIDES):
            arms = [] if person is None else self._arm(person.keypoints, side)
            last = self._last.pop(side, None) if follow else None
            hand = self._hand(frame, arms, last) if arms else None
            if hand is None:
                continue
            own = slice(21 * number, 21 * (number + 1))
            points[own], scores[own] = hand.keypoints, hand.presence
            if follow and (after := after_landmarks(hand.keypoints)):
                self._last[side] = after
        return Person(points, scores)

    def _hand(self, frame: np.ndarray, arms: list[Region], last: Region | None) -> Person | None:
        if arms[0].side < _SMALLEST:
            return None
        if last and _near(last, arms[0]) and (hand := self._look(frame, last, LEAST)):
            return hand
        for arm in arms:
            first = self._look(frame, arm, _MAYBE)
            again = after_landmarks(first.keypoints) if first else None
            if again and _near(again, arm) and (hand := self._look(frame, again, LEAST)):
                return hand
        return None

    def _look(self, frame: np.ndarray, region: Region, least: float) -> Person | None:
        self.looks += 1
        pixels = self.network.region
        person = self.network.estimate([region.view(frame, pixels)])[0][0]
        return region.back(person, pixels) if person.presence >= least else None

    def _arm(self, points: np.ndarray, side: str) -> list[Region]:
        """The squares at the end of an arm, none where wrist or elbow is missing: along the forearm; upright,
        for one that points at the camera; and a wider one, where the wrist is not where it was found."""
        at = {joint: points[place] for place, joint in enumerate(self.body.joints)}
        wrist, elbow = at[f"{side}_wrist"], at[f"{side}_elbow"]
        if np.isnan([*wrist, *elbow]).any():
            return []
        shoulders, hips = (
            np.array([at[f"{one}_{joint}"] for one in _SIDES]) for joint in ("shoulder", "hip")
        )
        along = wrist - elbow
        lengths = (
            np.linalg.norm(along),
            _UPPER_ARM * np.linalg.norm(elbow - at[f"{side}_shoulder"]),
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


def _near(region: Region, arm: Region) -> bool:
    """Whether a square may be that of the hand of an arm."""
    away = float(np.hypot(region.x - arm.x, region.y - arm.y))
    return away < _FAR * arm.side and _SMALLEST / 2 < region.side < _LARGEST * arm.side
