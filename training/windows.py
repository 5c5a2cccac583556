"""Windows with and without a person, as following and searching cut them out of pictures."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gesture_core.plugin.interfaces import Person
from gesture_core.pose.follow import REACH, TILE, Anatomy, Body, Follower, Window
from gesture_core.pose.network import NetworkBackend
from gesture_core.skeletons import COCO18

from .label import LONGEST, PICTURES, frames
from .nobody import KINDS
from .teachers import Teachers, apply, square

FRAMES, FILES = 2, 30
"""Of a film, evenly spaced; and of a collection, so that none outweighs the others."""
EACH = 3
"""Windows of each way of cutting, of each picture."""
SURE = 0.3
"""Mean score of head, arms and hips from which the teacher confirms that somebody is there."""
DRAWN = 250
"""Pictures of each kind of `nobody`."""


@dataclass(frozen=True)
class Example:
    """A window: (H, W, 3) uint8, whether somebody is in it, and where it comes from.

    ``group`` is what is held out together, ``kind`` the line of the table that it counts in.
    """

    picture: np.ndarray
    person: bool
    group: str
    kind: str


Track = Callable[[Iterable[object], str], Iterator[object]]
"""A progress bar over a list, with a title."""


def photographed(
    folder: Path, backend: NetworkBackend, seed: int, track: Track, files: int = FILES
) -> Iterator[Example]:
    """Windows of the permissively licensed pictures in a folder, with people and beside them.

    ``backend`` is `compact`, which does not ask for presence; the teachers are beside ``folder``;
    ``files`` are the most of a collection.
    """
    rng = np.random.default_rng(seed)
    teachers = Teachers(folder.parents[1] / "models", 1)
    with (folder / "SOURCES.csv").open(encoding="utf-8", newline="") as handle:
        listed = list(csv.DictReader(handle))
    sizes = Counter(row["file"].split("/")[0] for row in listed)
    chosen: list[dict[str, str]] = []
    for name, size in sizes.items():
        own = [row for row in listed if row["file"].split("/")[0] == name]
        chosen += own[:: -(-size // files)]
    for row in track(chosen, folder.name):
        assert isinstance(row, dict)
        for picture in _some(folder / row["file"], int(float(row["frames"] or 1))):
            yield from _of_picture(rng, picture, row, teachers, backend)


def drawn(seed: int, track: Track, each: int = DRAWN) -> Iterator[Example]:
    """Drawn pictures without anybody, whole and a tile of each; ``each`` of every kind."""
    rng = np.random.default_rng(seed)
    for kind in track(list(KINDS), "drawn"):
        for _ in range(each):
            high = int(rng.choice([180, 240, 360]))
            picture = KINDS[str(kind)](rng, high, int(high * rng.choice([1, 4 / 3, 16 / 9, 9 / 16])))
            for view in (picture, _tile(rng, picture)):
                yield Example(spoiled(rng, view), False, str(kind), f"drawn: {kind}")


def _some(path: Path, count: int) -> Iterator[np.ndarray]:
    """The picture, or `FRAMES` frames of a film, shrunk to at most `LONGEST` pixels."""
    step = 1 if path.suffix.lower() in PICTURES else max(1, count // FRAMES)
    for picture in frames(path, step):
        shrink = LONGEST / max(picture.shape[:2])
        yield (
            picture
            if shrink >= 1
            else cv2.resize(picture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
        )


def _of_picture(
    rng: np.random.Generator,
    picture: np.ndarray,
    row: dict[str, str],
    teachers: Teachers,
    backend: NetworkBackend,
) -> Iterator[Example]:
    """Windows around the person whom the follower finds and the teacher confirms, and beside them."""
    source = row["file"].split("/")[0]
    anatomy = Anatomy(COCO18)
    whole = Window(0, 0, picture.shape[1], picture.shape[0])
    window = Follower(backend)._zoom(picture, whole)[0]
    middle = np.array([window.left + window.right, window.top + window.bottom]) / 2
    side = float(max(window.right - window.left, window.bottom - window.top))
    crop, back = square(picture, middle, side, 256)
    points, scores = teachers.quick(crop)
    points = np.where(scores[:, None] > 0.1, apply(back, points), np.nan).astype(np.float32)
    person = Person(points, scores.astype(np.float32))
    body = anatomy.body(person)
    if body is None or anatomy.confidence(person) < SURE:
        return  # nobody, or nobody for certain: of no use
    for view in _around(rng, picture, body, points):
        yield Example(spoiled(rng, view), True, source, f"person: {source}")
    if row["people"].strip() == "1":
        for view in _beside(rng, picture, body, points):
            yield Example(spoiled(rng, view), False, source, f"beside: {source}")


def _around(
    rng: np.random.Generator, picture: np.ndarray, body: Body, points: np.ndarray
) -> Iterator[np.ndarray]:
    """What following, searching and a near camera see of a person."""
    size = picture.shape[1], picture.shape[0]
    for _ in range(EACH):
        x, y = rng.normal(0, 0.06 * REACH * body.torso, 2)
        yield Window.around(Body(body.x + x, body.y + y, body.torso), rng.uniform(0.75, 1.35), size).view(
            picture
        )
    if REACH * body.torso > 0.35 * max(size):
        yield picture
    x, y = body.shoulders
    for _ in range(EACH // 2):  # the upper body alone
        half = body.torso * rng.uniform(0.9, 1.7)
        low = max(0, int(x - half)), max(0, int(y - half * rng.uniform(0.6, 1)))
        yield picture[low[1] : int(y + half), low[0] : int(x + half)]
    upper = points[[0, 1, 2, 5, 8, 11, 14, 15]]
    seen = upper[~np.isnan(upper[:, 0])]
    for _ in range(EACH):  # a tile that holds head and trunk
        side = round(rng.uniform(0.35, 1.0) * min(size))
        low, high = (
            np.maximum(seen.max(axis=0) - side, 0),
            np.minimum(seen.min(axis=0), np.array(size) - side),
        )
        if (low < high).all() and 0.4 * side < REACH * body.torso:
            left, top = rng.uniform(low, high).astype(int)
            yield picture[top : top + side, left : left + side]


def _beside(
    rng: np.random.Generator, picture: np.ndarray, body: Body, points: np.ndarray
) -> Iterator[np.ndarray]:
    """Tiles in which the person is not: beyond all joints with the length of a hand or a foot."""
    high, wide = picture.shape[:2]
    seen = points[~np.isnan(points[:, 0])]
    room = 0.7 * body.torso
    low, far = seen.min(axis=0) - room, seen.max(axis=0) + room
    hips = points[[8, 11]]
    if np.isnan(hips).any() or np.isnan(points[[10, 13]]).any():
        far[1] = high  # what is below is unseen, not absent
    for _ in range(8 * EACH):
        side = int(rng.uniform(0.2, TILE) * min(high, wide))
        left, top = int(rng.uniform(0, wide - side)), int(rng.uniform(0, high - side))
        apart = left + side < low[0] or left > far[0] or top + side < low[1] or top > far[1]
        if apart and side >= 48:
            yield picture[top : top + side, left : left + side]


def _tile(rng: np.random.Generator, picture: np.ndarray) -> np.ndarray:
    side = int(rng.uniform(0.3, 1) * min(picture.shape[:2]))
    left = int(rng.uniform(0, picture.shape[1] - side))
    top = int(rng.uniform(0, picture.shape[0] - side))
    return picture[top : top + side, left : left + side]


def spoiled(rng: np.random.Generator, picture: np.ndarray) -> np.ndarray:
    """A picture in other light, without colour, out of focus, noisy, compressed, mirrored: each at times."""
    out = picture[:, ::-1] if rng.random() < 0.5 else picture
    if rng.random() < 0.2:
        out = cv2.cvtColor(cv2.cvtColor(np.ascontiguousarray(out), cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    if rng.random() < 0.5:
        light = np.power(np.arange(256) / 255, rng.uniform(0.6, 1.7))[:, None] * rng.uniform(0.8, 1.2, 3)
        out = np.stack(
            [np.clip(light[:, c] * 255, 0, 255).astype(np.uint8)[out[..., c]] for c in range(3)], -1
        )
    if rng.random() < 0.2:
        out = cv2.GaussianBlur(
            np.ascontiguousarray(out), (0, 0), rng.uniform(0.5, 0.008 * max(out.shape) + 0.6)
        )
    if rng.random() < 0.15:
        out = np.clip(out + rng.normal(0, rng.uniform(2, 14), out.shape), 0, 255).astype(np.uint8)
    if rng.random() < 0.3:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(15, 80))]
        out = cv2.imdecode(cv2.imencode(".jpg", np.ascontiguousarray(out), quality)[1], cv2.IMREAD_COLOR)
    return np.ascontiguousarray(out)
