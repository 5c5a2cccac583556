"""Pictures of nobody: drawn ones, and what is known of the awkward media files beside the repository."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

SOMEBODY = ("sample.flv", "sample_av1.mp4", "sample_partially_fragmented.mp4")
"""Of ``nasty_media``: files that show a person; the others that can be read show nobody, by eye."""
SOMETIMES = ("awesome_movie.mov", "data_streams.mp4")
"""A person who holds a sheet of paper before themselves for half of the time; one who fades in from black."""
_BARS = np.array(
    [(255, 255, 255), (0, 255, 255), (255, 255, 0), (0, 255, 0), (255, 0, 255), (0, 0, 255), (255, 0, 0)]
)
_SIZES = ((240, 320), (480, 640), (640, 360))

Drawing = Callable[[np.random.Generator, int, int], np.ndarray]


def nobody(count: int, seed: int = 0) -> list[np.ndarray]:
    """So many pictures, (H, W, 3) uint8 in BGR, of all kinds in turn."""
    return drawn((_plain, _noise, _colour_bars, _text, _shapes, _clouds, _board), count, seed)


def held_out(count: int, seed: int = 1) -> list[np.ndarray]:
    """As many of other kinds, which the training of `compact` has not seen; nothing was chosen on seed 2."""
    kinds = (_moire, _mosaic, _shelves, _chart, _tree, _contours, _street, _leaves)
    return drawn(kinds, count, seed)


def beside(shared: Path, count: int, seed: int = 1) -> list[np.ndarray]:
    """So many parts of first frames of ``body_gesture`` to the left or right of the person."""
    import cv2

    folder, found = shared / "data" / "body_gesture", []
    random = np.random.default_rng(seed)
    with np.load(folder / "landmarks_mediapipe33.npz", allow_pickle=False) as archive:
        for key in random.permutation(sorted(archive.files)).tolist():
            subject, _, clip = key.split("__")
            video = cv2.VideoCapture(str(folder / subject / f"{clip}.avi"))
            ok, frame = video.read()
            video.release()
            x = archive[key][:, :, 0]
            wide, room = frame.shape[1] if ok else 0, 0.1  # for sleeves and hands
            left, right = int((x.min() - room) * wide), int((x.max() + room) * wide)
            parts = [
                frame[:, :left] if left >= 120 else None,
                frame[:, right:] if wide - right >= 120 else None,
            ]
            found += [np.ascontiguousarray(part) for part in parts if ok and part is not None]
            if len(found) >= count:
                return found[:count]
    return found


def drawn(kinds: tuple[Drawing, ...], count: int, seed: int) -> list[np.ndarray]:
    """So many pictures of kinds in turn, in several sizes."""
    random = np.random.default_rng(seed)
    pictures = []
    for number in range(count):
        picture = kinds[number % len(kinds)](random, *_SIZES[number % len(_SIZES)])
        pictures.append(np.ascontiguousarray(np.clip(picture, 0, 255).astype(np.uint8)))
    return pictures


def _plain(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    return np.full((high, wide, 3), random.choice([0, 0, 255, 128])) + random.integers(0, 12, 3)


def _noise(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    return random.integers(0, 256, (high, wide, 3))


def _colour_bars(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    bars = _BARS[np.arange(wide) * len(_BARS) // wide] * random.uniform(0.6, 1)
    picture = np.repeat(bars[None], high, axis=0)
    picture[int(0.8 * high) :] = np.linspace(0, 255, wide)[None, :, None]
    return picture


def _text(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    import cv2

    ground = int(random.choice([0, 20, 235, 255]))
    picture = np.full((high, wide, 3), ground, np.uint8)
    for _ in range(int(random.integers(5, 30))):
        word = "".join(map(chr, random.integers(33, 127, int(random.integers(3, 40)))))
        place = int(random.integers(-20, wide // 2)), int(random.integers(10, high))
        size, colour = float(random.uniform(0.4, 1.5)), (255 - ground,) * 3
        cv2.putText(picture, word, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
    return picture


def _shapes(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    import cv2

    picture = np.full((high, wide, 3), random.integers(0, 256, 3), np.uint8)
    for _ in range(int(random.integers(4, 25))):
        colour = [int(part) for part in random.integers(0, 256, 3)]
        a, b = ((int(random.integers(0, wide)), int(random.integers(0, high))) for _ in range(2))
        if random.random() < 0.6:
            cv2.rectangle(picture, a, b, colour, -1)
        else:
            cv2.circle(picture, a, int(random.integers(3, high // 4)), colour, -1)
    return picture


def _clouds(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    import cv2

    grid = random.uniform(0, 255, (*random.integers(3, 20, 2), 3)).astype(np.float32)
    picture: np.ndarray = cv2.resize(grid, (wide, high), interpolation=cv2.INTER_CUBIC)
    return picture


def _board(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    side = int(random.integers(8, 60))
    rows, columns = np.mgrid[:high, :wide]
    return np.repeat(
        (((rows // side + columns // side) % 2) * random.integers(80, 255))[..., None], 3, axis=2
    )


def _moire(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    rows, columns = np.mgrid[:high, :wide]
    waves = [
        np.hypot(rows - random.uniform(0, high), columns - random.uniform(0, wide))
        * random.uniform(0.05, 0.6)
        for _ in range(3)
    ]
    return 127 + 120 * np.stack([np.sin(wave + waves[0]) for wave in waves], axis=-1)


def _mosaic(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Every pixel in the colour of the nearest of some points."""
    points = random.uniform(0, 1, (int(random.integers(8, 90)), 2)) * (high, wide)
    colours = random.integers(0, 256, (len(points), 3))
    rows, columns = np.mgrid[:high, :wide]
    nearest, least = np.zeros((high, wide), int), np.full((high, wide), np.inf)
    for number, (y, x) in enumerate(points):
        away = (rows - y) ** 2 + (columns - x) ** 2
        nearest, least = np.where(away < least, number, nearest), np.minimum(away, least)
    return colours[nearest]


def _shelves(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Books of all colours and heights."""
    picture = np.full((high, wide, 3), random.integers(60, 200, 3))
    level = 0
    while level < high:
        room, x = int(random.integers(40, 130)), 0
        while x < wide:
            thick, tall = int(random.integers(5, 28)), int(room * random.uniform(0.5, 0.95))
            picture[max(level + room - tall, 0) : level + room, x : x + thick] = random.integers(0, 256, 3)
            x += thick + int(random.choice([0, 0, 1, 12]))
        level += room
        picture[level : level + 6] = random.integers(20, 120)
        level += 6
    return picture


def _chart(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    import cv2

    picture = np.full((high, wide, 3), 255 if random.random() < 0.5 else 25, np.uint8)
    for level in np.linspace(0.1, 0.9, 6) * high:
        cv2.line(picture, (wide // 10, int(level)), (9 * wide // 10, int(level)), (128, 128, 128), 1)
    for _ in range(int(random.integers(1, 6))):
        colour = tuple(map(int, random.integers(0, 256, 3)))
        x = np.linspace(0.1, 0.9, int(random.integers(4, 40))) * wide
        y = high / 2 + np.cumsum(random.normal(0, high / 12, len(x)))
        line = np.stack([x, y], axis=1).astype(np.int32)
        if random.random() < 0.5:
            cv2.polylines(picture, [line], False, colour, int(random.integers(1, 4)))
        else:
            for (left, top), (right, _) in pairwise(line):
                cv2.rectangle(picture, (int(left), int(top)), (int(right) - 2, int(0.9 * high)), colour, -1)
    return picture


def _tree(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A stem with branches, which is as near to a body as nothing else here."""
    import cv2

    picture = np.zeros((high, wide, 3), np.uint8)
    picture[...] = np.linspace(random.integers(0, 256, 3), random.integers(0, 256, 3), high)[:, None]
    colour = tuple(map(int, random.integers(0, 150, 3)))
    twigs = [
        (random.uniform(0.2, 0.8) * wide, 0.95 * high, -np.pi / 2, random.uniform(0.2, 0.35) * high, 14.0)
    ]
    while twigs:
        x, y, angle, length, thick = twigs.pop()
        end = x + length * np.cos(angle), y + length * np.sin(angle)
        cv2.line(picture, (int(x), int(y)), (int(end[0]), int(end[1])), colour, max(int(thick), 1))
        if thick > 1.5:
            turns = random.uniform(-0.9, 0.9, int(random.integers(2, 4)))
            twigs += [(*end, angle + turn, length * random.uniform(0.55, 0.8), thick * 0.6) for turn in turns]
    return picture


def _contours(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A map: the levels of a landscape, with streets over it."""
    import cv2

    levels = _clouds(random, high, wide) // 32
    picture = np.clip(levels * 32 + random.integers(0, 60, 3), 0, 255).astype(np.uint8)
    for _ in range(int(random.integers(2, 9))):
        line = np.cumsum(random.normal(0, 0.15, (8, 2)), axis=0) + random.uniform(0, 1, 2)
        cv2.polylines(picture, [(line * (wide, high)).astype(np.int32)], False, (255, 255, 255), 4)
    return picture


def _street(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Houses with windows below a sky."""
    picture = np.zeros((high, wide, 3), np.uint8)
    picture[...] = np.linspace((230, 180, 120), (250, 240, 230), high)[:, None]
    x = 0
    while x < wide:
        across, roof = int(random.integers(50, 160)), int(random.uniform(0.1, 0.6) * high)
        picture[roof:, x : x + across] = random.integers(40, 220, 3)
        step = int(random.integers(16, 40))
        for row in range(roof + 10, high - step, step):
            for column in range(x + 8, min(x + across - step // 2, wide), step):
                picture[row : row + step // 2, column : column + step // 2] = random.integers(0, 256)
        x += across
    picture[int(0.88 * high) :] = 70
    return picture


def _leaves(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    import cv2

    picture = np.full((high, wide, 3), (30, 60, 40), np.uint8)
    for _ in range(int(random.integers(150, 600))):
        place = int(random.integers(0, wide)), int(random.integers(0, high))
        axes = int(random.integers(3, 14)), int(random.integers(6, 40))
        colour = [int(random.integers(low, 256 - low)) for low in (0, 60, 0)]
        cv2.ellipse(picture, place, axes, float(random.uniform(0, 360)), 0, 360, colour, -1)
    return picture
