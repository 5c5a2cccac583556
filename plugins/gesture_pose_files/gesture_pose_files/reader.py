"""What all readers of this plugin share: options, the choice of a clip, and of a person."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from gesture_core.errors import KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.types import PoseSequence

Clip = TypeVar("Clip")
_SHOWN = 5


@dataclass(frozen=True)
class Reader:
    """A reader by the user's options.

    Attributes
    ----------
    options : ReadOptions
        What files leave open.
    people : "single" or "multi"
        Of several people the one whose scores sum to the most, or everybody.
    """

    options: ReadOptions = field(default_factory=ReadOptions)
    people: str = "single"

    def __post_init__(self) -> None:
        if self.people not in ("single", "multi"):
            raise ValueError(f"people is {self.people!r}, it must be 'single' or 'multi'")

    def best(
        self, found: Sequence[PoseSequence], source: str, names: Sequence[str] = ()
    ) -> list[PoseSequence]:
        """Everybody who is ever seen, or of several the one with the highest scores, with a note.

        ``names`` are those of the people, where the file has some.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_EMPTY` where the file has nobody at all.
        """
        if not found:
            raise KeypointError("holds nobody", subject=source, code="E_KEYPOINTS_EMPTY")
        seen = [number for number, one in enumerate(found) if one.frames_with_pose] or [0]
        if self.people == "multi" or len(seen) == 1:
            return [replace(found[number], person=person) for person, number in enumerate(seen)]
        chosen = max(seen, key=lambda number: float(found[number].scores.sum()))
        name = f", {names[chosen]}" if names and names[chosen] else ""
        note = f"the best of {len(seen)} people or tracks{name}"
        return [replace(noted(found[chosen], note), person=0)]


class OneClipReader(Reader, ABC):
    """A reader of files that hold one clip each."""

    def members(self, path: Path) -> list[str]:
        """``[""]``: a file is one clip."""
        return [""]

    def read(self, path: Path, member: str = "") -> list[PoseSequence]:
        """The people in the file.

        Raises
        ------
        KeypointError
            `E_KEYPOINTS_MEMBER` where one is asked for, `E_KEYPOINTS_FORMAT`, `E_KEYPOINTS_BROKEN`,
            `E_KEYPOINTS_EMPTY`, and those of `files.open_keypoints` and `layout.sequence`.
        """
        source = printable(path)
        if member:
            raise KeypointError(
                f"is one clip, it has no member {member!r}", subject=source, code="E_KEYPOINTS_MEMBER"
            )
        return self.sequences(path, source)

    @abstractmethod
    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The people in the file ``path``, which errors call ``source``."""


def noted(pose: PoseSequence, note: str) -> PoseSequence:
    """``pose`` with a further clause among its notes."""
    notes = "; ".join(filter(None, (pose.provenance.get("notes"), note)))
    return replace(pose, provenance={**pose.provenance, "notes": notes})


def with_lost(pose: PoseSequence, lost: Sequence[KeypointError]) -> PoseSequence:
    """``pose`` with word of its frames that cannot be read."""
    if not lost:
        return pose
    cause = f"{len(lost)} of {len(pose)} frames cannot be read: {lost[0].subject}: {lost[0].cause}"
    return replace(pose, provenance={**pose.provenance, "lost": cause, "lost_frames": str(len(lost))})


def clip_called(member: str, found: Mapping[str, Clip], path: Path, what: str = "clips") -> Clip:
    """The one of the clips in ``path`` that is called ``member``; the only one where that is empty.

    Raises
    ------
    KeypointError
        `E_KEYPOINTS_MEMBER`.
    """
    if not member and len(found) == 1:
        return next(iter(found.values()))
    if member not in found:
        names = ", ".join(list(found)[:_SHOWN]) + (", …" if len(found) > _SHOWN else "")
        raise KeypointError(
            f"holds {len(found)} {what}, and {member!r} is none of them",
            subject=printable(path),
            remedy=f"one of {names}",
            code="E_KEYPOINTS_MEMBER",
        )
    return found[member]
