"""Pictures of nobody of kinds that nothing was trained or chosen on, drawn for the last measure alone."""

from __future__ import annotations

import numpy as np
from nobody import drawn


def unseen(count: int, seed: int = 3) -> list[np.ndarray]:
    """As many of kinds on which nothing was trained or chosen: no head of `compact`, and no limit."""
    kinds = (_fractal, _vases, _vehicles, _washing, _circuit, _clocks, _notes, _chessmen, _bridge)
    return drawn(kinds, count, seed)


def _fractal(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A set of Julia's, in the colours of how soon a point leaves."""
    rows, columns = np.mgrid[-1.2 : 1.2 : high * 1j, -1.6 : 1.6 : wide * 1j]
    zoom, middle = random.uniform(0.2, 1.2), complex(*random.uniform(-0.4, 0.4, 2))
    point = (columns + 1j * rows) * zoom + middle
    angle = random.uniform(0, 2 * np.pi)
    start = 0.7885 * np.exp(1j * angle)
    gone = np.zeros((high, wide))
    for _ in range(40):
        inside = np.abs(point) < 4
        point = np.where(inside, point**2 + start, point)
        gone += inside
    tone = (gone / 40)[..., None] ** random.uniform(0.3, 1)
    return 255 * (0.5 + 0.5 * np.cos(2 * np.pi * (tone * random.uniform(0.4, 2) + random.uniform(0, 1, 3))))


def _turned(random: np.random.Generator, parts: int) -> np.ndarray:
    """(100,) half widths, 0 to 1, of something that was made on a lathe or a wheel, from top to foot."""
    knots = random.uniform(0.15, 1, parts)
    knots[0] *= 0.6
    return np.interp(np.linspace(0, 1, 100), np.linspace(0, 1, parts), knots)


def _stand(
    picture: np.ndarray,
    half: np.ndarray,
    place: tuple[float, float],
    size: tuple[float, float],
    colour: np.ndarray,
) -> None:
    """Put something turned on a shelf or a board: foot at ``place``, so wide and high, lit from one side."""
    import cv2

    (x, y), (across, tall) = place, size
    heights = np.linspace(y - tall, y, len(half))
    for share in np.linspace(1, 0.1, 12):
        light = np.clip(colour * (1.25 - 0.7 * share), 0, 255).tolist()
        side = np.stack([x - 0.3 * across * half * (1 - share) - across * half * share, heights], 1)
        other = np.stack([x - 0.3 * across * half * (1 - share) + across * half * share, heights], 1)
        cv2.fillPoly(picture, [np.concatenate([side, other[::-1]]).astype(np.int32)], light, cv2.LINE_AA)


def _lit(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A wall that is lighter on one side, and a table."""
    light = np.linspace(random.uniform(0.5, 1), random.uniform(0.5, 1), wide)[None, :, None]
    picture = np.repeat(random.integers(60, 250, 3) * light, high, axis=0)
    picture[int(random.uniform(0.6, 0.95) * high) :] = random.integers(20, 200, 3)
    return np.ascontiguousarray(picture.astype(np.uint8))


def _vases(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Vases and bottles, some with a handle: upright, symmetric, with neck and shoulders."""
    import cv2

    picture = _lit(random, high, wide)
    for _ in range(int(random.integers(1, 5))):
        tall = random.uniform(0.3, 0.85) * high
        across = tall * random.uniform(0.12, 0.35)
        place = random.uniform(0.1, 0.9) * wide, random.uniform(0.75, 0.98) * high
        colour = random.uniform(20, 240, 3)
        if random.random() < 0.4:
            ear = int(place[0] + random.choice([-1, 1]) * across), int(place[1] - 0.6 * tall)
            axes = int(across * 0.6), int(tall * 0.2)
            cv2.ellipse(picture, ear, axes, 0, 0, 360, (0.7 * colour).tolist(), max(int(across / 6), 2))
        _stand(picture, _turned(random, int(random.integers(4, 9))), place, (across, tall), colour)
    return picture


def _chessmen(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A board with men, from the side: columns with a round head."""
    import cv2

    picture = _lit(random, high, wide)
    near, rows = int(random.uniform(0.4, 0.6) * high), 6
    for row in range(rows):
        a, b = (near + (high - near) * n // rows for n in (row, row + 1))
        for column in range(10):
            shade = 230 if (row + column) % 2 else 60
            picture[a:b, column * wide // 10 : (column + 1) * wide // 10] = shade
    half = np.concatenate([np.full(30, 0.35), np.linspace(0.25, 0.6, 45), np.full(25, 1.0)])
    for _ in range(int(random.integers(3, 14))):
        foot = random.uniform(near + 0.1 * high, high)
        tall = 0.5 * (foot - 0.2 * high) * random.uniform(0.6, 1)
        place = random.uniform(0.05, 0.95) * wide, foot
        colour = np.full(3, random.choice([40.0, 225.0])) * (0.8, 0.9, 1)
        _stand(picture, half, place, (0.22 * tall, tall), colour)
        top = int(place[0]), int(foot - tall)
        cv2.circle(picture, top, int(0.16 * tall), colour.tolist(), -1, cv2.LINE_AA)
    return picture


def _vehicles(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Cars and lorries from the side, on a road."""
    import cv2

    picture = _lit(random, high, wide)
    for _ in range(int(random.integers(1, 5))):
        long = random.uniform(0.25, 0.8) * wide
        x, y, tall = random.uniform(-0.1, 0.8) * wide, random.uniform(0.5, 0.95) * high, 0.25 * long
        colour = [int(part) for part in random.integers(0, 256, 3)]
        shape = np.array(
            [(0, 0), (0, -0.5), (0.2, -0.55), (0.32, -1), (0.72, -1), (0.85, -0.5), (1, -0.4), (1, 0)]
        )
        if random.random() < 0.3:
            shape = np.array([(0, 0), (0, -1.4), (0.68, -1.4), (0.68, -1), (0.9, -1), (1, -0.5), (1, 0)])
        cv2.fillPoly(picture, [(shape * (long, tall) + (x, y)).astype(np.int32)], colour, cv2.LINE_AA)
        glass = np.array([(0.36, -0.9), (0.52, -0.9), (0.52, -0.6), (0.28, -0.6)])
        cv2.fillPoly(picture, [(glass * (long, tall) + (x, y)).astype(np.int32)], (90, 70, 60), cv2.LINE_AA)
        for share in (0.2, 0.8):
            hub = int(x + share * long), int(y)
            cv2.circle(picture, hub, int(0.32 * tall), (25, 25, 25), -1, cv2.LINE_AA)
            cv2.circle(picture, hub, int(0.16 * tall), (170, 170, 170), -1, cv2.LINE_AA)
    return picture


def _washing(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Shirts and trousers on a line: clothes that nobody wears."""
    import cv2

    picture = _lit(random, high, wide)
    line = random.uniform(0.05, 0.35) * high
    cv2.line(picture, (0, int(line)), (wide, int(line)), (60, 60, 60), 2, cv2.LINE_AA)
    shirt = np.array(
        [(-0.25, 0), (0.25, 0), (0.8, 0.5), (0.62, 0.68), (0.4, 0.45), (0.4, 1.2), (-0.4, 1.2), (-0.4, 0.45),
         (-0.62, 0.68), (-0.8, 0.5)]
    )  # fmt: skip
    trousers = np.array(
        [(-0.35, 0), (0.35, 0), (0.42, 1.5), (0.12, 1.5), (0, 0.5), (-0.12, 1.5), (-0.42, 1.5)]
    )
    towel = np.array([(-0.5, 0), (0.5, 0), (0.5, 1.0), (-0.5, 1.0)])
    size, x = random.uniform(0.2, 0.5) * high, random.uniform(0.02, 0.3) * wide
    while x < wide:
        kind = (shirt, trousers, towel)[int(random.integers(3))]
        swing = np.array([[1, 0], [random.uniform(-0.2, 0.2), 1]])
        place = kind @ swing * size * random.uniform(0.7, 1.1) + (x, line)
        colour = [int(part) for part in random.integers(0, 256, 3)]
        cv2.fillPoly(picture, [place.astype(np.int32)], colour, cv2.LINE_AA)
        x += size * random.uniform(1, 2)
    return picture


def _circuit(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A board with tracks, chips and pins."""
    import cv2

    picture = np.full((high, wide, 3), (50, 90, 20), np.uint8) + random.integers(0, 40, 3).astype(np.uint8)
    track = tuple(int(part) for part in random.integers(60, 200, 3))
    for _ in range(int(random.integers(10, 60))):
        x, y = int(random.integers(0, wide)), int(random.integers(0, high))
        for _ in range(int(random.integers(2, 6))):
            step = int(random.integers(10, 90))
            turn = random.choice([0, 0.25, 0.5, 0.75, 1, 1.25, 1.5, 1.75]) * np.pi
            end = int(x + step * np.cos(turn)), int(y + step * np.sin(turn))
            cv2.line(picture, (x, y), end, track, 2, cv2.LINE_AA)
            x, y = end
        cv2.circle(picture, (x, y), 4, (160, 200, 210), -1)
    for _ in range(int(random.integers(1, 7))):
        x, y = int(random.integers(0, wide)), int(random.integers(0, high))
        across, tall = (int(part) for part in random.integers(20, 140, 2))
        for pin in range(0, across, 10):
            picture[max(y - 6, 0) : y + tall + 6, x + pin : x + pin + 4] = 190
        picture[y : y + tall, x : x + across] = 30
    return picture


def _clocks(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Dials with hands and numbers: round, with two arms."""
    import cv2

    picture = _lit(random, high, wide)
    for _ in range(int(random.integers(1, 4))):
        radius = random.uniform(0.12, 0.45) * high
        middle = random.uniform(0.2, 0.8, 2) * (wide, high)
        centre = int(middle[0]), int(middle[1])
        face, ink = (245, 30) if random.random() < 0.7 else (30, 235)
        cv2.circle(picture, centre, int(radius), (face,) * 3, -1, cv2.LINE_AA)
        cv2.circle(picture, centre, int(radius), (ink,) * 3, max(int(radius / 14), 1), cv2.LINE_AA)
        for hour in range(1, 13):
            way = np.array([np.sin(hour * np.pi / 6), -np.cos(hour * np.pi / 6)])
            at = middle + 0.8 * radius * way - 0.06 * radius
            cv2.putText(
                picture, str(hour), (int(at[0]), int(at[1] + 0.12 * radius)), 0, radius / 200, (ink,) * 3, 1
            )
        for share, thick in ((0.5, 0.07), (0.75, 0.04)):
            turn = random.uniform(0, 2 * np.pi)
            end = middle + share * radius * np.array([np.cos(turn), np.sin(turn)])
            cv2.line(
                picture,
                centre,
                (int(end[0]), int(end[1])),
                (ink,) * 3,
                max(int(thick * radius), 1),
                cv2.LINE_AA,
            )
    return picture


def _notes(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Sheet music: staves, heads and stems."""
    import cv2

    picture = np.full((high, wide, 3), random.integers(215, 256), np.uint8)
    gap, y = int(random.integers(5, 16)), int(random.integers(10, 50))
    while y < high:
        for line in range(5):
            cv2.line(picture, (0, y + line * gap), (wide, y + line * gap), (60, 60, 60), 1)
        x = int(random.integers(10, 60))
        while x < wide:
            head = x, int(y + random.integers(-1, 10) * gap / 2)
            cv2.ellipse(
                picture, head, (int(0.7 * gap), int(0.5 * gap)), -20, 0, 360, (10, 10, 10), -1, cv2.LINE_AA
            )
            up = 1 if random.random() < 0.5 else -1
            cv2.line(
                picture,
                (x + up * gap // 2, head[1]),
                (x + up * gap // 2, head[1] - up * 4 * gap),
                (10, 10, 10),
                2,
            )
            x += int(random.integers(2, 7)) * gap
        y += 9 * gap
    return picture


def _bridge(random: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Pylons, a roadway and its cables over water."""
    import cv2

    sky, sea = random.integers(90, 256, 3), random.integers(20, 160, 3)
    picture = np.zeros((high, wide, 3), np.uint8)
    shore = int(random.uniform(0.55, 0.8) * high)
    picture[:shore], picture[shore:] = sky, sea
    colour = tuple(int(part) for part in random.integers(0, 180, 3))
    road = int(shore - random.uniform(0.05, 0.2) * high)
    thick = int(random.integers(3, 14))
    for x in np.arange(random.uniform(0.05, 0.3), 1.1, random.uniform(0.25, 0.6)) * wide:
        top = random.uniform(0.08, 0.25) * high
        apart = int(random.uniform(0.0, 0.05) * wide)
        for leg in (-apart, apart):
            cv2.line(picture, (int(x) + leg, int(top)), (int(x) + leg, shore + 10), colour, thick)
        cv2.line(
            picture,
            (int(x) - apart, int(0.5 * (top + road))),
            (int(x) + apart, int(0.5 * (top + road))),
            colour,
            thick,
        )
        for reach in np.linspace(0.03, 0.3, 9) * wide:
            for side in (-1, 1):
                cv2.line(picture, (int(x), int(top)), (int(x + side * reach), road), colour, 1, cv2.LINE_AA)
    cv2.line(picture, (0, road), (wide, road), colour, thick)
    return picture
