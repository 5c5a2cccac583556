"""Who performs, and what: a body of random proportions, its motions, and its joints in each frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gesture_core.skeletons import COCO18

Colour = tuple[int, int, int]
_SKIN = ((150, 185, 225), (110, 150, 200), (85, 120, 170), (60, 85, 130), (45, 60, 95))
_HAIR = ((30, 35, 45), (25, 45, 80), (60, 110, 150), (40, 40, 40), (140, 140, 145))
REST = (8.0, 4.0)
Angles = np.ndarray
"""(T, 2) degrees: upper arm, forearm."""


@dataclass(frozen=True)
class Body:
    """A performer; lengths in pixels, colours in BGR.

    Attributes
    ----------
    neck : (x, y)
        Where the neck is in the picture.
    torso : float
        Neck to hips, the unit of all other lengths.
    shoulders, hips, arm, leg, head : float
        Half widths and lengths as multiples of ``torso``.
    sway : float
        Amplitude of the body's own slow motion, as a multiple of ``torso``.
    skin, hair, shirt, trousers, wall, floor : colour
    """

    neck: tuple[float, float]
    torso: float
    shoulders: float
    hips: float
    arm: float
    leg: float
    head: float
    sway: float
    skin: Colour
    hair: Colour
    shirt: Colour
    trousers: Colour
    wall: Colour
    floor: Colour


def random_body(rng: np.random.Generator, size: tuple[int, int]) -> Body:
    """A performer for a picture of ``size`` (width, height)."""
    width, height = size
    torso = height * rng.uniform(0.22, 0.25)

    def colour(low: int, high: int) -> Colour:
        b, g, r = (int(v) for v in rng.integers(low, high, 3))
        return b, g, r

    return Body(
        (width * rng.uniform(0.44, 0.56), height * rng.uniform(0.31, 0.34)),
        torso,
        rng.uniform(0.34, 0.40),
        rng.uniform(0.19, 0.23),
        rng.uniform(0.52, 0.60),
        rng.uniform(0.74, 0.84),
        rng.uniform(0.23, 0.27),
        rng.uniform(0.005, 0.02),
        _SKIN[rng.integers(len(_SKIN))],
        _HAIR[rng.integers(len(_HAIR))],
        colour(40, 220),
        colour(20, 120),
        _pale(rng),
        colour(60, 150),
    )


def _pale(rng: np.random.Generator) -> Colour:
    """A light colour of low saturation, as walls have."""
    b, g, r = (int(v) for v in rng.uniform(130, 225) + rng.uniform(-22, 22, 3))
    return b, g, r


def joints(body: Body, right: Angles, left: Angles, rng: np.random.Generator) -> np.ndarray:
    """Where the joints are.

    Parameters
    ----------
    body : Body
    right, left : (T, 2) arrays
        Angles of the arms in degrees.
    rng : Generator
        For the sway.

    Returns
    -------
    (T, 18, 2) float32
        COCO-18 in pixels. The performer faces the camera, so their right is on the left.
    """
    frames = len(right)
    t = np.linspace(0, 2 * np.pi * rng.uniform(0.5, 1.0), frames) + rng.uniform(0, 6)
    sway = np.stack([np.sin(t), 0.4 * np.cos(1.7 * t)], axis=1) * body.sway * body.torso
    at = {"neck": np.array(body.neck) + sway}
    drop = 0.06 * body.torso
    at["nose"] = at["neck"] + [0, -0.42 * body.torso] + 0.3 * sway
    for side, sign, arm in (("right", -1.0, right), ("left", 1.0, left)):
        at[f"{side}_shoulder"] = at["neck"] + [sign * body.shoulders * body.torso, drop]
        reach = body.arm * body.torso
        at[f"{side}_elbow"] = at[f"{side}_shoulder"] + reach * _direction(arm[:, 0], sign)
        at[f"{side}_wrist"] = at[f"{side}_elbow"] + 0.92 * reach * _direction(arm[:, 1], sign)
        at[f"{side}_hip"] = at["neck"] + [sign * body.hips * body.torso, body.torso] - 0.5 * sway
        foot = at["neck"] - sway + [sign * (body.hips + 0.03) * body.torso, body.torso]
        at[f"{side}_knee"] = foot + [0, body.leg * body.torso] + 0.2 * sway
        at[f"{side}_ankle"] = foot + np.array([0, 1.9 * body.leg * body.torso])
        at[f"{side}_eye"] = at["nose"] + [sign * 0.085 * body.torso, -0.07 * body.torso]
        at[f"{side}_ear"] = at["nose"] + [sign * 0.19 * body.torso, -0.02 * body.torso]
    return np.stack([at[name] for name in COCO18.joints], axis=1).astype(np.float32)


def _direction(degrees: np.ndarray, sign: float) -> np.ndarray:
    angle = np.deg2rad(degrees)
    return np.stack([sign * np.sin(angle), np.cos(angle)], axis=1)


@dataclass(frozen=True)
class Style:
    """How one performer performs.

    Attributes
    ----------
    frames : int
        Length of the clip.
    amplitude : float
        Of the motion, 1 is normal.
    phase : float
        Radians by which repeated motions start late.
    cycles : float
        Repetitions.
    """

    frames: int
    amplitude: float = 1.0
    phase: float = 0.0
    cycles: float = 2.5


def _arm(upper: np.ndarray | float, fore: np.ndarray | float, envelope: np.ndarray) -> Angles:
    """An arm that leaves its rest, reaches the angles given, and returns."""
    rest = np.broadcast_to(REST, (len(envelope), 2))
    goal = np.stack(np.broadcast_arrays(upper, fore, envelope)[:2], axis=1)
    return np.asarray(rest + (goal - rest) * envelope[:, None])


def _envelope(frames: int, rise: float = 0.2) -> np.ndarray:
    """0 at both ends, 1 between, with smooth shoulders of ``rise`` of the length."""
    u = np.linspace(0, 1, frames)
    edge = np.clip(np.minimum(u, 1 - u) / rise, 0, 1)
    return edge * edge * (3 - 2 * edge)


def _swing(style: Style) -> np.ndarray:
    return np.sin(2 * np.pi * style.cycles * np.linspace(0, 1, style.frames) + style.phase)


def wave(style: Style) -> tuple[Angles, Angles]:
    """The right hand waves beside the head."""
    e = _envelope(style.frames)
    return _arm(95, 175 + 38 * style.amplitude * _swing(style), e), _arm(*REST, e)


def circle(style: Style) -> tuple[Angles, Angles]:
    """The stretched right arm goes round once, outwards."""
    turn = 360 * _ramp(style.frames)
    return np.stack([turn + REST[0], turn + REST[1]], axis=1), _arm(*REST, _envelope(style.frames))


def swipe(style: Style) -> tuple[Angles, Angles]:
    """The right hand wipes from the side across the body."""
    e = _envelope(style.frames, 0.3)
    across = _ramp(style.frames)
    upper = 75 - 60 * across * style.amplitude
    return _arm(upper, 100 - 200 * across * style.amplitude, e), _arm(*REST, e)


def raise_arms(style: Style) -> tuple[Angles, Angles]:
    """Both arms go up at the sides and down again."""
    e = _envelope(style.frames, 0.5)
    top = 120 + 45 * style.amplitude
    return _arm(top, top + 6, e), _arm(top, top + 6, e)


def clap(style: Style) -> tuple[Angles, Angles]:
    """Both hands meet in front of the chest, several times."""
    e = _envelope(style.frames)
    swing = style.amplitude * _swing(style)
    upper, fore = 40 + 22 * swing, -45 + 60 * swing
    return _arm(upper, fore, e), _arm(upper, fore, e)


def flap(style: Style) -> tuple[Angles, Angles]:
    """Both stretched arms beat like wings."""
    e = _envelope(style.frames)
    beat = 70 + 32 * style.amplitude * _swing(style)
    return _arm(beat, beat - 6, e), _arm(beat, beat - 6, e)


def _ramp(frames: int) -> np.ndarray:
    u = np.clip((np.linspace(0, 1, frames) - 0.1) / 0.8, 0, 1)
    return u * u * (3 - 2 * u)


GESTURES: dict[str, Callable[[Style], tuple[Angles, Angles]]] = {
    "circle": circle,
    "clap": clap,
    "flap": flap,
    "raise-arms": raise_arms,
    "swipe": swipe,
    "wave": wave,
}
"""Each gives the right and the left arm's angles, (T, 2) each."""
