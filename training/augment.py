"""One stored person to one training picture: placed, cut, dressed, lit and spoiled anew every time."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .cutout import OUTSIDE, PERSON
from .joints import ABSENT, ELBOWS, FACE, HIPS, IGNORED, MIRROR, NECK, PRESENT, SHOULDERS, WRISTS, body_scale
from .legs import stand
from .scenes import invent
from .swing import swing

SWUNG = 0.45
"""Share of the real pictures in which an arm is moved, where the person is cut out well."""

UPPER = tuple(range(8)) + FACE  # without hips and legs


@dataclass(frozen=True)
class Sample:
    """A stored person: picture (S, S, 3), mask (S, S), joints (18, 3), row of the cut, and its kind."""

    picture: np.ndarray
    mask: np.ndarray
    joints: np.ndarray
    bottom: float
    rendered: bool


def bars(rng: np.random.Generator, size: int) -> tuple[int, int]:
    """Width of the grey bars left and right, and above and below, that a frame leaves in a square input."""
    kind = rng.random()
    wide = int(rng.choice([0.125, 0.219, rng.uniform(0.0, 0.25)]) * size)
    return (0, wide) if kind < 0.35 else (wide, 0) if kind < 0.45 else (0, 0)


def place(
    rng: np.random.Generator, sample: Sample, size: int, edge: tuple[int, int] = (0, 0)
) -> tuple[np.ndarray, bool]:
    """Random affine matrix (2, 3) from stored pixels to the training picture, and whether to mirror.

    The person fills 0.3 to 1.6 of the picture. Half of the pictures look at the upper body alone: close
    to the camera is where a network trained on whole bodies fails. A body that is cut is cut where the
    bar below begins; ``edge`` holds the widths of the `bars`.
    """
    points, seen = sample.joints[:, :2].astype(np.float64), sample.joints[:, 2] == PRESENT
    inside = seen & (points > 0).all(axis=1) & (points < sample.picture.shape[0]).all(axis=1)
    typical = 0.8
    if rng.random() < 0.5 and inside[list(UPPER)].sum() >= 4:
        typical = 0.6  # room for arms that stretch
        keep = list(UPPER) + (list(HIPS) if rng.random() < 0.6 else [])
        inside = inside & np.isin(np.arange(len(inside)), keep)
    if inside.sum() < 2:
        inside = seen
    low, high = points[inside].min(axis=0), points[inside].max(axis=0)
    side = max(float((high - low).max()), 1.2 * body_scale(points, seen), 8.0)
    fill = float(np.clip(rng.lognormal(np.log(typical), 0.28), 0.3, 1.6))
    scale = fill * (size - 1.4 * max(edge)) / side
    angle = np.deg2rad(np.clip(rng.normal(0, 9), -28, 28))
    stretch = np.exp(rng.normal(0, 0.05))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = scale * turn @ np.diag([stretch, 1 / stretch])
    mirror = bool(rng.random() < 0.5)
    if mirror:
        linear = np.diag([-1.0, 1.0]) @ linear
    goal = size / 2 + rng.normal(0, 0.08 * size, 2)
    shift = goal - linear @ ((low + high) / 2)
    matrix = np.column_stack([linear, shift])
    floor = (matrix @ [(low[0] + high[0]) / 2, sample.bottom, 1])[1]
    below = edge[1]
    if floor < size - below:  # a body that is cut must be cut by the picture's border
        matrix[1, 2] += size - below - floor + 1
    return matrix, mirror


def background(rng: np.random.Generator, scenes: np.ndarray, size: int) -> np.ndarray:
    """(size, size, 3) uint8: part of a real scene, or an invented one."""
    if len(scenes) == 0 or rng.random() < 0.35:
        return invent(rng, size)
    scene = scenes[rng.integers(len(scenes))]
    side = int(rng.uniform(0.4, 1) * scene.shape[0])
    x, y = rng.integers(0, scene.shape[0] - side + 1, 2)
    part = cv2.resize(scene[y : y + side, x : x + side], (size, size), interpolation=cv2.INTER_LINEAR)
    if rng.random() < 0.5:
        part = part[:, ::-1]
    if rng.random() < 0.5:
        part = np.clip(part * rng.uniform(0.5, 1.4, 3) + rng.uniform(-30, 30), 0, 255).astype(np.uint8)
    return np.ascontiguousarray(part)


def redress(
    rng: np.random.Generator, picture: np.ndarray, person: np.ndarray, points: np.ndarray, seen: np.ndarray
) -> np.ndarray:
    """Give the clothes of a real person another colour; face and hands keep theirs."""
    scale = body_scale(points, seen)
    if scale <= 0:
        return picture
    cloth = person.copy()
    spots = [(points[list(FACE)][seen[list(FACE)]], 0.42)]
    for wrist, elbow in zip(WRISTS, (3, 6), strict=True):
        if seen[wrist]:
            hand = points[wrist] + (0.3 * (points[wrist] - points[elbow]) if seen[elbow] else 0)
            spots.append((np.stack([points[wrist], hand]), 0.2))
    for places, radius in spots:
        for spot in places:
            cv2.circle(cloth, (int(spot[0]), int(spot[1])), int(radius * scale) + 1, 0.0, -1)
    cloth = cv2.GaussianBlur(cloth, (0, 0), max(0.5, 0.03 * scale))[..., None]
    if rng.random() < 0.5:
        other = picture * rng.uniform(0.35, 1.8, 3) + rng.uniform(-30, 60)
    else:  # keep the folds, change the colour
        grey = picture.mean(axis=2, keepdims=True)
        other = grey / max(float(grey.mean()), 8.0) * rng.uniform(10, 220, 3)
    return picture + (other - picture) * cloth


def occlude(
    rng: np.random.Generator, picture: np.ndarray, scenes: np.ndarray, points: np.ndarray, known: np.ndarray
) -> None:
    """Put things in front of the person, in place; joints behind them are no longer known."""
    size = picture.shape[0]
    for _ in range(int(rng.integers(1, 3))):
        cover = np.zeros((size, size), np.uint8)
        if rng.random() < 0.3:  # a desk
            top = int(rng.uniform(0.65, 0.95) * size)
            cv2.rectangle(cover, (0, top), (size, size), 255, -1)
        elif rng.random() < 0.5:
            a = rng.uniform(0, size, 2)
            b = a + rng.uniform(0.05, 0.3, 2) * size
            cv2.rectangle(cover, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), 255, -1)
        else:
            axes = (int(rng.uniform(0.02, 0.15) * size), int(rng.uniform(0.02, 0.2) * size))
            spot = (int(rng.uniform(0, size)), int(rng.uniform(0, size)))
            cv2.ellipse(cover, spot, axes, float(rng.uniform(0, 180)), 0, 360, 255, -1)
        on = cover > 0
        picture[on] = background(rng, scenes, size)[on]
        x, y = np.clip(np.round(points).astype(int), 0, size - 1).T
        known[(known == PRESENT) & on[y, x]] = IGNORED


def line_kernel(length: int, angle: float) -> np.ndarray:
    """(length, length) float32 of sum one: a line through the middle."""
    kernel = np.zeros((length, length), np.float32)
    end = np.array([np.cos(angle), np.sin(angle)]) * length / 2
    middle = (length - 1) / 2
    a, b = (tuple(np.round(middle + s * end).astype(int).tolist()) for s in (-1, 1))
    cv2.line(kernel, a, b, 1.0, 1)
    return kernel / kernel.sum()


def spoil(rng: np.random.Generator, picture: np.ndarray) -> np.ndarray:
    """What cameras do: gain, gamma, colour, blur, few pixels, noise, JPEG."""
    out = picture.astype(np.float32)
    if rng.random() < 0.8:
        mean = out.mean()
        out = (out - mean) * rng.uniform(0.6, 1.4) + mean * rng.uniform(0.55, 1.4)
        out *= rng.uniform(0.85, 1.15, 3).astype(np.float32)
    if rng.random() < 0.08:
        out[:] = out.mean(axis=2, keepdims=True)
    size = out.shape[0]
    if rng.random() < 0.35:  # a person far away
        small = int(size * rng.uniform(0.3, 0.8))
        way = cv2.INTER_AREA if rng.random() < 0.7 else cv2.INTER_LINEAR
        out = cv2.resize(cv2.resize(out, (small, small), interpolation=way), (size, size))
    elif rng.random() < 0.3:
        out = cv2.GaussianBlur(out, (0, 0), rng.uniform(0.4, 1.8))
    elif rng.random() < 0.2:  # movement
        out = cv2.filter2D(out, -1, line_kernel(int(rng.integers(3, 10)), rng.uniform(0, np.pi)))
    if rng.random() < 0.4:
        noise = np.empty(out.shape, np.float32)
        cv2.setRNGSeed(int(rng.integers(1 << 30)))
        cv2.randn(noise, (0, 0, 0), (1, 1, 1))
        out = out + noise * rng.uniform(2, 14)
    out = np.clip(out, 0, 255).astype(np.uint8)
    if rng.random() < 0.35:
        quality = int(rng.uniform(18, 90))
        out = cv2.imdecode(cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 1)
    return out


def augment(
    rng: np.random.Generator,
    sample: Sample,
    size: int,
    scenes: np.ndarray,
    extra: Sample | None = None,
    legs: Sample | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """A training picture and its joints.

    Parameters
    ----------
    extra : Sample, optional
        A rendered person to stand in the background, unlabelled: the network must ignore the
        smaller of two people.
    legs : Sample, optional
        A rendered person whose legs a real upper body may stand on.

    Returns
    -------
    picture : (size, size, 3) uint8 BGR
    joints : (18, 3) float32, x, y in pixels and what is known
    """
    moved = False
    if not sample.rendered and (legs is not None or rng.random() < SWUNG) and _cut_well(sample):
        if rng.random() < (0.4 if legs is not None else 1.0):
            sample, moved = _with_other_arms(rng, sample)
        if legs is not None:
            sample, stands = _with_legs(rng, sample, legs)
            moved |= stands
    beside, below = bars(rng, size)
    matrix, mirror = place(rng, sample, size, (beside, below))
    points = sample.joints[:, :2].astype(np.float64) @ matrix[:, :2].T + matrix[:, 2]
    known = sample.joints[:, 2].astype(np.int8)
    if mirror:
        points, known = points[MIRROR], known[MIRROR]
    edge = np.array([beside, below])
    outside = ((points < edge) | (points > size - 1 - edge)).any(axis=1)
    known = np.where(outside & (known == PRESENT), ABSENT, known).astype(np.int8)
    picture = cv2.warpAffine(sample.picture, matrix, (size, size), flags=cv2.INTER_LINEAR)
    mask = cv2.warpAffine(
        sample.mask,
        matrix,
        (size, size),
        flags=cv2.INTER_LINEAR if sample.rendered else cv2.INTER_NEAREST,
    )
    out = picture.astype(np.float32)
    if sample.rendered:
        person = mask.astype(np.float32) / 255
        keep = person
    else:
        person = (mask == PERSON).astype(np.float32)
        if rng.random() < 0.5:
            out = redress(rng, out, person, points, known == PRESENT)
        swap = moved or (rng.random() < 0.45 and _whole(person, points, known))
        keep = cv2.GaussianBlur(person, (0, 0), 0.8) if swap else (mask != OUTSIDE).astype(np.float32)
    if keep.min() < 1:
        scene = background(rng, scenes, size)
        if extra is not None and (keep is person or rng.random() < 0.5):
            scene = _bystander(rng, scene, extra)
        if not sample.rendered and keep.mean() > 0.3 and rng.random() < 0.4:
            scene = np.full_like(scene, int(rng.integers(0, 256)))  # letterboxing
        if sample.rendered and rng.random() < 0.5:  # the light of the scene falls on the person
            out *= (scene.mean(axis=(0, 1)) / max(float(scene.mean()), 1.0)) ** rng.uniform(0, 1)
        out = scene + (out - scene) * keep[..., None]
    out = np.clip(out, 0, 255).astype(np.uint8)
    if rng.random() < 0.2:
        out = _blurred_hands(rng, out, points, known)
    if rng.random() < 0.22:
        occlude(rng, out, scenes, points, known)
    out = spoil(rng, out)
    grey = 128 if rng.random() < 0.6 else int(rng.integers(0, 256))
    out[:below] = out[size - below :] = out[:, :beside] = out[:, size - beside :] = grey
    return out, np.column_stack([points, known]).astype(np.float32)


def _cut_well(sample: Sample) -> bool:
    """Whether the person is cut out well enough for another scene."""
    seen = sample.joints[:, 2] == PRESENT
    inside = seen & ((sample.joints[:, :2] >= 0) & (sample.joints[:, :2] < len(sample.mask))).all(axis=1)
    known = np.where(inside, PRESENT, ABSENT)
    return _whole((sample.mask == PERSON).astype(np.float32), sample.joints[:, :2], known)


def _with_legs(rng: np.random.Generator, sample: Sample, legs: Sample) -> tuple[Sample, bool]:
    """The upper body on rendered legs, where the two fit."""
    other = (legs.picture, legs.mask, legs.joints)
    result = stand(rng, sample.picture, sample.mask, sample.joints, other)
    if result is None:
        return sample, False
    return Sample(*result, 2.0 * len(sample.mask), False), True


def _with_other_arms(rng: np.random.Generator, sample: Sample) -> tuple[Sample, bool]:
    """One arm or both swung elsewhere."""
    picture, mask, joints = sample.picture, sample.mask, sample.joints
    moved = False
    for side in rng.permutation(2)[: 1 if rng.random() < 0.6 else 2]:
        result = swing(rng, picture, mask, joints, int(side))
        if result is not None:
            (picture, mask, joints), moved = result, True
    return Sample(picture, mask, joints, sample.bottom, False), moved


def _blurred_hands(
    rng: np.random.Generator, picture: np.ndarray, points: np.ndarray, known: np.ndarray
) -> np.ndarray:
    """Hands in motion: the picture around a wrist smeared along a line."""
    scale = body_scale(points, known == PRESENT)
    for wrist, elbow in zip(WRISTS, ELBOWS, strict=True):
        if scale < 8 or known[wrist] != PRESENT or rng.random() < 0.35:
            continue
        length = max(3, int(scale * rng.uniform(0.1, 0.45)))
        smeared = cv2.filter2D(picture, -1, line_kernel(length, rng.uniform(0, np.pi)))
        hand = points[wrist] + (0.25 * (points[wrist] - points[elbow]) if known[elbow] == PRESENT else 0)
        soft = np.zeros(picture.shape[:2], np.float32)
        cv2.circle(soft, (int(hand[0]), int(hand[1])), max(2, int(0.35 * scale)), 1.0, -1)
        soft = cv2.GaussianBlur(soft, (0, 0), max(1.0, 0.1 * scale))[..., None]
        picture = (picture + (smeared.astype(np.float32) - picture) * soft).astype(np.uint8)
    return picture


def _whole(person: np.ndarray, points: np.ndarray, known: np.ndarray) -> bool:
    """Whether the mask holds every joint: a person cut out without the trunk would teach invention."""
    seen = points[known == PRESENT].round().astype(int)
    body = known[[NECK, *SHOULDERS]] == PRESENT
    return bool(body.any() and len(seen) and (person[seen[:, 1], seen[:, 0]] > 0).mean() > 0.94)


def _bystander(rng: np.random.Generator, scene: np.ndarray, extra: Sample) -> np.ndarray:
    size = scene.shape[0]
    scale = rng.uniform(0.2, 0.4) * size / extra.picture.shape[0]
    x = rng.choice([rng.uniform(-0.05, 0.15), rng.uniform(0.7, 0.9)]) * size
    matrix = np.array([[scale, 0, x], [0, scale, rng.uniform(0.3, 0.6) * size]])
    picture = cv2.warpAffine(extra.picture, matrix, (size, size))
    opacity = cv2.warpAffine(extra.mask, matrix, (size, size))[..., None] / 255
    return (scene + (picture - scene.astype(np.float32)) * opacity).astype(np.uint8)
