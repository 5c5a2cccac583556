"""Rendered people: a posed body, clothes, light and a camera, stored with opacity and exact joints."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from .body import Bodies, People
from .clothes import HAIR, SKIN, SKIRT, dress, paint, region_of_bone
from .joints import ABSENT, COUNT, FACE, HIPS, NAMES, NECK, PRESENT, SHOULDERS
from .raster import normals, rasterise
from .settings import Data
from .skirts import skirt
from .store import Store, Writer

CONVENTION = {
    "right_hip": (-0.022, -0.066),
    "left_hip": (0.022, -0.066),
    "right_knee": (0.0, -0.046),
    "left_knee": (0.0, -0.046),
    "right_eye": (0.0, -0.018),
    "left_eye": (0.0, -0.018),
}
"""Where annotators of COCO put a joint, from where the body model has it: to the person's left and
down, in trunk lengths; the medians of what hpe0001 said of 110 rendered people."""

SKIRTS = 0.25  # of the people who stand
SUPERSAMPLE = 1  # training shrinks the pictures anyway


def camera(
    rng: np.random.Generator, points: np.ndarray, joints: np.ndarray, size: int, upper: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Project points and joints to a square that the person (or the upper body) fills.

    Returns
    -------
    places : (V, 2) pixels, depth : (V,) metres, spots : (18, 2) pixels, spot_depth : (18,)
    """
    distance = rng.uniform(1.0, 2.0) if upper else rng.uniform(2.0, 6.0)
    tilt, roll = np.deg2rad(rng.normal(4, 8)), np.deg2rad(rng.normal(0, 3))
    look = np.array([0.0, 0.0, rng.uniform(0.1, 0.45)])

    def view(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        p = p - look
        right, back, up = p[:, 0], p[:, 1], p[:, 2]
        up, back = up * np.cos(tilt) + back * np.sin(tilt), back * np.cos(tilt) - up * np.sin(tilt)
        right, up = right * np.cos(roll) - up * np.sin(roll), right * np.sin(roll) + up * np.cos(roll)
        deep = np.maximum(back + distance, 0.2)
        return np.stack([right, -up], axis=1) / deep[:, None], deep

    flat, deep = view(points)
    spots, spot_deep = view(joints)
    if upper:
        cut = float(rng.uniform(-0.25, 0.1))  # where the picture ends, from the hips, metres
        visible = points[:, 2] > cut
    else:
        visible = np.ones(len(points), bool)
    low, high = flat[visible].min(axis=0), flat[visible].max(axis=0)
    scale = 0.94 * size / float((high - low).max())
    middle = (low + high) / 2
    if upper:  # the cut is the bottom of the picture
        middle[1] = high[1] - 0.5 * size / scale
    return (flat - middle) * scale + size / 2, deep, (spots - middle) * scale + size / 2, spot_deep


def as_annotated(spots: np.ndarray) -> np.ndarray:
    """(18, 2) joints of the body model, moved to where people mark them in pictures."""
    down = spots[list(HIPS)].mean(axis=0) - spots[NECK]
    left = np.array([down[1], -down[0]])
    if spots[SHOULDERS[0], 0] > spots[SHOULDERS[1], 0]:  # seen from behind
        left = -left
    out = spots.copy()
    for name, (aside, below) in CONVENTION.items():
        out[NAMES.index(name)] += aside * left + below * down
    return out


def draw(
    rng: np.random.Generator, bodies: Bodies, people: People, index: int, size: int, patches: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, bool]:
    """One person: picture (S, S, 3), opacity (S, S), joints (18, 2), known (18,), whether it is cut."""
    upper = bool(rng.random() < 0.5)
    rest, faces = people.rest[index], bodies.faces
    skirted = people.standing[index] and bool(rng.random() < SKIRTS)
    material, offset = dress(rng, rest, bodies.owner, bodies.bones, skirted)
    normal = normals(people.vertices[index], faces)
    vertices = people.vertices[index] + normal * offset[:, None]
    if skirted:
        cloth, more = _skirt(rng, bodies, vertices, people.joints[index])
        faces = np.concatenate([faces, more + len(vertices)])
        vertices, rest = np.concatenate([vertices, cloth]), np.concatenate([rest, cloth])
        material = np.concatenate([material, np.full(len(cloth), SKIRT)])
        normal = np.concatenate([normal, normals(cloth, more)])
    fine = size * SUPERSAMPLE
    places, deep, spots, spot_deep = camera(rng, vertices, people.joints[index], fine, upper)
    face, weights, nearest = rasterise(places.astype(np.float32), deep.astype(np.float32), faces, fine, fine)
    hit = face >= 0
    corners = faces[face[hit]]
    w = np.column_stack([weights[hit], 1 - weights[hit].sum(axis=1)])[..., None]
    surface = (rest[corners] * w).sum(axis=1)
    turned = (normal[corners] * w).sum(axis=1)
    strongest = corners[np.arange(len(corners)), w[..., 0].argmax(axis=1)]
    colour = paint(rng, material[strongest], surface, patches)
    cloth = (material[strongest] != SKIN) & (material[strongest] != HAIR)
    colour = colour * _light(rng, turned, surface, cloth)[:, None]
    picture = np.zeros((fine, fine, 3), np.float32)
    picture[hit] = colour
    opacity = hit.astype(np.float32) * 255
    if rng.random() < 0.3:
        _long_hair(rng, picture, opacity, spots, colour[material[strongest] == HAIR])
    picture = cv2.resize(picture, (size, size), interpolation=cv2.INTER_AREA)
    opacity = cv2.resize(opacity, (size, size), interpolation=cv2.INTER_AREA)
    picture /= np.maximum(opacity / 255, 1 / 255)[..., None]
    known = np.full(COUNT, PRESENT, np.int8)
    for joint in FACE:  # the far ear is not to be seen, and COCO does not mark it
        x, y = np.round(spots[joint]).astype(int)
        if 0 <= x < fine and 0 <= y < fine and spot_deep[joint] > nearest[y, x] + 0.04:
            known[joint] = ABSENT
    return (
        np.clip(picture, 0, 255).astype(np.uint8),
        opacity.astype(np.uint8),
        (as_annotated(spots) + 0.5) / SUPERSAMPLE - 0.5,
        known,
        upper,
    )


def _skirt(
    rng: np.random.Generator, bodies: Bodies, vertices: np.ndarray, joints: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A skirt for a posed body: from the waist to between the upper thigh and the shins."""
    parts = np.array([region_of_bone(b) for b in bodies.bones])[bodies.owner]
    hips, knees, ankles, neck = (float(joints[list(j), 2].mean()) for j in (HIPS, (9, 12), (10, 13), (NECK,)))
    belt = hips + (neck - hips) * rng.uniform(0.05, 0.45)
    hem = rng.choice([rng.uniform(0.35, 1.0), rng.uniform(0.7, 1.25), rng.uniform(1.2, 1.9)])
    floor = hips + (knees - hips) * min(hem, 1.0) + (ankles - knees) * max(0.0, hem - 1.0)
    around = np.isin(parts, ("trunk", "thigh", "shin"))
    return skirt(rng, vertices, around, belt, floor)


def _light(
    rng: np.random.Generator, normal: np.ndarray, surface: np.ndarray, cloth: np.ndarray
) -> np.ndarray:
    """Brightness of surface points: ambient, one lamp, and folds in the cloth."""
    lamp = rng.normal(0, 1, 3) + np.array([0, -0.8, 0.8])
    lamp /= np.linalg.norm(lamp)
    folds = np.zeros(len(normal))
    for _ in range(3):
        wave = rng.normal(0, 1, 3) * rng.uniform(15, 70)
        folds += np.sin(surface @ wave + rng.uniform(0, 6))
    shade = np.clip(normal @ lamp, 0, 1) * rng.uniform(0.2, 0.7) + rng.uniform(0.45, 0.8)
    facing = np.clip(-normal[:, 1], 0, 1) * 0.15
    return (shade + facing) * (1 + cloth * folds * rng.uniform(0.0, 0.08)) * rng.uniform(0.85, 1.1)


def _long_hair(
    rng: np.random.Generator, picture: np.ndarray, opacity: np.ndarray, spots: np.ndarray, hair: np.ndarray
) -> None:
    """A soft shape of hair behind head and shoulders."""
    if not len(hair):
        return
    size = float(np.linalg.norm(spots[2] - spots[5])) * 0.5
    center = (spots[0] + (0, size * rng.uniform(0.0, 0.9))).astype(int)
    axes = (int(max(3, size * rng.uniform(0.5, 0.8))), int(max(3, size * rng.uniform(0.7, 1.5))))
    blob = np.zeros(opacity.shape, np.uint8)
    cv2.ellipse(blob, (int(center[0]), int(center[1])), axes, 0, 0, 360, 255, -1)
    behind = (blob > 0) & (opacity == 0)
    picture[behind] = np.median(hair, axis=0) * rng.uniform(0.7, 1.1)
    opacity[behind] = 255


def render(target: Path, data: Data, seed: int, patches: list[np.ndarray], progress: object = None) -> Store:
    """Write the store of rendered people; batches of 16, each with a seed of its own."""
    writer = Writer(target, data.stored, capacity=data.synthetic)
    bodies: Bodies | None = None
    batches = range((data.synthetic + 15) // 16)
    for batch in batches if progress is None else progress(batches, "render"):  # type: ignore[operator]
        key = str(batch)
        if writer.done(key):
            continue
        bodies = bodies or Bodies()
        rng = np.random.default_rng([seed, batch])
        people = bodies.sample(rng, 16)
        for index in range(16):
            picture, opacity, spots, known, cut = draw(rng, bodies, people, index, data.stored, patches)
            bottom = float(data.stored) if cut else float(2 * data.stored)
            writer.add(picture, opacity, spots, known, "upper" if cut else "full", bottom)
        writer.mark(key)
    return writer.close()
