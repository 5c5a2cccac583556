"""What a video promised against what came: the comparison at its end.

Containers with a table of samples (mov, avi, gif) promise a number of frames. Matroska and FLV promise
a duration. A packet whose own header is broken is passed over in silence: it leaves a hole among the
bytes that were read and a gap in an otherwise constant pace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gesture_core.video.info import Ledger

# A recording keeps pace if this share of its intervals differ from their median by less than _JITTER:
# what a writer's rounding to milliseconds makes. Cameras and browsers that drop frames do not.
_STEADY = 0.9
_JITTER = 0.0016
_MIN_INTERVALS = 8
# Bytes between packets beyond those of block and cluster headers.
_HOLE = 30


@dataclass
class Account:
    """Counts of what passed through the demuxer and the decoder.

    Attributes
    ----------
    packets : int
        Packets of the picture stream that hold data.
    empty : int
        Packets without data, which repeat the last picture.
    unshown : int
        Packets that only refresh a reference picture.
    hidden : int
        Packets that an edit list keeps from being shown.
    trimmed : int
        Declared frames that an edit list leaves out of the index altogether.
    refused : int
        Packets that raised in the decoder.
    frames : int
        Frames that the decoder gave.
    end : float
        Seconds at which the last packet of any stream ends.
    size : int
        Bytes of the packets of all streams.
    places : int
        Places of the file that gave packets; several sounds may lie in one block.
    holes : int
        Stretches of the file between two packets that no packet covers.
    stamps : list of float
        Seconds of the frames, as the container gives them.
    """

    packets: int = 0
    empty: int = 0
    unshown: int = 0
    hidden: int = 0
    trimmed: int = 0
    refused: int = 0
    frames: int = 0
    end: float = 0.0
    size: int = 0
    places: int = 0
    holes: int = 0
    stamps: list[float] = field(default_factory=list)
    _last: int | None = None
    _read_to: int | None = None

    @property
    def cut(self) -> bool:
        """Whether an edit list keeps some of the frames from being shown."""
        return bool(self.hidden or self.trimmed)

    def passed(self, position: int | None, size: int, end: float) -> None:
        """A packet of any stream: where it lies in the file, in bytes, and when it ends, in seconds."""
        self.end = max(self.end, end)
        self.size += size
        if position is None or position < 0:
            return
        self.places += position != self._last
        self.holes += self._read_to is not None and position - self._read_to > _HOLE
        self._last, self._read_to = position, position + size

    def settle(
        self, ledger: Ledger, *, declared: int | None, duration: float | None, tolerance: float = 0.6
    ) -> None:
        """Tell `ledger` what is missing.

        Parameters
        ----------
        declared : int or None
            Frames that the header promises.
        duration : float or None
            Seconds that the header promises for all streams, where that promise is worth something; for
            the picture alone, where an edit list cuts it.
        tolerance : float
            Frames by which the end may fall short of the duration.
        """
        absent = (declared or 0) - self.trimmed - self.packets - self.empty
        if absent > 0:
            ledger.damage(f"{absent} of {declared} declared frames are not in the file", absent)
        silent = self.packets - self.unshown - self.hidden - self.refused - self.frames
        if silent > 0:
            ledger.damage(f"packets that gave no frame: {silent}", silent)
        lost = gaps(self.stamps) if self.holes or self.cut else 0
        if lost:
            ledger.damage(f"gaps in a steady pace, as of {lost} lost frames", lost)
        if self.holes and (np.diff(self.stamps) < 0).any():
            ledger.damage("unread bytes and time stamps out of order")
        if not self.stamps:
            return
        step = float(np.median(np.diff(self.stamps))) if len(self.stamps) > 1 else 0.04
        end, slack = self.end, tolerance * step
        if self.cut:
            # A trimmed file shows all of its edit. Where damaged tables moved a frame out of the edit,
            # the frames that are left do not fill it, or do not come in order.
            end, slack = max(self.stamps) + step, 0.6 * step
            if (np.diff(self.stamps) < 0).any():
                ledger.damage("hidden packets and time stamps out of order")
        if duration is not None and duration - end > max(slack, 0.002 * duration):
            ledger.damage(f"ends at {end:.2f} of {duration:.2f} declared seconds")


def gaps(stamps: Sequence[float]) -> int:
    """Frames that are absent from a recording of constant pace; 0 where the pace is not constant.

    Parameters
    ----------
    stamps : sequence of float
        Seconds of the frames, in order.
    """
    intervals = np.diff(np.asarray(stamps, np.float64))
    if len(intervals) < _MIN_INTERVALS:
        return 0
    step = float(np.median(intervals))
    if step <= 0 or float(np.mean(np.abs(intervals - step) <= _JITTER)) < _STEADY:
        return 0
    long = intervals[intervals > 1.5 * step]
    return int((np.rint(long / step) - 1).sum())
