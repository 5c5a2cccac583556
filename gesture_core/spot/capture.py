"""A thread that takes frames from a source, so that looking at them cannot hold up a camera."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

from gesture_core.errors import GestureError
from gesture_core.spot.sources import TIMEOUT, FrameSource, Given

if TYPE_CHECKING:
    from gesture_core.video.reader import Picture

WAITS = (1.0, 2.0, 5.0, 10.0, 30.0)
"""Seconds before a lost source is opened again, the last of them from then on."""
ROOM = 16
"""Frames of a source that is not live that wait to be looked at."""


@dataclass(frozen=True, eq=False)
class Captured:
    """A frame, and when it was captured.

    Attributes
    ----------
    seconds : float
        In the source's own time.
    at : float
        By the clock of the `Capture`; of a source that is neither live nor paced, when it was taken from
        the queue.
    given : array or PoseSequence
    """

    seconds: float
    at: float
    given: Given


@dataclass(frozen=True)
class Note:
    """Something worth saying about the source; ``lost`` where frames are missing from here on."""

    text: str
    lost: bool = False


class Capture:
    """The frames of a source, through a queue that is bounded. Use as a context manager.

    Of a live source only the newest frame waits; others wait for their turn. A live source that fails is
    opened again, after ever longer waits, unless it could not be opened the first time.

    Parameters
    ----------
    source : FrameSource
    rate : float, optional
        Frames a second that are looked at, of a source of pictures.
    clock : callable
        Seconds.
    waits : sequence of float
        Seconds before a lost source is opened again.

    Attributes
    ----------
    dropped : int
        Frames that nobody looked at, as a newer one came.
    """

    def __init__(
        self,
        source: FrameSource,
        rate: float | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
        waits: tuple[float, ...] = WAITS,
    ) -> None:
        self.source, self.dropped = source, 0
        self.clock = clock
        self._rate = rate if source.pictures else None
        self._waits = waits
        self._frames: deque[Captured] = deque()
        self._notes: deque[Note] = deque()
        self._changed = threading.Condition()
        self._stopped = threading.Event()
        self._ended = False
        self._epoch: float | None = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="capture", daemon=True)

    def __enter__(self) -> Capture:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(TIMEOUT + 1)  # a read that hangs ends with the process

    def next(self, timeout: float) -> Captured | Note | None:
        """The next frame or note, at most ``timeout`` seconds later; None where there is none.

        Raises
        ------
        GestureError
            What ended a source for good.
        EOFError
            Where the source has ended.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._notes or self._frames or self._ended, timeout)
            if self._notes:
                return self._notes.popleft()
            if self._frames:
                self._changed.notify_all()
                found = self._frames.popleft()
                timed = self.source.live or self.source.paced
                return found if timed else replace(found, at=self.clock())
            if self._error:
                raise self._error
            if self._ended:
                raise EOFError
            return None

    def _run(self) -> None:
        try:
            self._take()
        except BaseException as error:  # noqa: BLE001 - raised again where the frames are asked for
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _take(self) -> None:
        """Open the source, again and again where it is live, and take its frames."""
        opened, tries, lost = False, 0, 0.0
        while True:
            try:
                for seconds, given in self._looked_at():
                    if tries:
                        self._say(f"is back after {self.clock() - lost:.0f} s")
                    opened, tries = True, 0
                    if given is not None:
                        self._put(seconds, given)
                    if self._stopped.is_set():
                        return
                return
            except GestureError as error:
                if not self.source.live or not opened:
                    raise
                lost = lost if tries else self.clock()
                wait = self._waits[min(tries, len(self._waits) - 1)]
                tries += 1
                self._say(f"{error.cause}; opened again in {wait:g} s", lost=True)
            if self._stopped.wait(wait):
                return

    def _looked_at(self) -> Iterator[tuple[float, Given | None]]:
        """The source's frames, opened anew, at the rate that is asked for."""
        from gesture_core.video import at_rate

        frames = self.source.frames(self._say)
        if self._rate:
            yield from at_rate(cast("Iterator[Picture]", frames), self._rate)
            return
        for seconds, give in frames:
            yield seconds, give()

    def _put(self, seconds: float, given: Given) -> None:
        captured = Captured(seconds, self._captured_at(seconds), given)
        with self._changed:
            if self.source.live:
                self.dropped += len(self._frames)
                self._frames.clear()
            else:
                self._changed.wait_for(lambda: len(self._frames) < ROOM or self._stopped.is_set())
            self._frames.append(captured)
            self._changed.notify_all()

    def _captured_at(self, seconds: float) -> float:
        """Now; of a source that is paced, when its second came."""
        now = self.clock()
        if not self.source.paced or self.source.live:
            return now
        self._epoch = now - seconds if self._epoch is None else self._epoch
        return self._epoch + seconds

    def _say(self, text: str, *, lost: bool = False) -> None:
        with self._changed:
            self._notes.append(Note(f"{self.source.name}: {text}", lost))
            self._changed.notify_all()
