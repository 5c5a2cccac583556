"""Live: frames from a source, keypoints, events, and how long all of that takes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from gesture_core.pose.live import LivePose
from gesture_core.spot.capture import Capture, Captured, Note
from gesture_core.spot.sources import TIMEOUT
from gesture_core.spot.spotter import Spotter
from gesture_core.types import Event, PoseSequence

_TICK = 0.25
"""Seconds after which it is looked whether the source has gone quiet."""
_REMEMBERED = 60.0
"""Seconds for which it is known when a frame was captured."""
_MEASURED = 20_000
"""Frames whose times are kept for the summary."""


@dataclass(frozen=True)
class Seen:
    """An event of a live source.

    Attributes
    ----------
    event : Event
    late : float
        Seconds from the capture of the frame in which the event ends until it was known.
    """

    event: Event
    late: float


@dataclass(frozen=True)
class WatchSummary:
    """What came of watching.

    Attributes
    ----------
    frames : int
        That were looked at.
    with_pose : int
        Those of them in which the person was found.
    dropped : int
        Frames of a live source that came while another one was looked at.
    seconds : float
        From the first frame to the last, in the source's own time.
    elapsed : float
        From the capture of the first one until the last one was done.
    events : int
    frame_latency : (float, float)
        Median and 95th percentile of the seconds from the capture of a frame until it was done with.
    event_latency : (float, float)
        The same of `Seen.late`.
    """

    frames: int = 0
    with_pose: int = 0
    dropped: int = 0
    seconds: float = 0.0
    elapsed: float = 0.0
    events: int = 0
    frame_latency: tuple[float, float] = (0.0, 0.0)
    event_latency: tuple[float, float] = (0.0, 0.0)


class Watch:
    """The events of a source as they happen: iterate it once, inside its `Capture`.

    Parameters
    ----------
    capture : Capture
    spotter : Spotter
        Made with ``live=True``.
    pose : LivePose, optional
        For a source of pictures.
    gap : float
        Seconds without a frame after which what waits is decided.
    on_frame : callable, optional
        Takes each frame (None where the source has keypoints) and its keypoints.
    """

    def __init__(
        self,
        capture: Capture,
        spotter: Spotter,
        pose: LivePose | None,
        gap: float,
        on_frame: Callable[[np.ndarray | None, PoseSequence], None] | None = None,
    ) -> None:
        self._capture, self._spotter, self._pose, self._gap = capture, spotter, pose, gap
        self._on_frame = on_frame
        self._captured: deque[tuple[float, float]] = deque()
        self._latencies: deque[float] = deque(maxlen=_MEASURED)
        self._late: deque[float] = deque(maxlen=_MEASURED)
        self._frames = self._with_pose = self._events = 0
        self._first: Captured | None = None
        self._last: Captured | None = None
        self._done = 0.0

    def __iter__(self) -> Iterator[Seen | Note | None]:
        """Events and notes, and None after each frame or moment without one; ends when the source does.

        Raises
        ------
        GestureError
            Where the source ended with an error; the events that still waited have been given then.
        """
        quiet, told = 0.0, False
        while True:
            try:
                found = self._capture.next(_TICK)
            except EOFError:
                break
            except BaseException:
                yield from self.finish()
                raise
            if isinstance(found, Captured):
                quiet, told = 0.0, False
                yield from self._look(found)
                yield None
                continue
            quiet += 0.0 if found else _TICK
            yield found
            if not self._capture.source.live or not self._frames:
                continue
            if quiet >= self._gap:  # nobody knows what was before, so that nothing better can come
                yield from self.finish()
            if quiet >= TIMEOUT and not told:
                told = True
                yield Note(f"{self._capture.source.name}: no frame for {TIMEOUT:g} s", lost=True)
        yield from self.finish()

    def finish(self) -> Iterator[Seen]:
        """The events that were still waiting."""
        yield from self._seen(self._spotter.finish())

    @property
    def summary(self) -> WatchSummary:
        """What has come of it so far."""
        first, last = self._first, self._last
        return WatchSummary(
            self._frames,
            self._with_pose,
            self._capture.dropped,
            last.seconds - first.seconds if first and last else 0.0,
            self._done - first.at if first else 0.0,
            self._events,
            _middle(self._latencies),
            _middle(self._late),
        )

    def _look(self, captured: Captured) -> Iterator[Seen]:
        self._first = self._first or captured
        self._last = captured
        given, picture = captured.given, None
        if isinstance(given, PoseSequence):
            pose = given
        else:
            assert self._pose is not None
            picture, pose = given, self._pose.push(captured.seconds, given)
        self._frames += 1
        self._with_pose += pose.frames_with_pose
        self._captured.append((captured.seconds, captured.at))
        while self._captured[0][0] < captured.seconds - _REMEMBERED:
            self._captured.popleft()
        events = self._spotter.push(pose)
        self._done = self._capture.clock()
        self._latencies.append(self._done - captured.at)
        yield from self._seen(events)
        if self._on_frame:
            self._on_frame(picture, pose)

    def _seen(self, events: list[Event]) -> Iterator[Seen]:
        for event in events:
            at = next((at for seconds, at in self._captured if seconds >= event.end - 1e-6), None)
            late = self._capture.clock() - at if at is not None else 0.0
            self._events += 1
            self._late.append(late)
            yield Seen(event, late)


def _middle(values: deque[float]) -> tuple[float, float]:
    if not values:
        return 0.0, 0.0
    middle, high = np.quantile(values, (0.5, 0.95)).tolist()
    return middle, high
