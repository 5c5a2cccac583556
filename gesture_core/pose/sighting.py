"""A person whose joints may be in more than one place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.plugin.interfaces import Person


@dataclass(frozen=True, eq=False)
class Sighting(Person):
    """A person with every place where the network saw each joint.

    A backend that returns these rather than `Person` lets `gesture_core.pose.steady` choose among them.

    Attributes
    ----------
    peaks : (J, K, 3) float32
        x, y and score of each peak, the highest first; NaN, NaN, 0 beyond the last. The first need
        not be a keypoint: it may be too low to count by itself.
    """

    peaks: np.ndarray


def moved(person: Person, offset: tuple[float, float]) -> Person:
    """``person`` seen in a part of a frame, in pixels of the frame; ``offset`` is that part's corner."""
    keypoints = person.keypoints + np.array(offset, np.float32)
    if not isinstance(person, Sighting):
        return Person(keypoints, person.scores)
    return Sighting(keypoints, person.scores, person.peaks + np.array([*offset, 0], np.float32))
