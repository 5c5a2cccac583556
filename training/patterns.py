"""More pictures without anybody: what `nobody` draws as things, here as patterns, strokes, cloth and mixtures."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from .nobody import _FONTS, _LETTERS, KINDS, Draw, _clouds, _colour, _gradient, _tilted


def _ground(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """One colour, light that changes, or clouds."""
    kind = rng.random()
    if kind < 0.4:
        return np.full((high, wide, 3), _colour(rng), np.uint8)
    if kind < 0.75:
        return _gradient(rng, high, wide)
    cloud = _clouds(rng, high, wide, rng.uniform(0.8, 2))[..., None]
    ground: np.ndarray = np.clip(rng.uniform(0, 200, 3) + cloud * rng.uniform(-90, 120, 3), 0, 255).astype(
        np.uint8
    )
    return ground


def _words(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A few large words: slides, signs, title pages, single letters."""
    picture = _ground(rng, high, wide) if rng.random() < 0.6 else np.full((high, wide, 3), 0, np.uint8)
    picture[:] = picture if picture.any() else (0 if rng.random() < 0.5 else 255)
    ink = (255, 255, 255) if picture.mean() < 128 else (0, 0, 0)
    for _ in range(int(rng.integers(1, 8))):
        text = "".join(rng.choice(list(_LETTERS), int(rng.integers(1, 14))))
        scale = float(rng.uniform(0.6, 9)) * high / 480
        at = int(rng.uniform(-0.2, 0.7) * wide), int(rng.uniform(0.05, 1.1) * high)
        thick = max(1, int(scale * rng.uniform(0.8, 6)))
        colour = ink if rng.random() < 0.6 else _colour(rng)
        cv2.putText(picture, text, at, int(rng.choice(_FONTS)), scale, colour, thick, cv2.LINE_AA)
    return _tilted(rng, picture) if rng.random() < 0.3 else picture


def _outline(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """(K, 2) int32 outline of a blob, a polygon, a star or a leaf anywhere in the picture."""
    count = int(rng.integers(3, 24))
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    rough = rng.uniform(0, 0.7)
    radius = rng.uniform(0.02, 0.4) * high * (1 + rough * rng.uniform(-1, 1, count))
    stretch = rng.uniform(0.3, 1, 2)
    points = np.stack([np.cos(angle), np.sin(angle)], 1) * radius[:, None] * stretch
    if rng.random() < 0.5 and count > 3:  # round
        points = cv2.resize(points.astype(np.float32), (2, 8 * count), interpolation=cv2.INTER_CUBIC)
    turn = rng.uniform(0, np.pi)
    points = points @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    outline: np.ndarray = (points + rng.uniform(-0.1, 1.1, 2) * (wide, high)).astype(np.int32)
    return outline


def _shapes(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Blobs and polygons, plain, shaded or with a texture; some pictures are symmetric."""
    picture = _ground(rng, high, wide)
    palette = [_colour(rng) for _ in range(int(rng.integers(2, 7)))]
    for _ in range(int(rng.integers(1, 30))):
        layer = np.zeros((high, wide), np.uint8)
        kind = rng.random()
        if kind < 0.6:
            cv2.fillPoly(layer, [_outline(rng, high, wide)], 255)
        else:
            at = int(rng.uniform(0, 1) * wide), int(rng.uniform(0, 1) * high)
            axes = int(rng.uniform(0.01, 0.3) * high) + 1, int(rng.uniform(0.01, 0.3) * high) + 1
            cv2.ellipse(layer, at, axes, float(rng.uniform(0, 180)), 0, 360, 255, -1)
        fill = np.full((high, wide, 3), palette[int(rng.integers(len(palette)))], np.float32)
        if rng.random() < 0.4:
            fill = fill * (0.5 + _clouds(rng, high, wide, rng.uniform(0.3, 2)))[..., None]
        if rng.random() < 0.3:  # a shadow, as of a ball
            depth = cv2.distanceTransform(layer, cv2.DIST_L2, 3)
            fill = fill * (0.4 + 0.8 * depth / max(float(depth.max()), 1))[..., None]
        soft = (cv2.GaussianBlur(layer, (0, 0), rng.uniform(0.4, 4)) / np.float32(255))[..., None]
        picture = np.clip(picture * (1 - soft) + fill * soft, 0, 255).astype(np.uint8)
    if rng.random() < 0.3:
        half = picture[:, : wide // 2]
        picture[:, wide - half.shape[1] :] = half[:, ::-1]
    return picture


def _strokes(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Wires, scribbles, cracks: lines that wander."""
    picture = _ground(rng, high, wide)
    ink = _colour(rng)
    for _ in range(int(rng.integers(1, 40))):
        count, step = int(rng.integers(2, 60)), rng.uniform(0.01, 0.12) * high
        turn = np.cumsum(rng.normal(0, rng.uniform(0, 0.9), count)) + rng.uniform(0, 2 * np.pi)
        path = np.cumsum(np.stack([np.cos(turn), np.sin(turn)], 1) * step, axis=0)
        path = path + rng.uniform(0, 1, 2) * (wide, high)
        colour = ink if rng.random() < 0.6 else _colour(rng)
        cv2.polylines(
            picture, [path.astype(np.int32)], rng.random() < 0.2, colour, int(rng.integers(1, 14)), cv2.LINE_AA
        )
    return picture


def _frames(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Bars that meet at joints: scaffolds, bicycles, easels, antennas, swings."""
    picture = _ground(rng, high, wide)
    for _ in range(int(rng.integers(1, 4))):
        count = int(rng.integers(4, 14))
        joints = rng.uniform(-0.2, 0.2, (count, 2)) * high * rng.uniform(0.6, 2.5)
        if rng.random() < 0.5:
            joints[:, 0] *= 0.4  # upright
        if rng.random() < 0.4:
            joints[count // 2 :] = joints[: count - count // 2] * (-1, 1)
        joints = joints + rng.uniform(0.2, 0.8, 2) * (wide, high)
        thick, colour = int(rng.integers(2, 26)), _colour(rng)
        for _ in range(int(rng.integers(count, 2 * count))):
            a, b = (tuple(int(v) for v in joints[rng.integers(count)]) for _ in range(2))
            cv2.line(picture, a, b, colour, thick, cv2.LINE_AA)
        for joint in joints:
            if rng.random() < 0.3:
                radius = int(thick * rng.uniform(0.6, 3))
                cv2.circle(picture, (int(joint[0]), int(joint[1])), radius, _colour(rng), int(rng.choice([-1, 2])))
    return picture


def _texture(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Stripes, waves, dots, weaves, bricks: one thing again and again."""
    y, x = np.mgrid[:high, :wide].astype(np.float32)
    turn = rng.uniform(0, np.pi)
    u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    bend = (_clouds(rng, high, wide, 2) - 0.5) * rng.choice([0, 0, 20, 120])
    u, v = u + bend, v + bend.T.reshape(-1)[: high * wide].reshape(high, wide) if rng.random() < 0.5 else v
    a, b = rng.uniform(0.02, 0.5, 2)
    kind = int(rng.integers(5))
    if kind == 0:
        field = np.sin(a * u)
    elif kind == 1:
        field = np.sin(a * u) * np.sin(b * v)
    elif kind == 2:
        field = np.sin(a * u) + np.sin(b * v) + np.sin((a + b) * (u + v) / 2)
    elif kind == 3:  # bricks
        row = np.floor(a * v / 3)
        joint = np.minimum(np.mod(a * v / 3, 1), np.mod(b * u / 6 + 0.5 * row, 1))
        field = (joint > 0.1) * 2.0 - 1 + 0.3 * np.sin(row * 7 + np.floor(b * u / 6 + 0.5 * row) * 13)
    else:  # dots
        field = 0.4 - np.hypot(np.mod(a * u / 4, 1) - 0.5, np.mod(a * v / 4, 1) - 0.5) * 2
    if rng.random() < 0.5:
        field = np.sign(field - rng.uniform(-0.6, 0.6))
    low, up = rng.uniform(0, 255, 3), rng.uniform(0, 255, 3)
    mix = np.clip((field + 1) / 2, 0, 1)[..., None]
    picture = np.clip(low + mix * (up - low), 0, 255).astype(np.uint8)
    return _tilted(rng, picture) if rng.random() < 0.4 else picture


def _cloth(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Curtains, sheets, carpets: folds and their shadows."""
    y, x = np.mgrid[:high, :wide].astype(np.float32)
    bend = _clouds(rng, high, wide, rng.uniform(1.5, 2.5)) * rng.uniform(0, 200)
    along = x + bend if rng.random() < 0.7 else y + bend
    light = sum(np.sin(along * f + rng.uniform(0, 6)) / (1 + i) for i, f in enumerate(rng.uniform(0.01, 0.2, 4)))
    tone = rng.uniform(20, 230, 3) * (1 + rng.uniform(0.05, 0.5) * np.asarray(light)[..., None] / 2)
    if rng.random() < 0.3:
        tone = tone * (1 + 0.3 * np.sign(np.sin(rng.uniform(0.05, 0.5) * (x + bend)))[..., None])
    picture: np.ndarray = np.clip(tone, 0, 255).astype(np.uint8)
    return picture


def _bokeh(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Lights and things out of focus."""
    picture = _ground(rng, high, wide).astype(np.float32)
    for _ in range(int(rng.integers(3, 60))):
        layer = np.zeros((high, wide), np.float32)
        at = int(rng.uniform(0, 1) * wide), int(rng.uniform(0, 1) * high)
        cv2.circle(layer, at, int(rng.uniform(0.01, 0.15) * high) + 1, 1.0, -1)
        layer = cv2.GaussianBlur(layer, (0, 0), rng.uniform(0.5, 12))[..., None] * rng.uniform(0.2, 1)
        picture = picture * (1 - layer) + np.array(_colour(rng), np.float32) * layer
    return np.clip(picture, 0, 255).astype(np.uint8)


def _icons(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """A screen of pictograms, thumbnails and labels in rows."""
    picture = _ground(rng, high, wide)
    rows, columns = int(rng.integers(1, 7)), int(rng.integers(1, 9))
    round_, gap = rng.random() < 0.5, rng.uniform(0.1, 0.4)
    for row in range(rows):
        for column in range(columns):
            a = int((column + gap / 2) * wide / columns), int((row + gap / 2) * high / rows)
            b = int((column + 1 - gap / 2) * wide / columns), int((row + 1 - gap) * high / rows)
            if b[0] - a[0] < 8 or b[1] - a[1] < 8:
                continue
            centre, radius = ((a[0] + b[0]) // 2, (a[1] + b[1]) // 2), min(b[0] - a[0], b[1] - a[1]) // 2
            if round_:
                cv2.circle(picture, centre, radius, _colour(rng), -1)
            else:
                cv2.rectangle(picture, a, b, _colour(rng), -1)
            sign = (_outline(rng, 4 * radius, 4 * radius) - 2 * radius) // 3 + centre
            if rng.random() < 0.5:
                cv2.fillPoly(picture, [sign.astype(np.int32)], _colour(rng))
            else:
                letter = str(rng.choice(list(_LETTERS)))
                cv2.putText(picture, letter, (centre[0] - radius // 2, centre[1] + radius // 2), 0, radius / 14, _colour(rng), 1 + radius // 8)
    return picture


def _machine(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Boxes, pipes, knobs, dials and wheels of one metal."""
    picture = _ground(rng, high, wide)
    metal = np.array(_colour(rng), np.float32)
    for _ in range(int(rng.integers(3, 18))):
        tone = [float(v) for v in np.clip(metal * rng.uniform(0.4, 1.5), 0, 255)]
        x, y = int(rng.uniform(0, 1) * wide), int(rng.uniform(0, 1) * high)
        size = int(rng.uniform(0.04, 0.35) * high) + 2
        kind = rng.random()
        if kind < 0.4:
            cv2.rectangle(picture, (x, y), (x + int(size * rng.uniform(0.4, 2)), y + size), tone, -1)
        elif kind < 0.6:
            end = (x, int(rng.uniform(0, 1) * high)) if rng.random() < 0.5 else (int(rng.uniform(0, 1) * wide), y)
            cv2.line(picture, (x, y), end, tone, max(2, size // 4))
        else:
            cv2.circle(picture, (x, y), size // 2, tone, -1)
            cv2.circle(picture, (x, y), size // 2, (20, 20, 20), max(1, size // 14))
            for spoke in np.arange(int(rng.integers(0, 7))) * rng.uniform(0.5, 1.6):
                end = int(x + size / 2.2 * np.cos(spoke)), int(y + size / 2.2 * np.sin(spoke))
                cv2.line(picture, (x, y), end, (230, 230, 230), max(1, size // 16))
    return picture


def _swirl(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Another kind, bent as by water or old glass."""
    picture = _drawn(rng, high, wide)
    y, x = np.mgrid[:high, :wide].astype(np.float32)
    reach = rng.uniform(10, 160)
    moved = [(_clouds(rng, high, wide, rng.uniform(1.6, 2.6)) - 0.5) * reach for _ in range(2)]
    return cv2.remap(picture, x + moved[0], y + moved[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)


def _mixture(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    """Two kinds, one behind the other or in a part of the other."""
    a, b = _drawn(rng, high, wide), _drawn(rng, high, wide)
    share = np.full((high, wide, 1), rng.uniform(0.2, 0.8), np.float32)
    if rng.random() < 0.6:
        cloud = _clouds(rng, high, wide, rng.uniform(1.2, 2.6))
        share = 1 / (1 + np.exp(-(cloud - np.median(cloud)) * rng.uniform(3, 80)))[..., None]
    mixed: np.ndarray = np.clip(a * share + b * (1 - share), 0, 255).astype(np.uint8)
    return mixed


def _drawn(rng: np.random.Generator, high: int, wide: int) -> np.ndarray:
    plain = [*KINDS.values(), _words, _shapes, _strokes, _frames, _texture, _cloth, _bokeh, _icons, _machine]
    return plain[int(rng.integers(len(plain)))](rng, high, wide)


PATTERNS: Mapping[str, Draw] = {
    "words": _words, "shapes": _shapes, "strokes": _strokes, "frames": _frames, "texture": _texture,
    "cloth": _cloth, "bokeh": _bokeh, "icons": _icons, "machine": _machine, "swirl": _swirl, "mixture": _mixture,
}  # fmt: skip
"""Each draws (H, W, 3) uint8 from a generator, a height and a width."""
