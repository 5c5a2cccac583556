"""What the drawn people do: arm angles over time.

An arm is two angles in degrees, upper arm and forearm: 0 hangs down, 90 points away from the body,
180 points up, negative angles cross the body.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

REST = (8.0, 4.0)


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


Angles = np.ndarray
"""(T, 2) degrees: upper arm, forearm."""


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
