"""Skirts: a tube of cloth around the hips of a posed body, which hides hips, thighs and knees."""

from __future__ import annotations

import numpy as np

RINGS, AROUND = 12, 40


def skirt(
    rng: np.random.Generator, posed: np.ndarray, inside: np.ndarray, belt: float, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    """A skirt that hangs from ``belt`` over the legs of a body that stands.

    Each ring is the support function of the vertices near its height, never narrower than the ring
    above, and wider by the flare of the skirt: cloth hangs from the widest place above it.

    Parameters
    ----------
    posed : (V, 3) metres, z up
    inside : (V,) bool
        Vertices of trunk and legs, that the skirt goes around.
    belt, floor : heights of belt and hem, metres

    Returns
    -------
    vertices : (RINGS * AROUND, 3)
    faces : (F, 3) int32, both sides
    """
    body = posed[inside]
    angles = np.arange(AROUND) * 2 * np.pi / AROUND
    ways = np.stack([np.cos(angles), np.sin(angles)])
    heights = np.linspace(belt, floor, RINGS)
    at_belt = body[np.abs(body[:, 2] - belt) < 0.04]
    middle = at_belt[:, :2].mean(axis=0) if len(at_belt) else body[:, :2].mean(axis=0)
    flare, loose = abs(rng.normal(0, 0.22)), rng.uniform(0.003, 0.02)
    folds, phase = int(rng.integers(0, 12)), rng.uniform(0, 6.28)
    radius = np.zeros(AROUND)
    out = []
    for height in heights:
        near = body[np.abs(body[:, 2] - height) < 0.05]
        if len(near):
            radius = np.maximum(radius, ((near[:, :2] - middle) @ ways).max(axis=0))
        below = belt - height
        wave = 1 + min(1.0, below * 3) * 0.05 * flare / 0.2 * np.sin(folds * angles + phase)
        wide = (radius + loose + flare * below * 0.6) * wave
        ring = np.column_stack([middle + (ways * wide).T, np.full(AROUND, height)])
        out.append(ring)
    index = np.arange(RINGS * AROUND).reshape(RINGS, AROUND)
    a, b = index[:-1], np.roll(index, -1, axis=1)[:-1]
    c, d = index[1:], np.roll(index, -1, axis=1)[1:]
    one = np.stack([a, c, b], axis=-1).reshape(-1, 3)
    two = np.stack([b, c, d], axis=-1).reshape(-1, 3)
    return np.concatenate(out), np.concatenate([one, two]).astype(np.int32)
