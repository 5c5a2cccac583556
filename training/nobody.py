"""Pictures without anybody, drawn: what a pose network is shown when an archive holds anything but people."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import cv2
import numpy as np

from .scenes import invent

Draw = Callable[[np.random.Generator, int, int], np.ndarray]
_LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 .,:;-_/(){}[]<>=+*#$%&"
_FONTS = (cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_PLAIN, cv2.FONT_HERSHEY_COMPLEX, cv2.FONT_HERSHEY_DUPLEX)


def _colour(rng: np.random.Generator, low: float = 0, high: float = 255) -> tuple[int, int, int]:
    b, g, r = rng.uniform(low, high, 3)
    return int(b), int(g), int(r)


def _clouds(rng: np.random.Generator, high: int, wide: int, power: float) -> np.ndarray:
    """(high, wide) noise in 0..1 whose amplitude falls with the frequency to the ``power``."""
    y, x = np.fft.fftfreq(high)[:, None], np.fft.rfftfreq(wide)[None]
    size = np.maximum(np.hypot(x, y), 1 / max(high, wide))
    wave = np.exp(2j * np.pi * rng.uniform(0, 1, size.shape)) / size**power
    field = np.fft.irfft2(wave, (high, wide))
    field = (field - field.min()) / max(float(np.ptp(field)), 1e-9)
    return field.astype(np.float32)


def _bars(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Colour bars of a test picture, some with a second row, a circle or a counter."""
    count = int(rng.integers(5, 12))
    level = int(rng.choice([191, 255]))
    colours = [
        (level * (n >> 0 & 1), level * (n >> 1 & 1), level * (n >> 2 & 1)) for n in (7, 6, 3, 2, 5, 4, 1, 0)
    ]
    row = np.array([colours[i % 8] if rng.random() < 0.8 else _colour(rng) for i in range(count)], np.uint8)
    picture = cv2.resize(row[None], (wide, high), interpolation=cv2.INTER_NEAREST)
    if rng.random() < 0.6:
        cut = int(rng.uniform(0.55, 0.9) * high)
        grey = np.linspace(0, 255, int(rng.integers(4, 40))).astype(np.uint8)
        strip = cv2.resize(grey[None], (wide, high - cut), interpolation=cv2.INTER_NEAREST)
        picture[cut:] = strip[..., None]
    if rng.random() < 0.4:
        centre = wide // 2, high // 2
        cv2.circle(
            picture, centre, int(rng.uniform(0.2, 0.48) * high), (255, 255, 255), int(rng.integers(1, 6))
        )
    if rng.random() < 0.5:
        _write(rng, picture, (255, 255, 255), lines=1)
    return picture


def _write(rng: np.random.Generator, picture: np.ndarray, colour: tuple[int, int, int], lines: int) -> None:
    """Lines of letters at one size and margin."""
    high, wide = picture.shape[:2]
    scale = (
        float(rng.uniform(0.3, 1.2)) * high / 480 if lines > 1 else float(rng.uniform(0.5, 3)) * high / 480
    )
    font, step = int(rng.choice(_FONTS)), int(max(8, 34 * scale * rng.uniform(0.8, 1.6)))
    left, top = int(rng.uniform(0, 0.2) * wide), int(rng.uniform(0.02, 0.3) * high) + step
    for line in range(lines):
        length = int(rng.integers(0, 70))
        text = "".join(rng.choice(list(_LETTERS), length))
        cv2.putText(picture, text, (left, top + line * step), font, scale, colour, max(1, int(2 * scale)))


def _page(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A page, a slide or a terminal: letters on one colour."""
    dark = rng.random() < 0.5
    picture = np.full((high, wide, 3), _colour(rng, 0, 60) if dark else _colour(rng, 190, 255), np.uint8)
    for _ in range(int(rng.integers(1, 4))):
        _write(
            rng, picture, _colour(rng, 120, 255) if dark else _colour(rng, 0, 130), int(rng.integers(1, 40))
        )
    return picture


def _desktop(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Windows with title bars, buttons, text and pictures on a background."""
    picture = _gradient(rng, high, wide)
    for _ in range(int(rng.integers(1, 6))):
        w, h = int(rng.uniform(0.2, 0.9) * wide), int(rng.uniform(0.2, 0.9) * high)
        x, y = int(rng.uniform(-0.1, 0.8) * wide), int(rng.uniform(-0.1, 0.8) * high)
        box = picture[max(y, 0) : y + h, max(x, 0) : x + w]
        if box.shape[0] < 30 or box.shape[1] < 30:
            continue
        box[:] = _page(rng, *box.shape[:2]) if rng.random() < 0.7 else _colour(rng)
        bar = max(4, box.shape[0] // 14)
        box[:bar] = _colour(rng)
        for button in range(int(rng.integers(0, 4))):
            cv2.circle(box, (bar * (button + 1), bar // 2), bar // 3, _colour(rng), -1)
    return picture


def _gradient(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Light that changes over the picture, a vignette among them."""
    corners = rng.uniform(0, 255, (int(rng.integers(1, 4)), int(rng.integers(1, 4)), 3)).astype(np.float32)
    scene = cv2.resize(corners, (wide, high), interpolation=cv2.INTER_CUBIC)
    if rng.random() < 0.4:
        y, x = np.mgrid[-1 : 1 : high * 1j, -1 : 1 : wide * 1j]
        middle = rng.uniform(-0.5, 0.5, 2)
        scene *= np.exp(-((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / rng.uniform(0.2, 2))[..., None]
    clipped: np.ndarray = np.clip(scene, 0, 255).astype(np.uint8)
    return clipped


def _dark(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Black, white, grey or one colour, with a sensor's noise or without."""
    level = rng.choice([0.0, 2.0, 16.0, 235.0, 255.0, rng.uniform(0, 255)])
    tone = np.full(3, level) if rng.random() < 0.7 else rng.uniform(0, 255, 3)
    noise = rng.normal(0, rng.choice([0, 0, 1, 3, 10]), (high, wide, 1 if rng.random() < 0.5 else 3))
    clipped: np.ndarray = np.clip(tone + noise + np.zeros((1, 1, 3)), 0, 255).astype(np.uint8)
    return clipped


def _noise(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Snow, clouds, marble, leaves: noise of every roughness, some of it in a few tones only."""
    power = rng.uniform(0, 2.2)
    planes = [_clouds(rng, high, wide, power) for _ in range(1 if rng.random() < 0.4 else 3)]
    field = np.stack(planes * (3 // len(planes)), axis=-1)
    if rng.random() < 0.3:
        field = np.round(field * (tones := rng.integers(1, 6))) / tones
    low, high_ = rng.uniform(0, 130, 3), rng.uniform(90, 255, 3)
    clipped: np.ndarray = np.clip(low + field * (high_ - low), 0, 255).astype(np.uint8)
    return clipped


def _planks(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A floor of planks or tiles, straight from above or in perspective."""
    long = cv2.resize(_clouds(rng, high, max(8, wide // 12), rng.uniform(0.3, 1)), (wide, high))
    base = (
        np.array(_colour(rng, 30, 220), np.float32)
        if rng.random() < 0.4
        else rng.uniform([20, 50, 80], [110, 150, 210])
    )
    picture = base * (0.75 + 0.5 * long[..., None])
    rows, columns = int(rng.integers(3, 16)), int(rng.integers(1, 12))
    for row in range(rows):
        a, b = row * high // rows, (row + 1) * high // rows
        shift = rng.uniform(0, 1)
        for column in range(columns + 1):
            x = int((column - shift) * wide / columns)
            part = picture[a:b, max(x, 0) : max(0, x + wide // columns)]
            part *= rng.uniform(0.75, 1.2)
            cv2.line(picture, (x, a), (x, b), [float(v) for v in base * 0.4], int(rng.integers(1, 4)))
        cv2.line(picture, (0, a), (wide, a), [float(v) for v in base * 0.4], int(rng.integers(1, 4)))
    picture = np.clip(picture, 0, 255).astype(np.uint8)
    if rng.random() < 0.5:
        picture = np.ascontiguousarray(cv2.rotate(cv2.resize(picture, (high, wide)), cv2.ROTATE_90_CLOCKWISE))
    return _tilted(rng, picture) if rng.random() < 0.6 else picture


def _tilted(rng: np.random.Generator, picture: np.ndarray) -> np.ndarray:
    """The picture as a plane seen from aside."""
    high, wide = picture.shape[:2]
    corners = np.array([[0, 0], [wide, 0], [wide, high], [0, high]], np.float32)
    moved = corners + rng.uniform(-0.35, 0.35, (4, 2)).astype(np.float32) * (wide, high)
    matrix = cv2.getPerspectiveTransform(corners, moved.astype(np.float32))
    return cv2.warpPerspective(picture, matrix, (wide, high), borderMode=cv2.BORDER_REFLECT)


def _keyboard(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Keys with letters, in rows; or any other grid of boxes."""
    body, key = _colour(rng, 0, 255), _colour(rng, 0, 255)
    picture = np.full((high, wide, 3), body, np.uint8)
    rows, columns = int(rng.integers(3, 9)), int(rng.integers(5, 18))
    step_x, step_y, gap = wide / columns, high / rows, rng.uniform(0.02, 0.2)
    for row in range(rows):
        x = -rng.uniform(0, 1) * step_x
        while x < wide:
            width = step_x * rng.choice([1, 1, 1, 1, 1.5, 2, 4])
            a = int(x + gap * step_x), int((row + gap) * step_y)
            b = int(x + width - gap * step_x), int((row + 1 - gap) * step_y)
            cv2.rectangle(picture, a, b, key, -1)
            cv2.rectangle(picture, a, b, tuple(int(0.6 * v) for v in key), 1)
            if rng.random() < 0.9:
                ink = (255, 255, 255) if sum(key) < 380 else (20, 20, 20)
                at = a[0] + int(0.2 * step_x), b[1] - int(0.3 * step_y)
                letter = str(rng.choice(list(_LETTERS)))
                cv2.putText(picture, letter, at, cv2.FONT_HERSHEY_SIMPLEX, step_y / 60, ink, 1, cv2.LINE_AA)
            x += width
    return _tilted(rng, picture) if rng.random() < 0.7 else picture


def _room(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A wall with light on it and things that stand about."""
    return cv2.resize(invent(rng, max(high, wide)), (wide, high))


def _furniture(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Chairs, tables, shelves and lamps before a wall: boards on thin legs, upright as people are."""
    picture = _room(rng, high, wide) if rng.random() < 0.5 else _gradient(rng, high, wide)
    floor = int(rng.uniform(0.55, 0.95) * high)
    picture[floor:] = np.clip(picture[floor:] * rng.uniform(0.4, 0.9) + rng.uniform(0, 40, 3), 0, 255)
    for _ in range(int(rng.integers(1, 6))):
        colour, dark = _colour(rng), _colour(rng, 0, 90)
        x, size = int(rng.uniform(0, 1) * wide), int(rng.uniform(0.15, 0.7) * high)
        base = min(high - 1, floor + int(rng.uniform(0, 0.3) * high))
        half, thick = int(size * rng.uniform(0.2, 0.5)), max(2, int(size * rng.uniform(0.02, 0.08)))
        kind = rng.random()
        if kind < 0.35:  # a chair
            seat = base - size // 2
            cv2.rectangle(picture, (x - half, seat), (x + half, seat + 2 * thick), colour, -1)
            cv2.rectangle(picture, (x - half, base - size), (x + half, seat - 2 * thick), colour, -1)
            for leg in (-half, half, -half // 2, half // 2):
                cv2.line(picture, (x + leg, seat), (x + leg, base), dark, thick)
        elif kind < 0.55:  # a table
            top = base - size // 2
            cv2.rectangle(picture, (x - 2 * half, top), (x + 2 * half, top + 2 * thick), colour, -1)
            for leg in (-2 * half + thick, 2 * half - thick):
                cv2.line(picture, (x + leg, top), (x + leg, base), colour, 2 * thick)
        elif kind < 0.75:  # a lamp, a plant, a coat stand
            cv2.line(picture, (x, base), (x, base - size), dark, thick)
            for _ in range(int(rng.integers(1, 9))):
                at = x + int(rng.normal(0, half / 3)), base - size + int(rng.normal(0, half / 3))
                axes = int(half * rng.uniform(0.2, 0.7)) + 1, int(half * rng.uniform(0.1, 0.6)) + 1
                cv2.ellipse(picture, at, axes, float(rng.uniform(0, 180)), 0, 360, colour, -1)
        else:  # shelves
            cv2.rectangle(picture, (x - half, base - size), (x + half, base), colour, -1)
            for shelf in range(base - size, base, max(8, size // int(rng.integers(3, 7)))):
                cv2.rectangle(picture, (x - half + thick, shelf), (x + half - thick, shelf + thick), dark, -1)
    return picture


def _animal(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A trunk on four legs with a head and a tail, of fur, before leaves or grass."""
    picture = _noise(rng, high, wide) if rng.random() < 0.6 else _room(rng, high, wide)
    layer = np.zeros((high, wide), np.uint8)
    size = rng.uniform(0.15, 0.45) * min(high, wide)
    x, y = rng.uniform(0.3, 0.7) * wide, rng.uniform(0.35, 0.7) * high
    side = 1 if rng.random() < 0.5 else -1
    cv2.ellipse(layer, (int(x), int(y)), (int(size), int(size * rng.uniform(0.4, 0.65))), 0, 0, 360, 255, -1)
    for leg in (-0.75, -0.5, 0.5, 0.75):
        foot = int(x + leg * size + rng.normal(0, 0.12) * size), int(y + size * rng.uniform(0.9, 1.4))
        cv2.line(layer, (int(x + leg * size), int(y)), foot, 255, max(2, int(size * rng.uniform(0.1, 0.3))))
    head = int(x + side * size * rng.uniform(0.9, 1.2)), int(y - size * rng.uniform(0.0, 0.6))
    cv2.circle(layer, head, int(size * rng.uniform(0.25, 0.42)), 255, -1)
    for ear in (-1, 1):
        cv2.circle(
            layer,
            (int(head[0] + ear * 0.22 * size), int(head[1] - 0.3 * size)),
            max(1, int(0.1 * size)),
            255,
            -1,
        )
    tail = int(x - side * size * 1.5), int(y - size * rng.uniform(-0.3, 0.6))
    cv2.line(layer, (int(x - side * 0.8 * size), int(y)), tail, 255, max(1, int(0.08 * size)))
    tone = rng.uniform([10, 20, 30], [150, 180, 210])
    fur = tone * (0.5 + _clouds(rng, high, wide, rng.uniform(0.2, 1.2)))[..., None]
    picture = np.where(layer[..., None] > 0, np.clip(fur, 0, 255), picture).astype(np.uint8)
    for eye in (-1, 1):
        cv2.circle(
            picture, (int(head[0] + eye * 0.1 * size), head[1]), max(1, int(0.035 * size)), (5, 5, 5), -1
        )
    return picture


KINDS: Mapping[str, Draw] = {
    "bars": _bars, "page": _page, "desktop": _desktop, "gradient": _gradient, "dark": _dark, "noise": _noise,
    "planks": _planks, "keyboard": _keyboard, "room": _room, "furniture": _furniture, "animal": _animal,
}  # fmt: skip
"""Each draws (H, W, 3) uint8 from a generator, a height and a width."""
