"""What is known of a video: before decoding (`MediaInfo`) and after it (`MediaReport`)."""

from __future__ import annotations

from dataclasses import dataclass, field

MAX_NOTES = 12
SQUARE = "pixels are not square ({}:{}); pictures are used as they are stored"


@dataclass(frozen=True)
class MediaInfo:
    """What the container says of its video stream.

    Attributes
    ----------
    width, height : int
        Pixels of the upright picture.
    frames_declared : int or None
        Number of frames that the header claims, None where it claims none or nonsense. Never
        used to allocate anything.
    fps : float or None
        Average frames a second, None where the container does not say.
    rotation : int
        Degrees clockwise by which stored pictures are turned to stand upright: 0, 90, 180, 270.
    mirrored : bool
        The stored pictures are also flipped left to right, after the rotation.
    codec : str
        FFmpeg's name of the codec.
    container : str
        FFmpeg's name of the container format.
    reader : str
        `pyav` or `opencv`.
    """

    width: int
    height: int
    frames_declared: int | None
    fps: float | None
    rotation: int
    codec: str
    container: str
    reader: str
    mirrored: bool = False


@dataclass(frozen=True)
class MediaReport:
    """What became of a video.

    Attributes
    ----------
    frames_declared : int or None
        As in `MediaInfo`.
    frames_read : int
        Frames that were handed out.
    damaged : int
        Corrupt packets and frames, decoding errors, and frames that are known to be lost.
    complete : bool
        The video was read to its end and nothing was found damaged or missing.
    notes : tuple of str
        What was found, one clause each.
    reader : str
        `pyav` or `opencv`.
    """

    frames_declared: int | None
    frames_read: int
    damaged: int
    complete: bool
    notes: tuple[str, ...] = ()
    reader: str = ""


@dataclass
class Ledger:
    """The running account that a decoder keeps of what it lost.

    `damaged` counts events that prove damage; `notes` maps a clause to how often it was noted.
    """

    damaged: int = 0
    notes: dict[str, int] = field(default_factory=dict)

    def damage(self, clause: str, count: int = 1) -> None:
        """Say what was damaged; ``count`` is how many packets or frames the clause speaks of."""
        self.damaged += count
        self.note(clause)

    def note(self, clause: str) -> None:
        """Say something that is worth knowing and harmless; a hostile file cannot say it without end."""
        if clause not in self.notes and len(self.notes) >= MAX_NOTES:
            clause = "and more"
        self.notes[clause] = self.notes.get(clause, 0) + 1

    def clauses(self) -> tuple[str, ...]:
        """The notes as text, with their count where it is above one."""
        return tuple(
            clause if count == 1 else f"{clause} ({count} times)" for clause, count in self.notes.items()
        )
