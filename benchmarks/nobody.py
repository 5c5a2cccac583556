"""Pictures of nobody: drawn ones, and what is known of the awkward media files beside the repository."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

SOMEBODY = ("data_streams.mp4", "sample.flv", "sample_av1.mp4", "sample_partially_fragmented.mp4")
"""Of ``nasty_media``: files that show a person; the others that can be read show nobody, by eye."""
SOMETIMES = ("awesome_movie.mov",)
"""A person who holds a sheet of paper before themselves for half of the time."""
_BARS = np.array(
    [(255, 255, 255), (0, 255, 255), (255, 255, 0), (0, 255, 0), (255, 0, 255), (0, 0, 255), (255, 0, 0)]
)
_SIZES = ((240, 320), (480, 640), (640, 360))

Drawing = Callable[[np.random.Generator, int, int], np.ndarray]


def nobody(count: int, seed: int = 0) -> list[np.ndarray]:
    """So many pictures, (H, W, 3) uint8 in BGR, of all kinds in turn."""
    random = np.random.default_rng(seed)
    kinds: tuple[Drawing, ...] = (_plain, _noise, _colour_bars, _text, _shapes, _clouds, _board)
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
