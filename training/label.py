"""Real pictures to training samples: find the person, ask both teachers, keep what they agree on.

Only files listed in ``people_permissive/SOURCES.csv`` are read. The result is a store of square
crops, their joints, and a mask that tells the person from the background.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from .cutout import cut_out
from .joints import ABSENT, COUNT, ELBOWS, IGNORED, PRESENT, WRISTS, body_scale
from .settings import Data
from .store import Store, Writer
from .teachers import Teachers, apply, square

PICTURES = {".jpg", ".jpeg", ".png", ".webp", ".bmp"}
Box = tuple[np.ndarray, float]
"""Centre (2,) and longer side of a box, pixels."""

LONGEST = 1280  # larger pictures are shrunk before anything else


@dataclass(frozen=True)
class Source:
    """One line of the list of sources."""

    file: Path
    group: str  # what a sampler balances: one film set, one person, one collection
    people: int


def sources(folder: Path) -> list[Source]:
    """The permissively licensed files, with the number of people that each shows."""
    with (folder / "SOURCES.csv").open(encoding="utf-8", newline="") as handle:
        rows = list(csv.DictReader(handle))
    out = []
    for row in rows:
        people = max(int(p) for p in row["people"].split("-")) if row["people"].strip() else 1
        top = row["file"].split("/")[0]
        group = row["file"] if int(float(row["frames"] or 1)) > 1 else top
        if people <= 4:
            out.append(Source(folder / row["file"], group, people))
    return out


def frames(path: Path, step: int) -> Iterator[np.ndarray]:
    """Upright BGR frames of a video (every ``step``-th), or the one picture."""
    if path.suffix.lower() in PICTURES:
        picture = cv2.imread(str(path))
        if picture is not None:
            yield picture
        return
    import av

    with av.open(str(path)) as container:
        for index, frame in enumerate(container.decode(video=0)):
            if index % step == 0:
                yield frame.to_ndarray(format="bgr24")


def strips(picture: np.ndarray, people: int) -> Iterator[np.ndarray]:
    """The picture, or one overlapping vertical strip for each of several people.

    A single-person teacher sees one person in each strip; where a strip cuts somebody in two, the
    teachers differ and the sample is dropped.
    """
    if people == 1:
        yield picture
        return
    width = picture.shape[1]
    part = width / people
    for index in range(people):
        low, high = int(max(0, (index - 0.1) * part)), int(min(width, (index + 1.1) * part))
        yield picture[:, low:high]


def box_of(points: np.ndarray, seen: np.ndarray) -> Box | None:
    """Centre and longer side of the box around the seen joints, None where there are too few."""
    if seen.sum() < 4:
        return None
    low, high = points[seen].min(axis=0), points[seen].max(axis=0)
    side = max(float((high - low).max()), 1.2 * body_scale(points, seen))
    return (low + high) / 2, side


def find(teachers: Teachers, picture: np.ndarray) -> Box | None:
    """The person's box in a picture: the whole picture first, then, where small, the part around it."""
    height, width = picture.shape[:2]
    box: Box | None = (np.array([width / 2, height / 2]), float(max(height, width)))
    whole = box
    for margin in (1.0, 1.5):
        assert box is not None
        crop, back = square(picture, box[0], box[1] * margin, 256)
        points, scores = teachers.quick(crop)
        box = box_of(apply(back, points), scores > 0.15)
        if box is None or box[1] > 0.5 * whole[1]:
            break
    return box


WINDOWS = ((1.15, 256), (1.45, 320))
"""What the large teacher looks at: sides over the person's box, and pixels."""
QUICK = (1.1, 1.35, 1.7)
"""The same for MoveNet, whose input has a size of its own."""
SHARE = 0.6  # of all votes for a joint that must fall together


def agree(
    teachers: Teachers, picture: np.ndarray, center: np.ndarray, side: float, limit: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Joints of the one person in a box: where most looks of both teachers fall together.

    Each teacher looks several times, at windows of different size and at their mirror images. A joint
    counts where votes with at least `SHARE` of the weight lie within ``limit`` of one of them, and both
    teachers are among them or one is sure. Hands that a single look finds hard stay in that way: a
    student whose known wrists all hang never learns to look for a raised one.

    Returns
    -------
    points : (18, 2) pixels of the picture
    known : (18,) int8, one of PRESENT, ABSENT, IGNORED
    None where too little is sure.
    """
    places, votes, kinds = [], [], []
    for factor, size in WINDOWS:
        crop, back = square(picture, center, side * factor, size)
        for points, scores in teachers.both_ways(crop):
            places.append(apply(back, points))
            votes.append(scores)
            kinds.append(0)
    for factor in QUICK:
        crop, back = square(picture, center, side * factor, 192)
        for points, scores in teachers.movenet_both_ways(crop):
            places.append(apply(back, points))
            votes.append(scores)
            kinds.append(1)
    place, vote, kind = np.stack(places), np.stack(votes), np.array(kinds)
    strong = vote[kind == 0].max(axis=0)
    quick = vote[kind == 1].max(axis=0)
    rough = np.median(place[kind == 0], axis=0)
    scale = body_scale(rough, np.median(vote[kind == 0], axis=0) > 0.1)
    if scale <= 0:
        return None
    points, known = rough.copy(), np.full(COUNT, IGNORED, np.int8)
    for joint in range(COUNT):
        spot, weight = place[:, joint], np.where(vote[:, joint] > 0.12, np.sqrt(vote[:, joint]), 0.0)
        if weight.sum() > 0:
            near = np.linalg.norm(spot[:, None] - spot[None], axis=2) < limit * scale
            together = near @ weight
            best = int(together.argmax())
            inside = near[best] & (weight > 0)
            share = together[best] / weight.sum()
            both = bool((kind[inside] == 0).any() and (kind[inside] == 1).any())
            alone = inside.sum() >= 3 and vote[inside, joint].max() > 0.35
            if share >= SHARE and inside.sum() >= 3 and (both or alone):
                points[joint] = (weight[inside, None] * spot[inside]).sum(axis=0) / weight[inside].sum()
                known[joint] = PRESENT
                continue
        if strong[joint] < 0.1 and quick[joint] < 0.25:
            known[joint] = ABSENT
    for elbow, wrist in zip(ELBOWS, WRISTS, strict=True):
        # a hand that nobody sees at the end of an arm that is seen is more often blurred than absent
        if known[elbow] == PRESENT and known[wrist] == ABSENT:
            known[wrist] = IGNORED
    return (points, known) if (known == PRESENT).sum() >= 5 else None


def label(shared: Path, target: Path, data: Data, threads: int, progress: object = None) -> Store:
    """Write the store of real pictures; returns it. Stops and starts at whole files."""
    teachers = Teachers(shared / "models", threads)
    every = sources(shared / "data" / "people_permissive")
    writer = Writer(target, data.stored, capacity=6000)
    for source in every if progress is None else progress(every, "label"):  # type: ignore[operator]
        key = str(source.file.name)
        if writer.done(key):
            continue
        boxes: dict[int, Box | None] = {}  # where each strip's person was in the last frame
        step = data.sparse_step if source.file.parent.name in data.sparse else data.frame_step
        for frame in frames(source.file, step):
            shrink = LONGEST / max(frame.shape[:2])
            picture = (
                frame
                if shrink >= 1
                else cv2.resize(frame, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
            )
            for number, strip in enumerate(strips(picture, source.people)):
                box = boxes.get(number) or find(teachers, strip)
                if box is not None:
                    boxes[number] = _sample(teachers, strip, box, source, data, writer)
        writer.mark(key)
    return writer.close()


def _sample(
    teachers: Teachers, picture: np.ndarray, box: Box, source: Source, data: Data, writer: Writer
) -> Box | None:
    """Label and store the person in ``box``; returns the box for the next frame."""
    center, side = box
    result = agree(teachers, picture, center, side, data.agree)
    if result is None:
        return None
    points, known = result
    box_now = box_of(points, known == PRESENT)
    if box_now is not None:
        center, side = box_now
    stored, outward = square(picture, center, side * data.margin, data.stored)
    inward = cv2.invertAffineTransform(outward)
    places = apply(inward, points)
    inside = np.full(picture.shape[:2], 255, np.uint8)
    inside = square(cv2.merge([inside] * 3), center, side * data.margin, data.stored)[0][..., 0] > 200
    mask = cut_out(stored, places, known == PRESENT, inside)
    bottom = apply(inward, np.array([[0.0, picture.shape[0]]]))[0, 1]
    writer.add(stored, mask, places, known, source.group, min(float(bottom), float(data.stored)))
    return center, side
