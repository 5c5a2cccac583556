"""What a video may cost at most: checked against headers before anything is decoded, and while decoding."""

from __future__ import annotations

from dataclasses import dataclass

from gesture_core.errors import ConfigError
from gesture_core.settings import LimitSettings

# Containers that count in milliseconds claim 1000 frames/s where they know of none.
MAX_FPS = 500.0


@dataclass(frozen=True)
class Limits:
    """Upper bounds on one video.

    Attributes
    ----------
    max_pixels : int
        Width times height of a frame; the default is that of the setting ``limits.pixels``.
    max_frames : int
        Frames that are decoded; the default is that of the setting ``limits.frames``.
    max_seconds : float
        Time stamp of the last frame, in seconds; the default is six hours.
    max_streams : int
        Streams that a container may announce.
    """

    max_pixels: int = LimitSettings.pixels
    max_frames: int = LimitSettings.frames
    max_seconds: float = 6 * 3600.0
    max_streams: int = 64

    def __post_init__(self) -> None:
        for name in ("max_pixels", "max_frames", "max_seconds", "max_streams"):
            if not getattr(self, name) > 0:
                raise ConfigError(
                    f"{name} is {getattr(self, name)!r}, it must be above zero", code="E_OPTION"
                )

    @classmethod
    def of(cls, settings: LimitSettings) -> Limits:
        """Those that a user asks for; what is no setting keeps its default."""
        return cls(max_pixels=settings.pixels, max_frames=settings.frames)
