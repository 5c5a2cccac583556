"""Pictures for the model card: what the network sees of rendered people, and how it learned.

No photograph goes in: bodies, clothes, light and backgrounds are invented, so that the pictures may be
shown. The people are drawn with seeds that no training uses.
"""

from __future__ import annotations

import csv
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from gesture_core.skeletons import COCO18

from .decode import decode
from .joints import COUNT
from .scenes import invent

SEED = 20261122
RIGHT, LEFT, MIDDLE = (60, 140, 255), (255, 170, 40), (240, 240, 240)
"""BGR of the limbs of each side."""


def overlay(model: Path, target: Path, count: int = 12, columns: int = 6, size: int = 192) -> None:
    """Write a PNG of ``count`` rendered people with the skeletons that ``model`` finds."""
    import onnxruntime

    from .body import Bodies
    from .render import draw

    session = onnxruntime.InferenceSession(str(model), providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(SEED)
    bodies = Bodies()
    people = bodies.sample(rng, count)
    tiles = []
    for index in range(count):
        person, opacity, _, _, cut = draw(rng, bodies, people, index, 288, [])
        share = 1.0 if cut else 0.92
        side = round(size * share)
        small, soft = (cv2.resize(p, (side, side), interpolation=cv2.INTER_AREA) for p in (person, opacity))
        scene = cv2.GaussianBlur(invent(rng, size), (0, 0), 3).astype(np.float32)
        scene = (0.35 * scene + 0.65 * rng.uniform(90, 190)).astype(np.uint8)  # quiet, to look at
        top, left = size - side, (size - side) // 2
        part = scene[top : top + side, left : left + side]
        alpha = soft[..., None].astype(np.float32) / 255
        scene[top : top + side, left : left + side] = part + (small.astype(np.float32) - part) * alpha
        feed = np.ascontiguousarray(scene.transpose(2, 0, 1)[None], np.float32)
        points, scores = decode(session.run(None, {"image": feed})[0][:, :COUNT], 4)
        tiles.append(skeleton(scene, points[0], scores[0]))
    rows = [np.hstack(tiles[i : i + columns]) for i in range(0, count, columns)]
    cv2.imwrite(str(target), np.vstack(rows), [cv2.IMWRITE_PNG_COMPRESSION, 9])


def skeleton(picture: np.ndarray, points: np.ndarray, scores: np.ndarray, least: float = 0.25) -> np.ndarray:
    """The picture, twice as large, with the limbs whose joints score more than ``least``."""
    out = cv2.resize(picture, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    spots = [tuple(round(float(v)) for v in 2 * p + 0.5) for p in points]
    for a, b in COCO18.limbs:
        one, two = COCO18.index(a), COCO18.index(b)
        if min(scores[one], scores[two]) > least:
            names = f"{a} {b}"
            colour = RIGHT if "right" in names else LEFT if "left" in names else MIDDLE
            cv2.line(out, spots[one], spots[two], (0, 0, 0), 5, cv2.LINE_AA)
            cv2.line(out, spots[one], spots[two], colour, 3, cv2.LINE_AA)
    for spot, score in zip(spots, scores, strict=True):
        if score > least:
            cv2.circle(out, spot, 4, (0, 0, 0), -1, cv2.LINE_AA)
            cv2.circle(out, spot, 3, (255, 255, 255), -1, cv2.LINE_AA)
    return cv2.resize(out, picture.shape[1::-1], interpolation=cv2.INTER_AREA)


def curve(log: Path, target: Path) -> None:
    """Write a PNG of ``curve.csv``: loss and distance of the peaks over the pictures seen."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with log.open(encoding="utf-8", newline="") as handle:
        rows = list(csv.DictReader(handle))
    seen = np.array([int(row["images"]) for row in rows]) / 1000
    sizes = np.array([int(row["size"]) for row in rows])
    figure, axes = pyplot.subplots(2, 1, figsize=(8, 4.6), sharex=True, layout="constrained")
    for axis, key, title in zip(
        axes, ("heat", "offset_cells"), ("heat-map loss", "peak off by, cells"), strict=True
    ):
        values = np.array([float(row[key]) for row in rows])
        starts = [0, *(np.flatnonzero(np.diff(sizes)) + 1), len(rows)]
        for start, end in pairwise(starts):
            axis.plot(seen[start:end], values[start:end], label=f"{sizes[start]} pixels")
        axis.set_ylabel(title)
        axis.set_ylim(0, float(np.quantile(values, 0.98)) * 1.05)
        axis.grid(alpha=0.3)
    axes[0].legend(ncols=4, fontsize=8)
    axes[1].set_xlabel("pictures seen, thousands (the loss of one size cannot be compared with another's)")
    figure.savefig(target, dpi=80)
    pyplot.close(figure)
