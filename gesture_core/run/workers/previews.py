"""Small looping pictures of people in inputs, with their skeletons: what a page about a run shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.files import replacing
from gesture_core.pose.overlay import draw_pose
from gesture_core.records import decoded
from gesture_core.run.addresses import drop, fetch, look, place_for
from gesture_core.skeletons import skeleton
from gesture_core.types import PoseSequence
from gesture_core.video.writer import write_video

if TYPE_CHECKING:
    from gesture_core.run.workers.worker import Worker
    from gesture_core.settings import Settings

SIDE = 240
"""Width and height, in pixels."""
RATE = 15.0
"""Frames a second at most."""
REVISION = 3
"""Goes up when the same input gives other pictures."""
_MARGIN = 0.18
"""Around the joints, as a share of the square's side."""
_OUTLIERS = (2.0, 98.0)
"""Percentiles of the coordinates that the square holds: one joint that jumps moves nobody out of sight."""
_GROUND = (44, 40, 38)
_QUALITY = 27
_STILL_QUALITY = 75
_NEAR = 0.5 / RATE


@dataclass(frozen=True)
class Cut:
    """A stretch of an input, and whom to show.

    Attributes
    ----------
    path : Path
        The ``.mp4`` to write, a still beside it; its time begins at ``start``.
    person : int or None
        None for the whole picture.
    start, end : float
        Seconds in the input.
    pictures : int
        Of a strip at even times, side by side in a ``.png``; 0 for a video.
    """

    path: Path
    person: int | None
    start: float
    end: float
    pictures: int = 0


def draw_previews(
    worker: Worker,
    path: str,
    video: bool,
    stored: str,
    cuts: Sequence[tuple[str, int | None, float, float, int]],
    address: str = "",
) -> None:
    """Write previews of one input, in one pass over it.

    Of each cut ``cuts`` have what a `Cut` has. Keypoints alone are drawn on a
    plain ground. A video at an ``address`` is fetched for it, and deleted afterwards.
    """
    worker.slow()
    people = worker.people(stored, "") if stored else ()
    wanted = [Cut(decoded(cut[0]), *cut[1:]) for cut in cuts]
    drawn = {cut.path: _Drawn(cut, people) for cut in wanted}
    if not video:
        for one in drawn.values():
            one.on_plain_ground()
            one.write()
            worker.alive()
        return
    place = decoded(path)
    try:
        if address:
            place = place_for(address, place)
            fetch(look(address), place, worker.alive)
        for time, frame in _shown(place, worker.settings):
            for file, one in list(drawn.items()):
                one.add(time, frame)
                if time > one.cut.end + _NEAR:
                    drawn.pop(file).write()
            worker.alive()
            if not drawn:
                break
    finally:
        if address:
            drop(place)
    for one in drawn.values():
        one.write()


class _Drawn:
    """The pictures of one cut so far."""

    def __init__(self, cut: Cut, people: Sequence[PoseSequence]) -> None:
        self.cut = cut
        bodies = [one for one in people if isinstance(one, PoseSequence)]  # channels cannot be drawn
        self._pose = next((one.flat for one in bodies if one.person == cut.person), None)
        self._frames: list[tuple[float, np.ndarray]] = []
        self._strip: dict[int, tuple[float, np.ndarray]] = {}
        self._square: tuple[float, float, float] | None = None
        self._near = _NEAR
        if self._pose is not None:
            times = self._pose.times
            inside = (times >= cut.start - _NEAR) & (times <= cut.end + _NEAR)
            self._square = _square(self._pose.keypoints[inside])
            steps = np.diff(times)
            self._near = max(_NEAR, 0.6 * float(np.median(steps))) if len(steps) else _NEAR

    def add(self, time: float, frame: np.ndarray) -> None:
        """Take a frame of the input, if it lies in the cut."""
        if not self.cut.start - 1e-6 <= time <= self.cut.end + _NEAR:
            return
        high, wide = frame.shape[:2]
        whole = max(high, wide)
        left, top, side = _inside(self._square, wide, high) or ((wide - whole) / 2, (high - whole) / 2, whole)
        picture = _cropped(frame, left, top, side)
        self._draw(picture, time, left, top, side)
        self._keep(time - self.cut.start, picture)

    def on_plain_ground(self) -> None:
        """Draw the keypoints alone."""
        if self._pose is None or self._square is None:
            return
        last = -np.inf
        for time in self._pose.times.tolist():
            if self.cut.start - 1e-6 <= time <= self.cut.end + _NEAR and time - last >= 0.9 / RATE:
                picture = np.full((SIDE, SIDE, 3), _GROUND, np.uint8)
                self._draw(picture, time, *self._square)
                self._keep(time - self.cut.start, picture)
                last = time

    def write(self) -> None:
        """Write the files, unless there was no frame: the still first, so that no video lacks its own."""
        if self._strip:
            places = sorted(self._strip)
            nearest = [min(places, key=lambda place: abs(place - n)) for n in range(self.cut.pictures)]
            _write_picture(np.hstack([self._strip[place][1] for place in nearest]), self.cut.path)
        elif self._frames:
            _write_picture(self._frames[len(self._frames) // 2][1], still_of(self.cut.path))
            write_video(self._frames, self.cut.path, quality=_QUALITY, seekable=True)

    def _keep(self, time: float, picture: np.ndarray) -> None:
        """Take a picture for the video, or for the place of the strip whose middle it is nearest to."""
        if not self.cut.pictures:
            self._frames.append((time, picture))
            return
        at = time / max(self.cut.end - self.cut.start, 1e-6) * self.cut.pictures
        place = int(np.clip(at, 0, self.cut.pictures - 1))
        off = abs(at - place - 0.5)
        if place not in self._strip or off < self._strip[place][0]:
            self._strip[place] = off, picture

    def _draw(self, picture: np.ndarray, time: float, left: float, top: float, side: float) -> None:
        if self._pose is None:
            return
        index = int(np.argmin(np.abs(self._pose.times - time)))
        if abs(self._pose.times[index] - time) <= self._near:
            points = (self._pose.keypoints[index] - (left, top)) * (SIDE / side)
            draw_pose(picture, points, skeleton(self._pose.skeleton))


def still_of(video: Path) -> Path:
    """The picture that stands for a preview until it plays."""
    return video.with_suffix(".jpg")


def _write_picture(picture: np.ndarray, path: Path) -> None:
    import cv2

    data = cv2.imencode(path.suffix, picture, (cv2.IMWRITE_JPEG_QUALITY, _STILL_QUALITY))[1]
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())


def _square(points: np.ndarray) -> tuple[float, float, float] | None:
    """Left, top and side of a square around (T, J, 2) ``points``; None where there is none."""
    seen = points[~np.isnan(points[..., 0])]
    if not len(seen):
        return None
    low, high = np.percentile(seen, _OUTLIERS, axis=0)
    side = float((high - low).max()) * (1 + 2 * _MARGIN) or 1.0
    left, top = (low + high - side) / 2
    return float(left), float(top), side


def _inside(
    square: tuple[float, float, float] | None, wide: int, high: int
) -> tuple[float, float, float] | None:
    """The square, smaller and moved, as far as it then shows more of the frame and all of the joints."""
    if square is None:
        return None
    left, top, side = square
    smaller = max(min(side, float(min(wide, high))), side / (1 + 2 * _MARGIN))
    left, top = left + (side - smaller) / 2, top + (side - smaller) / 2
    places = []
    for edge, length in ((left, wide), (top, high)):
        room = length - smaller
        places.append(min(max(edge, 0.0), room) if room >= 0 else min(max(edge, room), 0.0))
    return places[0], places[1], smaller


def _cropped(frame: np.ndarray, left: float, top: float, side: float) -> np.ndarray:
    """A square of ``frame``, `SIDE` pixels wide; what lies outside of the frame is plain ground."""
    import cv2

    high, wide = frame.shape[:2]
    x, y, length = round(left), round(top), max(1, round(side))
    inner = frame[max(y, 0) : max(0, min(y + length, high)), max(x, 0) : max(0, min(x + length, wide))]
    picture = np.full((SIDE, SIDE, 3), _GROUND, np.uint8)
    if not inner.size:
        return picture
    scale = SIDE / length
    size = max(1, round(inner.shape[1] * scale)), max(1, round(inner.shape[0] * scale))
    # Averages of areas cost more, and are needed only where pixels would be left out.
    small = cv2.resize(inner, size, interpolation=cv2.INTER_AREA if scale < 0.5 else cv2.INTER_LINEAR)
    down, across = max(0, round(-y * scale)), max(0, round(-x * scale))
    room = picture[down : down + size[1], across : across + size[0]]
    room[:] = small[: room.shape[0], : room.shape[1]]
    return picture


def _shown(path: Path, settings: Settings) -> Iterator[tuple[float, np.ndarray]]:
    """The frames of a video that previews show, as the extraction saw them."""
    from gesture_core.video import at_rate, open_configured, pictures

    with open_configured(path, settings) as video:
        yield from at_rate(pictures(video), RATE)
