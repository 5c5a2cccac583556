"""Angles and quaternions that jump though nothing does: past a whole turn, or from q to -q.

Both write one orientation in several ways, and a warping would see a movement. What is changed stays the same
orientation.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

_CHANNEL = re.compile(r"(?:(?P<group>[^/\[]*)/)?(?P<name>[^\[]*)(?:\[(?P<unit>.*)\])?.*", re.DOTALL)
_STREAM = re.compile(r"@[^@]*$")
_ANGLE = re.compile(r"(?:.*[^a-z])?(?:yaw|pitch|roll|heading|azimuth|bearing|course|euler\w*|angle)", re.I)
_YAW = re.compile(r".*(?:Yaw|Pitch|Roll|Heading|Azimuth)")
_TURNS = {"deg": 360.0, "degree": 360.0, "degrees": 360.0, "°": 360.0, "rad": 2 * np.pi, "radians": 2 * np.pi}
_PAST = 0.75
"""Of a turn that nobody says the unit of: readings before and after the jump are as far apart."""
_ALIKE = 0.05
"""How far the length of a quaternion may be from 1."""
_SCALARS = ("w", "0")


def without_jumps(values: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """The (T, D) ``values``, NaN where missing, with angles and quaternions that go on where they jump.

    A channel is an angle by its unit or its name, and is taken past a whole turn where it jumps by more than
    half of one and never leaves one. Four channels of a group are a quaternion by their names (w, x, y, z or
    numbers) and their length of 1; its sign is the nearer one at each sample, and that of a scalar part above
    zero on the whole.
    """
    out = values.copy()
    parts = [_CHANNEL.fullmatch(name).groupdict() for name in channels]  # type: ignore[union-attr]
    groups: dict[str, dict[str, int]] = {}
    for place, part in enumerate(parts):
        groups.setdefault(part["group"] or "", {})[part["name"]] = place
        turn = _turn(part, values[:, place])
        if turn:
            out[:, place] = _unwrapped(values[:, place], turn)
    for members in groups.values():
        if {*members} in ({*"wxyz"}, {*"0123"}, {*"1234"}):
            ordered = sorted(members, key=lambda name: (name not in _SCALARS, name))
            places = [members[name] for name in ordered]
            out[:, places] = _one_sign(values[:, places])
    return out


def _turn(part: dict[str, str | None], values: np.ndarray) -> float:
    """A whole turn in the unit of an angle, 0 of what is none."""
    turn = _TURNS.get((part["unit"] or "").casefold(), 0.0)
    names = [_STREAM.sub("", name) for name in (part["name"], part["group"]) if name]
    if not turn and not part["unit"] and any(_ANGLE.fullmatch(n) or _YAW.fullmatch(n) for n in names):
        seen = values[np.isfinite(values)]
        far = float(np.ptp(seen)) if len(seen) else 0.0
        turn = 360.0 if far > _TURNS["rad"] * 1.01 else _TURNS["rad"]
        return turn if far > _PAST * turn else 0.0  # a few degrees are no turn in radians
    return turn


def _unwrapped(values: np.ndarray, turn: float) -> np.ndarray:
    there = np.isfinite(values)
    if not there.any() or np.ptp(values[there]) > 1.01 * turn:
        return values
    out = values.copy()
    out[there] = np.unwrap(values[there], period=turn)
    return out


def _one_sign(values: np.ndarray) -> np.ndarray:
    """(T, 4) quaternions, the scalar first, without a change of sign."""
    there = np.isfinite(values).all(axis=1)
    seen = values[there]
    if not len(seen) or np.median(np.abs(np.linalg.norm(seen, axis=1) - 1)) > _ALIKE:
        return values
    flips = np.where((seen[1:] * seen[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    seen = seen * np.cumprod(np.concatenate([[1.0], flips]))[:, None]
    out = values.copy()
    out[there] = -seen if seen[:, 0].sum() < 0 else seen
    return out
