"""What a video may cost at most: checked against headers before anything is decoded, and while decoding."""

from __future__ import annotations

from dataclasses import dataclass

from gesture_core.errors import ConfigError

# Containers that count in milliseconds claim 1000 frames/s where they know of none.
MAX_FPS = 500.0


@dataclass(frozen=True)
class Limits:
    """Upper bounds on one video.

    Attributes
    ----------
    max_pixels : int
        Width times height of a frame; the default is one 8K UHD picture (7680 x 4320).
    max_frames : int
        Frames that are decoded; the default is more than four and a half hours at 30 frames/s.
    max_seconds : float
        Time stamp of the last frame, in seconds; the default is six hours.
    max_streams : int
        Streams that a container may announce.
    """

    max_pixels: int = 7680 * 4320
    max_frames: int = 500_000
    max_seconds: float = 6 * 3600.0
    max_streams: int = 64

    def __post_init__(self) -> None:
        for name in ("max_pixels", "max_frames", "max_seconds", "max_streams"):
            if not getattr(self, name) > 0:
                raise ConfigError(
                    f"{name} is {getattr(self, name)!r}, it must be above zero", code="E_OPTION"
                )
