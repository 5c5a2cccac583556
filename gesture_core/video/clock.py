"""Time stamps of frames: taken from the container, repaired where they are absent or run backwards."""

from __future__ import annotations

import math

from gesture_core.video.info import Ledger

DEFAULT_FPS = 25.0
_LEAP = 3600.0


class Clock:
    """Turns the container's stamps into seconds that never decrease.

    A stamp that runs backwards, or an hour ahead, starts a new stretch, one frame after the last: what
    follows keeps its pace. An absent stamp is one frame after the last.

    Parameters
    ----------
    fps : float or None
        Frames a second for frames without a stamp; 25 where the container says nothing, and the
        ledger says so.
    ledger : Ledger
        Where repairs are noted.
    """

    def __init__(self, fps: float | None, ledger: Ledger) -> None:
        self._step = 1 / (fps or DEFAULT_FPS)
        self._assumed = fps is None
        self._ledger = ledger
        self._offset = 0.0
        self._last: float | None = None

    def at(self, stamp: float | None) -> float:
        """Seconds of the next frame, whose stamp is ``stamp`` seconds or None."""
        following = 0.0 if self._last is None else self._last + self._step
        if stamp is None or not math.isfinite(stamp):
            rate = f"{1 / self._step:g} frames/s" + (" assumed" if self._assumed else "")
            self._ledger.note(f"frame without a time stamp, placed at {rate}")
            time = following
        else:
            time = stamp + self._offset
            before = 0.0 if self._last is None else self._last
            if time - before > _LEAP:
                self._ledger.damage("time stamp more than an hour after the last")
            elif self._last is not None and time < self._last:
                self._ledger.note("time stamps run backwards, continued from the last")
            else:
                self._last = time
                return time
            self._offset += following - time
            time = following
        self._last = time
        return time
