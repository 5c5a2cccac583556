"""Backgrounds: what stood beside the people in the real pictures, and patterns of our own."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from .cutout import PERSON, SCENE
from .label import PICTURES, frames, sources
from .store import Store

SIDE = 256


def patches(shared: Path, limit: int = 400) -> list[np.ndarray]:
    """Corners of the still pictures, where there are seldom people: patterns for cloth."""
    out = []
    for source in sources(shared / "data" / "people_permissive"):
        if source.file.suffix.lower() not in PICTURES or len(out) >= limit:
            continue
        for picture in frames(source.file, 1):
            height, width = picture.shape[0] // 4, picture.shape[1] // 4
            for corner in (picture[:height, :width], picture[-height:, -width:]):
                out.append(cv2.resize(corner, (96, 96), interpolation=cv2.INTER_AREA))
    return out


def harvest(store: Store, limit: int = 600) -> np.ndarray:
    """(K, 256, 256, 3) uint8: the columns to the left and right of the people in a store."""
    out: list[np.ndarray] = []
    for index in np.linspace(0, len(store) - 1, min(limit, len(store))).astype(int):
        picture, mask = store.pictures[index, ..., :3], store.pictures[index, ..., 3]
        columns = np.flatnonzero((mask == PERSON).any(axis=0))
        if not len(columns):
            continue
        for low, high in ((0, columns[0] - 3), (columns[-1] + 3, mask.shape[1])):
            scene = mask[:, max(low, 0) : max(high, 0)] == SCENE
            if scene.size == 0:
                continue
            rows = np.flatnonzero(scene.mean(axis=1) > 0.3)
            spots = np.flatnonzero(scene.any(axis=0))
            if len(rows) < 60 or len(spots) < 50:
                continue
            part = picture[rows[0] : rows[-1] + 1, low + spots[0] : low + spots[-1] + 1]
            out.append(cv2.resize(part, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR))
    return np.stack(out) if out else np.zeros((0, SIDE, SIDE, 3), np.uint8)


def invent(rng: np.random.Generator, size: int) -> np.ndarray:
    """A background without a photograph: a wall with light on it, and things that stand about."""
    corners = rng.uniform(0, 255, (2, 2, 3)) * 0.4 + rng.uniform(0, 255, 3) * 0.6
    scene = cv2.resize(corners.astype(np.float32), (size, size), interpolation=cv2.INTER_LINEAR)
    if rng.random() < 0.5:
        cells = int(rng.integers(2, 40))
        noise = rng.normal(0, rng.uniform(3, 45), (cells, cells, 1 if rng.random() < 0.5 else 3))
        scene += cv2.resize(noise.astype(np.float32), (size, size)).reshape(size, size, -1)
    if rng.random() < 0.2:  # blinds, shelves, tiles: a part of the wall in stripes
        rows = np.sin(np.arange(size) * rng.uniform(0.3, 2.2) * 192 / size) > rng.uniform(-0.6, 0.6)
        a, b = np.sort(rng.integers(0, size + 1, 2))
        stripes = np.where(rows[:, None], rng.uniform(0, 255, 3), rng.uniform(0, 255, 3))
        if rng.random() < 0.7:
            scene[:, a:b] = 0.3 * scene[:, a:b] + 0.7 * stripes[:, None]
        else:
            scene[a:b] = 0.3 * scene[a:b] + 0.7 * stripes[None]
    for _ in range(int(rng.integers(0, 14))):
        colour = [float(v) for v in rng.uniform(0, 255, 3)]
        a, b = (tuple(int(v) for v in rng.uniform(-0.2, 1.2, 2) * size) for _ in range(2))
        kind = rng.random()
        if kind < 0.5:
            cv2.rectangle(scene, a, b, colour, -1 if rng.random() < 0.7 else int(rng.integers(1, 8)))
        elif kind < 0.75:
            cv2.line(scene, a, b, colour, int(rng.integers(1, 20)))
        else:
            axes = tuple(int(v) for v in rng.uniform(0.02, 0.3, 2) * size)
            cv2.ellipse(scene, a, axes, float(rng.uniform(0, 180)), 0, 360, colour, -1)
    return np.clip(scene, 0, 255).astype(np.uint8)
