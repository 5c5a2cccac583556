"""Finds the face of a person whose body is known: in a square around eyes and nose, level between the eyes.

The network is that of MediaPipe's face mesh (Kartynnik et al. 2019). The detector that it comes with is not
needed: the body's network says where the face is.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gesture_core.joints import FACE
from gesture_core.pose.parts import PartFinder
from gesture_core.pose.region import Region, around
from gesture_core.types import Person

_SIDE = 3.6
"""Side of the square in distances between the eyes; its middle lies between them and the nose."""
_SMALLEST = 12.0
"""Pixels between the eyes: of smaller faces hardly any is seen, and lips of a pixel are guessed."""


class FaceFinder(PartFinder):
    """Finds the face."""

    part, model, revision = "face", "blazeface", 1
    joints, each = FACE, ("face",)
    needs = ("left_eye", "right_eye", "nose")
    smallest = _SIDE * _SMALLEST

    def squares(self, at: Mapping[str, np.ndarray], one: str) -> list[Region]:
        """One, by eyes and nose; none where one of them is missing."""
        left, right, nose = at["left_eye"], at["right_eye"], at["nose"]
        across = left - right
        apart = float(np.hypot(*across))
        x, y = ((left + right) / 4 + nose / 2).tolist()
        if not (0 < apart < 1e5 and np.isfinite([x, y]).all()):
            return []
        return [Region(x, y, _SIDE * apart, float(np.arctan2(across[1], across[0])))]

    def after(self, found: Person) -> Region | None:
        """Around all points of the network."""
        return around(found)
