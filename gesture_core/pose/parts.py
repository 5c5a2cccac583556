"""Finds hands and faces of a person whose body is known: each in a square that follows from the body.

A network of one hand or face sees nothing but this square. The next one follows from what was found in it;
where that is lost, from the body.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from gesture_core.errors import ConfigError
from gesture_core.pose.region import Region
from gesture_core.skeletons import Skeleton, skeleton, with_parts
from gesture_core.types import Person

if TYPE_CHECKING:
    from gesture_core.pose.network import NetworkBackend
    from gesture_core.settings import Settings

LEAST = 0.5
"""Presence from which a hand or face is one."""
_MAYBE = 0.1
"""Presence from which a first look at a square of the body is followed by one at what it showed."""
_FAR, _LARGEST = 0.8, 2.5
"""Sides of the square of the body that one may be away, and that its own may have."""


@dataclass
class PartFinder(ABC):
    """Finds the hands, or the face, of a person in frames, given in order.

    Attributes
    ----------
    network : NetworkBackend
        Of one hand or face in a square.
    body : Skeleton
        Of the people.
    looks : int
        Squares that were looked at.
    """

    part: ClassVar[str]
    """As ``keypoints.parts`` has it."""
    model: ClassVar[str]
    """Name of the network."""
    revision: ClassVar[int]
    """Of what is found by the same network, for what is kept of videos."""
    joints: ClassVar[tuple[str, ...]]
    each: ClassVar[tuple[str, ...]]
    """What is found one by one, each with its share of the joints."""
    needs: ClassVar[tuple[str, ...]]
    """Joints of the body."""
    smallest: ClassVar[float]
    """Pixels of the side of a square of the body below which nothing is looked at."""

    network: NetworkBackend
    body: Skeleton
    looks: int = 0
    _last: dict[str, Region] = field(default_factory=dict)

    @abstractmethod
    def squares(self, at: Mapping[str, np.ndarray], one: str) -> list[Region]:
        """Where to look for ``one``, by the places of the body's joints; none where they do not say."""

    @abstractmethod
    def after(self, found: Person) -> Region | None:
        """The square in which what was found is seen best; None for none."""

    def find(self, frame: np.ndarray, person: Person | None, *, follow: bool = True) -> Person:
        """The joints in ``frame``, (H, W, 3) uint8 in BGR, of ``person``; their score is the presence.

        Without ``follow``, nothing is known of the frames before.
        """
        points = np.full((len(self.joints), 2), np.nan, np.float32)
        scores = np.zeros(len(points), np.float32)
        share = len(points) // len(self.each)
        at = {} if person is None else dict(zip(self.body.joints, person.keypoints, strict=True))
        for number, one in enumerate(self.each):
            squares = self.squares(at, one) if at else []
            last = self._last.pop(one, None) if follow else None
            found = self._one(frame, squares, last) if squares else None
            if found is None:
                continue
            own = slice(share * number, share * (number + 1))
            points[own], scores[own] = found.keypoints, found.presence
            if follow and (after := self.after(found)):
                self._last[one] = after
        return Person(points, scores)

    def _one(self, frame: np.ndarray, squares: list[Region], last: Region | None) -> Person | None:
        if squares[0].side < self.smallest:
            return None
        if last and self._near(last, squares[0]) and (found := self._look(frame, last, LEAST)):
            return found
        for square in squares:
            first = self._look(frame, square, _MAYBE)
            again = self.after(first) if first else None
            if again and self._near(again, square) and (found := self._look(frame, again, LEAST)):
                return found
        return None

    def _look(self, frame: np.ndarray, region: Region, least: float) -> Person | None:
        self.looks += 1
        pixels = self.network.region
        person = self.network.estimate([region.view(frame, pixels)])[0][0]
        return region.back(person, pixels) if person.presence >= least else None

    def _near(self, region: Region, square: Region) -> bool:
        """Whether a square may be that of what the body has there."""
        away = float(np.hypot(region.x - square.x, region.y - square.y))
        return away < _FAR * square.side and self.smallest / 2 < region.side < _LARGEST * square.side


class Parts:
    """All that is looked for beside a body.

    Parameters
    ----------
    finders : sequence of PartFinder
        One at least, of the same body.

    Attributes
    ----------
    skeleton : Skeleton
        The body and what is looked for.
    """

    def __init__(self, finders: Sequence[PartFinder]) -> None:
        self._finders = finders
        self.skeleton = with_parts(finders[0].body.name, [finder.part for finder in finders])
        self._places = [self.skeleton.index(joint) for finder in finders for joint in finder.joints]

    def find(self, frame: np.ndarray, person: Person | None) -> Person:
        """What is found of ``person`` in the next frame, for `beside`."""
        return self._find(frame, person, follow=True)

    def whole(self, frame: np.ndarray, person: Person) -> Person:
        """One of several people in a frame, with what is found of them; nothing is known of other frames."""
        fine = self._find(frame, person, follow=False)
        points, scores = self.beside(person.keypoints, person.scores, fine.keypoints, fine.scores)
        return replace(person, keypoints=points, scores=scores)

    def beside(
        self, points: np.ndarray, scores: np.ndarray, found: np.ndarray, sure: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Points (..., J, 2) and scores (..., J) of bodies with what was found beside them.

        Corners of the eyes and the mouth that a body has of its own give way to those of the face, or none.
        """
        joints = len(self.skeleton.joints)
        where = np.full((*scores.shape[:-1], joints, 2), np.nan, points.dtype)
        certain = np.zeros((*scores.shape[:-1], joints), scores.dtype)
        where[..., : points.shape[-2], :], certain[..., : scores.shape[-1]] = points, scores
        where[..., self._places, :], certain[..., self._places] = found, sure
        return where, certain

    def depth(self, depth: np.ndarray) -> np.ndarray:
        """Depths (..., J) of bodies, with none of what is found beside them."""
        deep = np.full((*depth.shape[:-1], len(self.skeleton.joints)), np.nan, depth.dtype)
        deep[..., : depth.shape[-1]] = depth
        deep[..., self._places] = np.nan
        return deep

    def _find(self, frame: np.ndarray, person: Person | None, follow: bool) -> Person:
        found = [finder.find(frame, person, follow=follow) for finder in self._finders]
        points = np.concatenate([one.keypoints for one in found])
        return Person(points, np.concatenate([one.scores for one in found]))


def finders_of(parts: Collection[str]) -> list[type[PartFinder]]:
    """What finds those of ``parts`` that networks of their own find in videos."""
    found: list[type[PartFinder]] = []
    if "hands" in parts:
        from gesture_core.pose.hands import HandFinder

        found.append(HandFinder)
    if "face" in parts:
        from gesture_core.pose.faces import FaceFinder

        found.append(FaceFinder)
    return found


def open_parts(settings: Settings, body: str, threads: int = 0) -> Parts | None:
    """What finds the parts that ``settings`` ask for beside bodies of the skeleton ``body``; None for none.

    Raises
    ------
    ModelError
        ``E_MODEL_MISSING`` where a network is not here.
    ConfigError
        ``E_OPTION`` where the body has no joints that say where to look.
    """
    from gesture_core.plugin.registry import registry
    from gesture_core.pose.models import backend_name, find_model

    finders = []
    for finder in finders_of(settings.keypoints.parts):
        if lacking := [joint for joint in finder.needs if joint not in skeleton(body).joints]:
            raise ConfigError(
                f"{finder.part}: the network of the body, with joints as {body}, has no {', '.join(lacking)}",
                remedy="another --model, or other keypoints.parts",
                code="E_OPTION",
            )
        model = find_model(finder.model)
        network = registry().make(
            "pose", backend_name(model), {"presence": 0.0}, model=model, threads=threads
        )
        finders.append(finder(network, skeleton(body)))
    return Parts(finders) if finders else None
