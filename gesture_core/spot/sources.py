"""Where live frames come from: a camera, a stream on the network, a recording played as if live, a pipe.

A source yields ``(seconds, give)``: ``give()`` is the frame, (H, W, 3) uint8 in BGR, or a `PoseSequence` of
one frame where the source has keypoints. Nothing is converted unless it is looked at.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np

from gesture_core.errors import GestureError, InputError
from gesture_core.files import printable
from gesture_core.settings import Settings
from gesture_core.skeletons import SKELETONS, skeleton
from gesture_core.types import PoseSequence

Given = np.ndarray | PoseSequence
"""A picture, or the keypoints of one frame."""
Frame = tuple[float, Callable[[], Given | None]]

ADDRESSES = ("rtsp://", "rtsps://", "rtmp://", "http://", "https://", "udp://")
"""What the address of a stream begins with."""
TIMEOUT = 5.0
"""Seconds after which a stream that says nothing counts as lost."""
_LONGEST_LINE = 1 << 20
_LONGEST_PICTURE = 32 << 20
_PIECE = 1 << 16


class FrameSource(Protocol):
    """A source of live frames.

    Attributes
    ----------
    name : str
        As in the events.
    live : bool
        It goes on whether anybody looks or not: where looking is too slow, the newest frame wins. It is
        opened again after an error. Other sources wait, and drop nothing.
    paced : bool
        Its seconds pass at the rate of the clock.
    pictures : bool
        It has pictures, not keypoints.
    """

    @property
    def name(self) -> str: ...

    @property
    def live(self) -> bool: ...

    @property
    def paced(self) -> bool: ...

    @property
    def pictures(self) -> bool: ...

    def frames(self, say: Callable[[str], None]) -> Iterator[Frame]:
        """Open the source; its frames until it ends.

        ``say`` takes what is worth knowing of it. Called again after an error, where the source is live.

        Raises
        ------
        GestureError
            Where it cannot be opened, or was lost.
        """
        ...


@dataclass(frozen=True)
class Camera:
    """A camera by its number, or a stream by its address, through OpenCV.

    Attributes
    ----------
    address : int or str
    clock : callable
        Seconds.
    """

    address: int | str
    clock: Callable[[], float] = time.monotonic
    live: bool = field(default=True, init=False)
    paced: bool = field(default=True, init=False)
    pictures: bool = field(default=True, init=False)
    _began: list[float] = field(default_factory=list, init=False)

    @property
    def name(self) -> str:
        """``camera 0``, or the address without what may be secret: a password, a token behind a ``?``."""
        if isinstance(self.address, int):
            return f"camera {self.address}"
        scheme, _, rest = self.address.partition("://")
        shown, *query = re.split("[?#;]", rest, maxsplit=1)
        secret = "@" in "".join(query) and "@" not in shown  # a password with such a mark in it, perhaps
        return printable(f"{scheme}://{'…' if secret else shown.rpartition('@')[2]}")

    def frames(self, say: Callable[[str], None]) -> Iterator[Frame]:
        """Frames with their seconds since the source was first opened."""
        import cv2

        cv2.utils.logging.setLogLevel(0)  # what it prints of a camera that is not there is in the error
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # nor what FFmpeg prints, addresses included
        if isinstance(self.address, int):
            capture = cv2.VideoCapture(self.address)
            capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        else:
            wait = int(1000 * TIMEOUT)
            options = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, wait, cv2.CAP_PROP_READ_TIMEOUT_MSEC, wait]
            capture = cv2.VideoCapture(self.address, cv2.CAP_FFMPEG, options)
        try:
            if not capture.isOpened():
                remedy = (
                    "its cable or number" if isinstance(self.address, int) else "its address and password"
                )
                raise InputError("cannot be opened", subject=self.name, remedy=remedy, code="E_SOURCE")

            def give() -> np.ndarray | None:
                done, picture = capture.retrieve()
                return picture if done else None

            # After that a stream is lost, whatever its decoder has left; a camera may take longer to start.
            longest = float("inf") if isinstance(self.address, int) else TIMEOUT
            asked = self.clock()
            while capture.grab() and (now := self.clock()) - asked < longest:
                self._began[:] = self._began or [now]
                yield now - self._began[0], give
                asked = self.clock()
        finally:
            capture.release()
        raise InputError("was lost", subject=self.name, code="E_SOURCE")


@dataclass(frozen=True)
class Recording:
    """A video file.

    Attributes
    ----------
    path : Path
    settings : Settings
        Which reader, its options, the limits.
    paced : bool
        As if it was live: each frame comes when its second has come.
    """

    path: Path
    settings: Settings
    paced: bool = False
    live: bool = field(default=False, init=False)
    pictures: bool = field(default=True, init=False)

    @property
    def name(self) -> str:
        """The path."""
        return printable(self.path)

    def frames(self, say: Callable[[str], None]) -> Iterator[Frame]:
        """Frames at the file's own seconds; what is damaged is said at the end."""
        from gesture_core.video import open_configured, pictures

        chosen = self.settings
        opened = open_configured(self.path, chosen)
        with opened as video:
            frames: Iterator[Frame] = pictures(video)
            yield from paced(frames) if self.paced else frames
            report = video.report
        if not report.complete:
            say(f"frames are lost: {'; '.join(report.notes)}")


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints that are there already, of one person.

    Attributes
    ----------
    pose : PoseSequence
    paced : bool
        As in `Recording`.
    """

    pose: PoseSequence
    paced: bool = False
    live: bool = field(default=False, init=False)
    pictures: bool = field(default=False, init=False)

    @property
    def name(self) -> str:
        """The name of the file."""
        return self.pose.source

    def frames(self, say: Callable[[str], None]) -> Iterator[Frame]:
        """One frame after the other."""

        def frame(number: int) -> Frame:
            return float(self.pose.times[number]), lambda: self.pose.part(slice(number, number + 1))

        every = (frame(number) for number in range(len(self.pose)))
        yield from paced(every) if self.paced else every


def paced(frames: Iterator[Frame], clock: Callable[[], float] = time.monotonic) -> Iterator[Frame]:
    """``frames``, each when its second has come."""
    began: float | None = None
    for seconds, give in frames:
        began = clock() - seconds if began is None else began
        time.sleep(max(0.0, began + seconds - clock()))
        yield seconds, give


def piped(stream: BinaryIO, name: str = "standard input") -> FrameSource:
    """What comes through a pipe: JPEG pictures one after the other, or keypoints as JSON lines.

    Raises
    ------
    InputError
        Where it is neither.
    """
    head = stream.read(1)
    while head in (b"\n", b"\r", b" ", b"\t"):
        head = stream.read(1)
    if head == b"\xff":
        return PipedPictures(stream, name)
    if head == b"{":
        return PipedKeypoints(stream, name)
    raise InputError(
        f"begins with {head!r}" if head else "is empty",
        subject=name,
        remedy="JPEG pictures (ffmpeg … -f mjpeg -), or a line of JSON for each frame",
        code="E_SOURCE",
    )


@dataclass(frozen=True, eq=False)
class PipedPictures:
    """JPEG pictures one after the other, as ``ffmpeg -f mjpeg -`` writes them; their seconds are those of
    their arrival. The first byte has been read.
    """

    stream: BinaryIO
    name: str
    clock: Callable[[], float] = time.monotonic
    live: bool = field(default=True, init=False)
    paced: bool = field(default=True, init=False)
    pictures: bool = field(default=True, init=False)

    def frames(self, say: Callable[[str], None]) -> Iterator[Frame]:
        """Pictures until the pipe is closed."""
        import cv2

        began: float | None = None
        for data in self._jpegs():
            now = self.clock()
            began = now if began is None else began

            def give(data: bytes = data) -> np.ndarray | None:
                picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
                if picture is None:
                    say("a picture cannot be decoded and is left out")
                return picture

            yield now - began, give

    def _jpegs(self) -> Iterator[bytes]:
        held = b"\xff"
        read = getattr(self.stream, "read1", self.stream.read)
        while piece := read(_PIECE):
            held += piece
            while (end := held.find(b"\xff\xd9")) >= 0:
                start = held.find(b"\xff\xd8")
                if 0 <= start < end:
                    yield held[start : end + 2]
                held = held[end + 2 :]
            if len(held) > _LONGEST_PICTURE:
                raise InputError("holds no end of a picture", subject=self.name, code="E_SOURCE")


@dataclass(frozen=True, eq=False)
class PipedKeypoints:
    """Lines of JSON: ``{"time": seconds, "keypoints": [[x, y, score], …], "skeleton": "coco18"}``.

    ``keypoints`` is null where nobody is seen, a joint null where it is missing, its score 1 where there is
    none. Without ``time`` it is the second of the arrival; without ``skeleton`` the layout follows from the
    number of joints. The first byte has been read. A line that cannot be used is said, and left out.
    """

    stream: BinaryIO
    name: str
    clock: Callable[[], float] = time.monotonic
    live: bool = field(default=False, init=False)
    paced: bool = field(default=False, init=False)
    pictures: bool = field(default=False, init=False)

    def frames(self, say: Callable[[str], None]) -> Iterator[Frame]:
        """One frame a line."""
        before, began, head = -np.inf, self.clock(), b"{"
        known = ""
        for number, line in enumerate(iter(lambda: self.stream.readline(_LONGEST_LINE), b""), 1):
            text, head = head + line, b""
            if not text.strip():
                continue
            try:
                pose = pose_of(text, self.clock() - began, known, self.name)
                if not pose.times[0] >= before:
                    raise ValueError(f"its time {pose.times[0]:g} is before the last one")
            except (ValueError, TypeError, ArithmeticError, RecursionError, GestureError) as error:
                say(f"line {number} is left out: {error.cause if isinstance(error, GestureError) else error}")
                continue
            before, known = float(pose.times[0]), pose.skeleton
            yield before, lambda pose=pose: pose  # type: ignore[misc]


def pose_of(text: bytes, now: float, layout: str = "", source: str = "") -> PoseSequence:
    """The frame in a line of JSON, see `PipedKeypoints`; ``layout`` is that of the lines before."""
    tree: Any = json.loads(text)
    if not isinstance(tree, dict) or "keypoints" not in tree:
        raise ValueError("it has no keypoints")
    rows = tree["keypoints"]
    name = tree.get("skeleton") or _layout(len(rows), layout) if rows is not None else layout or "coco18"
    joints = len(skeleton(str(name)).joints)
    values = np.full((joints, 3), np.nan)
    if rows is not None:
        if len(rows) != joints:
            raise ValueError(f"it has {len(rows)} joints, {name} has {joints}")
        for place, row in enumerate(rows):
            if row is not None:
                x, y, score = [*row, 1.0][:3]
                values[place] = [np.nan if v is None else float(v) for v in (x, y, score)]
    at = float(tree.get("time", now))
    scores = np.nan_to_num(values[:, 2])
    return PoseSequence(values[None, :, :2], scores[None], np.array([at]), str(name), source=source)


def _layout(joints: int, before: str) -> str:
    """The layout of so many joints, that of the lines before where it fits."""
    if before and len(skeleton(before).joints) == joints:
        return before
    alike = [name for name, one in SKELETONS.items() if len(one.joints) == joints]
    if not alike:
        raise ValueError(f"no layout has {joints} joints; name one as skeleton")
    return alike[0]
