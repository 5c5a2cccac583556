"""How a performer looks: rounded limbs with a light side, a face, a wall and a floor."""

from __future__ import annotations

import numpy as np

from gesture_core.demo.figure import Body, Colour
from gesture_core.skeletons import COCO18

_SUPERSAMPLE = 2


def draw(body: Body, points: np.ndarray, backdrop: np.ndarray) -> np.ndarray:
    """One picture.

    Parameters
    ----------
    body : Body
    points : (18, 2) array
        Joints in pixels.
    backdrop : (H, W, 3) uint8
        From `backdrop_of`.

    Returns
    -------
    (H, W, 3) uint8, BGR
    """
    import cv2

    height, width = backdrop.shape[:2]
    picture = cv2.resize(backdrop, None, fx=_SUPERSAMPLE, fy=_SUPERSAMPLE)
    at = {name: points[i].astype(float) * _SUPERSAMPLE for i, name in enumerate(COCO18.joints)}
    unit = body.torso * _SUPERSAMPLE
    for side in ("right", "left"):
        _limb(picture, at[f"{side}_hip"], at[f"{side}_knee"], 0.17 * unit, 0.13 * unit, body.trousers)
        _limb(picture, at[f"{side}_knee"], at[f"{side}_ankle"], 0.12 * unit, 0.075 * unit, body.trousers)
        shoe = at[f"{side}_ankle"] + [(-0.07 if side == "right" else 0.07) * unit, 0.06 * unit]
        _limb(picture, at[f"{side}_ankle"] + [0, 0.05 * unit], shoe, 0.08 * unit, 0.07 * unit, (35, 35, 40))
    _torso(picture, at, unit, body.shirt)
    _limb(picture, at["neck"], at["neck"] - [0, 0.16 * unit], 0.1 * unit, 0.09 * unit, body.skin)
    _head(picture, at, unit * body.head / 0.25, body)
    for side in ("right", "left"):
        shoulder, elbow, wrist = (at[f"{side}_{part}"] for part in ("shoulder", "elbow", "wrist"))
        _limb(picture, shoulder, elbow, 0.115 * unit, 0.085 * unit, body.shirt)
        _limb(picture, elbow, wrist, 0.08 * unit, 0.055 * unit, body.skin)
        along = (wrist - elbow) / max(float(np.linalg.norm(wrist - elbow)), 1.0)
        _limb(picture, wrist, wrist + along * 0.13 * unit, 0.06 * unit, 0.055 * unit, body.skin)
    small: np.ndarray = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return small


def backdrop_of(body: Body, size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8: a wall with a gradient and a few pictures on it, and a floor."""
    import cv2

    width, height = size
    edge = int(height * rng.uniform(0.72, 0.8))
    rows = np.linspace(1.08, 0.88, height)[:, None, None] * np.linspace(0.94, 1.06, width)[None, :, None]
    wall = np.clip(rows * np.array(body.wall), 0, 255)
    wall[edge:] = np.clip(rows[edge:] * np.array(body.floor), 0, 255)
    picture = wall.astype(np.uint8)
    for _ in range(rng.integers(1, 4)):
        x, y = int(rng.uniform(-0.1, 0.9) * width), int(rng.uniform(0, 0.5) * height)
        w, h = int(rng.uniform(0.1, 0.3) * width), int(rng.uniform(0.1, 0.35) * height)
        shade = tuple(int(v) for v in rng.integers(60, 230, 3))
        cv2.rectangle(picture, (x, y), (x + w, y + h), shade, -1)
        cv2.rectangle(picture, (x, y), (x + w, y + h), (50, 60, 70), 2)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 1.2))


def _limb(
    picture: np.ndarray, a: np.ndarray, b: np.ndarray, wide: float, narrow: float, colour: Colour
) -> None:
    """A tapered, rounded limb: dark rim, body, a lighter streak towards the light at the upper left."""
    for shrink, tone, shift in ((1.0, 0.62, 0.0), (0.86, 1.0, 0.0), (0.4, 1.16, -0.22)):
        offset = np.array([shift, shift]) * narrow
        _taper(picture, a + offset, b + offset, wide * shrink, narrow * shrink, _tone(colour, tone))


def _taper(
    picture: np.ndarray, a: np.ndarray, b: np.ndarray, wide: float, narrow: float, fill: Colour
) -> None:
    import cv2

    length = float(np.linalg.norm(b - a))
    across = np.array([a[1] - b[1], b[0] - a[0]]) / length if length > 1e-6 else np.zeros(2)
    corners = np.array([a + across * wide, b + across * narrow, b - across * narrow, a - across * wide])
    cv2.fillConvexPoly(picture, np.round(corners).astype(np.int32), fill, cv2.LINE_AA)
    for centre, radius in ((a, wide), (b, narrow)):
        cv2.circle(picture, _pixel(centre), max(1, round(radius)), fill, -1, cv2.LINE_AA)


def _torso(picture: np.ndarray, at: dict[str, np.ndarray], unit: float, colour: Colour) -> None:
    import cv2

    pad = np.array([0.09 * unit, 0.0])
    for shrink, tone in ((1.0, 0.62), (0.93, 1.0)):
        outline = np.array(
            [
                at["neck"] + [-0.12 * unit, -0.02 * unit],
                at["right_shoulder"] - pad * 0.6,
                at["right_hip"] - pad,
                at["right_hip"] + [0, 0.1 * unit],
                at["left_hip"] + [0, 0.1 * unit],
                at["left_hip"] + pad,
                at["left_shoulder"] + pad * 0.6,
                at["neck"] + [0.12 * unit, -0.02 * unit],
            ]
        )
        centre = outline.mean(axis=0)
        corners = np.round(centre + (outline - centre) * shrink).astype(np.int32)
        cv2.fillPoly(picture, [corners], _tone(colour, tone), cv2.LINE_AA)


def _head(picture: np.ndarray, at: dict[str, np.ndarray], unit: float, body: Body) -> None:
    import cv2

    centre = at["nose"] + [0, -0.05 * unit]
    for side in ("right", "left"):
        cv2.circle(picture, _pixel(at[f"{side}_ear"]), round(0.05 * unit), _tone(body.skin, 0.8), -1)
    axes = (round(0.195 * unit), round(0.26 * unit))
    hair = (round(0.215 * unit), round(0.25 * unit))
    cv2.ellipse(picture, _pixel(centre - [0, 0.07 * unit]), hair, 0, 0, 360, body.hair, -1, cv2.LINE_AA)
    cv2.ellipse(picture, _pixel(centre), axes, 0, 0, 360, _tone(body.skin, 0.75), -1, cv2.LINE_AA)
    face = (round(axes[0] * 0.93), round(axes[1] * 0.95))
    cv2.ellipse(picture, _pixel(centre), face, 0, 0, 360, body.skin, -1, cv2.LINE_AA)
    cv2.ellipse(picture, _pixel(centre - [0, 0.16 * unit]), hair, 0, 190, 350, body.hair, -1, cv2.LINE_AA)
    for side in ("right", "left"):
        eye = _pixel(at[f"{side}_eye"])
        cv2.ellipse(picture, eye, (round(0.042 * unit), round(0.024 * unit)), 0, 0, 360, (240, 240, 240), -1)
        cv2.circle(picture, eye, max(1, round(0.02 * unit)), (35, 30, 30), -1)
        brow = at[f"{side}_eye"] - [0, 0.055 * unit]
        cv2.ellipse(
            picture, _pixel(brow), (round(0.05 * unit), round(0.012 * unit)), 0, 0, 360, body.hair, -1
        )
    tip = at["nose"] + [0, 0.01 * unit]
    bridge = at["nose"] - [0.01 * unit, 0.07 * unit]
    cv2.line(picture, _pixel(bridge), _pixel(tip), _tone(body.skin, 0.72), max(1, round(0.022 * unit)))
    mouth = _pixel(at["nose"] + [0, 0.105 * unit])
    cv2.ellipse(picture, mouth, (round(0.06 * unit), round(0.018 * unit)), 0, 0, 360, (70, 70, 150), -1)


def _tone(colour: Colour, factor: float) -> Colour:
    b, g, r = (min(255, int(channel * factor)) for channel in colour)
    return b, g, r


def _pixel(point: np.ndarray) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
