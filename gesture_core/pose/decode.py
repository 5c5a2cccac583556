"""Keypoints from the raw outputs of a network, for each layout that networks come in.

A heat map is high where its joint is; its peaks are refined below the size of a cell.

Every decoder gives people in pixels of the network's input, counted from the centre of the first pixel,
for a whole batch at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.errors import ModelError, PoseError
from gesture_core.joints import FACE_POINTS
from gesture_core.pose.contract import BLAZEPOSE, FIELDS, ModelContract, split_openpose
from gesture_core.pose.region import ROOM
from gesture_core.skeletons import skeleton
from gesture_core.types import Person

CERTAIN = 0.4
"""Score from which a joint or a box is certainly somebody's."""
PEAKS = 3
"""Of a heat map that are handed on: the third is the joint in 1 % of frames, further ones hardly ever."""
LEAST_SCORE = 0.2
"""Of a box, and of a person's joints on average, where several people are told apart."""
_FLOOR = 1e-4
_AROUND = 3
"""Cells of BlazePose's heat maps to each side of a landmark that are looked at, and, below, the height of one
of them from which they know better than the landmark: as in MediaPipe."""
_HEAT = 0.5
_FACE_ROOM = 1.5
"""Side of the next square over the box around a face, as in MediaPipe."""


def decode(
    outputs: Sequence[np.ndarray],
    contract: ModelContract,
    input_size: tuple[int, int],
    people: str,
    floor: float,
) -> list[list[Person]]:
    """The people in each picture of a batch, best first, in pixels of the input.

    Parameters
    ----------
    outputs : sequence of arrays
        As the network gave them.
    contract : ModelContract
    input_size : (height, width)
        Of the input that was fed.
    people : "single" or "multi"
        The best peak of every joint as one person, or everybody that the network tells apart.
    floor : float
        Least height of a joint's peak.

    Raises
    ------
    PoseError
        ``E_POSE_PEOPLE`` where the network cannot tell people apart.
    """
    arrays = [np.asarray(out, np.float32) for out in outputs]
    if contract.layout == "openpose":
        return _openpose(arrays, contract, input_size, people, floor)
    if contract.layout == "yolo-pose":
        return _yolo_pose(arrays[0], people)
    if people != "single":
        raise _cannot_tell_apart(f"{contract.layout} finds one person in a picture")
    if contract.layout == "blazepose":
        return _blazepose(arrays, input_size)
    if contract.layout == "blazehand":
        return _blazehand(arrays)
    if contract.layout == "blazeface":
        return _blazeface(arrays)
    return _movenet(arrays[0], input_size) if contract.layout == "movenet" else _simcc(arrays, input_size)


def _blazehand(outputs: list[np.ndarray]) -> list[list[Person]]:
    """21 times x, y, z in pixels, presence, handedness, and the landmarks in metres (Zhang et al. 2020)."""
    hand, presence = outputs[0].reshape(-1, 3), float(np.clip(outputs[1].reshape(-1)[0], 0, 1))
    points = hand[:, :2] - 0.5
    return [
        [Person(points.astype(np.float32), np.full(len(points), presence, np.float32), presence=presence)]
    ]


def _blazeface(outputs: list[np.ndarray]) -> list[list[Person]]:
    """468 times x, y, z in pixels, and the logit of the presence (Kartynnik et al. 2019); 20 are kept."""
    logit, rows = sorted((out.reshape(-1) for out in outputs), key=len)
    mesh = rows.reshape(-1, 3)[:, :2] - 0.5
    points = mesh[[place for _, place in FACE_POINTS.values()]]
    presence = float(1 / (1 + np.exp(-np.clip(logit[0], -50, 50))))
    # The next square: around all points, level between the eyes.
    at = dict(zip(FACE_POINTS, points, strict=True))
    right, left = ((at[f"{side}_eye_outer"] + at[f"{side}_eye_inner"]) / 2 for side in ("right", "left"))
    turn = np.stack([left - right, np.array([right[1] - left[1], left[0] - right[0]])])
    turn /= max(float(np.hypot(*turn[0])), 1e-6)
    seen = mesh @ turn.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    radius = _FACE_ROOM * float((high - low).max()) / (2 * ROOM)
    middle = (low + high) / 2 @ turn
    region = np.stack([middle, middle - radius * turn[1]])
    score = np.full(len(points), presence, np.float32)
    return [[Person(points.astype(np.float32), score, presence=presence, region=region)]]


def _openpose(
    outputs: list[np.ndarray], contract: ModelContract, input_size: tuple[int, int], people: str, floor: float
) -> list[list[Person]]:
    at, apart = split_openpose([out.shape for out in outputs], contract.skeleton)
    joints = len(skeleton(contract.skeleton).joints)
    maps = outputs[at][:, :joints]
    # A cell covers `step` input pixels; cell and pixel coordinates both count from a centre.
    step = np.array([input_size[1] / maps.shape[3], input_size[0] / maps.shape[2]], np.float32)
    fields = outputs[apart] if apart is not None else outputs[at][:, joints + 1 :]
    several = FIELDS.get(fields.shape[1]) == contract.skeleton
    if people == "single":
        # Half as high as a joint must be: such a peak may still be chosen over time (`temporal`).
        peaks = top_peaks(maps, PEAKS, 0.5 * floor)
        peaks[..., :2] = (peaks[..., :2] + 0.5) * step - 0.5
        own = next((out.reshape(-1) for out in outputs if out.ndim <= 2 and out.size == len(maps)), None)
        presence = np.ones(len(maps)) if own is None else np.clip(own, 0, 1)
        # Further people of whom peaks are: each shows most of the joints of the first one.
        certain = (peaks[..., 2] >= CERTAIN).sum(axis=1)
        others = (certain[:, 1:] > 0.5 * np.maximum(certain[:, :1], 4)).sum(axis=1)
        return [
            [Person(one[:, 0, :2], one[:, 0, 2], one, float(there), others=int(more) if several else 0)]
            for one, there, more in zip(peaks, presence, others, strict=True)
        ]
    if not several:
        raise _cannot_tell_apart("it has no part-affinity fields")
    from gesture_core.pose.people import assemble

    return [
        [Person((points + 0.5) * step - 0.5, scores) for points, scores in picture]
        for picture in assemble(maps, fields, contract.skeleton, floor)
    ]


def _movenet(output: np.ndarray, input_size: tuple[int, int]) -> list[list[Person]]:
    """(N, 1, 17, 3): y, x as fractions of the input, and the score (MoveNet, Google 2021)."""
    rows = output[:, 0]
    points = rows[..., 1::-1] * np.array(input_size[::-1], np.float32) - 0.5
    return [[Person(*one)] for one in zip(points, np.clip(rows[..., 2], 0, 1), strict=True)]


def _simcc(outputs: list[np.ndarray], input_size: tuple[int, int]) -> list[list[Person]]:
    """Two (N, J, bins) classifications of x and of y (Li et al. 2022, SimCC; Jiang et al. 2023, RTMPose)."""
    high, wide = input_size
    # The two outputs have the same form; the bins of x are as many times the width as those of y
    # are of the height.
    x, y = outputs
    if x.shape[2] * high != y.shape[2] * wide and y.shape[2] * high == x.shape[2] * wide:
        x, y = y, x
    points = np.stack([x.argmax(2) * (wide / x.shape[2]), y.argmax(2) * (high / y.shape[2])], axis=-1)
    scores = np.clip(np.minimum(x.max(2), y.max(2)), 0, 1)
    return [[Person(*one)] for one in zip(points.astype(np.float32), scores, strict=True)]


def _yolo_pose(output: np.ndarray, people: str) -> list[list[Person]]:
    """(N, 56, M): M boxes of centre, size, score and 17 times x, y, score (Maji et al. 2022, YOLO-Pose)."""
    found = []
    for rows in output.transpose(0, 2, 1) if output.shape[1] == 56 else output:
        rows = rows[rows[:, 4] >= LEAST_SCORE]
        kept: list[np.ndarray] = []
        for row in rows[np.argsort(-rows[:, 4], kind="stable")]:
            if all(_overlap(row, other) < 0.65 for other in kept):
                kept.append(row)
        others = 0
        if people == "single":
            others, kept = sum(bool(row[4] >= CERTAIN) for row in kept[1:]), kept[:1]
        picture = []
        for row in kept:
            one = row[5:].reshape(17, 3)
            # Its users take boxes from a score of 0.25 on.
            presence = min(2 * float(row[4]), 1.0)
            picture.append(
                Person(one[:, :2] - 0.5, np.clip(one[:, 2], 0, 1), presence=presence, others=others)
            )
        found.append(picture)
    return found


def _blazepose(outputs: list[np.ndarray], input_size: tuple[int, int]) -> list[list[Person]]:
    """39 times x, y, z in pixels, visibility and presence as logits; whether a person is there; and heat
    maps, by which x and y become finer (Bazarevsky et al. 2020, BlazePose)."""
    from scipy.special import expit

    landmarks = next((out.reshape(-1, 39, 5) for out in outputs if out[0].size == BLAZEPOSE), None)
    there = next((out.reshape(-1) for out in outputs if out[0].size == 1), None)
    if landmarks is None or there is None:
        raise ModelError(
            f"outputs of {', '.join(str(out[0].size) for out in outputs)} numbers are not BlazePose's: "
            f"{BLAZEPOSE} of landmarks, and 1 that says whether a person is there",
            remedy="the whole network, or another layout in its contract",
            code="E_MODEL_LAYOUT",
        )
    places = landmarks[..., :2]
    maps = next((out for out in outputs if out.ndim == 4 and out.shape[1] == landmarks.shape[1]), None)
    if maps is not None:
        cell = np.array(input_size[::-1], np.float32) / maps.shape[:1:-1]
        places = cell * np.stack([_finer(*one) for one in zip(places / cell, maps, strict=True)])
    return [
        [Person(points[:33], expit(one[:33, 3]), None, float(presence), points[33:35], depth=one[:33, 2])]
        for one, points, presence in zip(landmarks, places - 0.5, there, strict=True)
    ]


def _finer(places: np.ndarray, maps: np.ndarray) -> np.ndarray:
    """Places (J, 2) in cells, each in the middle of what its heat map (J, h, w) of logits shows around it."""
    from scipy.special import expit

    high, wide = maps.shape[1:]
    inside = np.asarray(((places >= 0) & (places < (wide, high))).all(axis=1))  # NaN is not
    x, y = np.where(inside[:, None], places, 0).astype(int).T[..., None, None]
    steps = np.arange(2 * _AROUND + 1)
    rows, columns = y + steps[:, None] - _AROUND, x + steps - _AROUND
    beyond = (rows < 0) | (rows >= high) | (columns < 0) | (columns >= wide)
    each = np.arange(len(maps))[:, None, None]
    heat = np.where(beyond, 0, expit(maps[each, rows.clip(0, high - 1), columns.clip(0, wide - 1)]))
    total = heat.sum(axis=(1, 2))
    known = inside & (heat.max(axis=(1, 2)) >= _HEAT)
    middle = np.stack([(heat.sum(axis=axis) * steps).sum(axis=1) for axis in (1, 2)], axis=1)
    found = middle / np.where(known, total, 1)[:, None] + np.stack([x, y], axis=1)[..., 0, 0] - _AROUND
    finer: np.ndarray = np.where(known[:, None], found, places)
    return finer


def _overlap(one: np.ndarray, two: np.ndarray) -> float:
    """Intersection over union of two boxes given by centre and size."""
    low = np.maximum(one[:2] - one[2:4] / 2, two[:2] - two[2:4] / 2)
    high = np.minimum(one[:2] + one[2:4] / 2, two[:2] + two[2:4] / 2)
    both = float(np.prod(np.maximum(high - low, 0)))
    return both / max(float(np.prod(one[2:4]) + np.prod(two[2:4])) - both, 1e-9)


def _cannot_tell_apart(cause: str) -> PoseError:
    return PoseError(
        f"this network cannot tell people apart: {cause}",
        remedy="--set pose.people=single, or --model with a network that can, such as hpe0001 or YOLO-pose: "
        "'gesture models' says where they are",
        code="E_POSE_PEOPLE",
    )


def find_peaks(maps: np.ndarray, floor: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All local maxima above ``floor``.

    A cell is a maximum where it exceeds its left and upper neighbours and no other neighbour
    exceeds it, so that of two equal cells exactly one counts. NaN is never a maximum.

    Parameters
    ----------
    maps : (N, J, h, w) float array
    floor : float

    Returns
    -------
    picture, joint : (P,) int arrays
    points : (P, 2) float32
        x, y in cells, counted from the centre of the first cell.
    scores : (P,) float32
        Height of the peak, clipped to 0..1.
    """
    high, wide = maps.shape[2:]
    row = wide + 2  # with a border below every cell, so that neighbours need no test of the edge
    framed = np.empty((*maps.shape[:2], high + 2, row), maps.dtype)
    framed[:, :, :: high + 1] = framed[..., :: wide + 1] = -np.inf
    framed[:, :, 1:-1, 1:-1] = maps
    cells = framed.reshape(-1)
    # Few cells are above the floor, and every neighbour leaves fewer: looking at these costs less than
    # comparing maps.
    place = np.flatnonzero(cells > floor)
    for step in (-1, 1, -row, row, -row - 1, -row + 1, row - 1, row + 1):
        here, beside = cells[place], cells[place + step]
        # Written so that a neighbour that is NaN does not count.
        place = place[~(here <= beside) if step < 0 else ~(here < beside)]
    n, j, y, x = np.unravel_index(place, framed.shape)
    y, x = y - 1, x - 1
    # The peak of a Gaussian is the vertex of the parabola through the logarithms of three neighbouring
    # cells, exactly; at the border of a map the cell itself is kept.
    dx = np.where((x > 0) & (x < wide - 1), _vertex(cells, place, 1), 0)
    dy = np.where((y > 0) & (y < high - 1), _vertex(cells, place, row), 0)
    points = np.stack([x + dx, y + dy], axis=-1).astype(np.float32)
    return n, j, points, np.clip(cells[place], 0, 1).astype(np.float32)


def _vertex(cells: np.ndarray, place: np.ndarray, step: int) -> np.ndarray:
    """How far the vertex of the parabola lies from the cell at ``place``, in cells."""
    near = place + np.array([[-step], [0], [step]])
    a, b, c = np.log(np.maximum(cells[near], _FLOOR))
    curve = a - 2 * b + c
    flat = ~(curve < -1e-6)  # NaN too: then the cell itself is kept
    return np.clip(np.where(flat, 0, (a - c) / np.where(flat, 1, 2 * curve)), -0.5, 0.5)


def top_peaks(maps: np.ndarray, count: int, floor: float) -> np.ndarray:
    """The highest peaks of each map.

    Parameters
    ----------
    maps : (N, J, h, w) float array
    count : int
    floor : float
        Lower peaks are left out.

    Returns
    -------
    (N, J, count, 3) float32
        x, y in cells and the score, the highest first; NaN, NaN, 0 beyond the last peak.
    """
    n, j, points, scores = find_peaks(maps, floor)
    order = np.lexsort((-scores, j, n))
    map_of = (n * maps.shape[1] + j)[order]
    rank = np.arange(len(order)) - np.searchsorted(map_of, map_of)
    found = np.full((*maps.shape[:2], count, 3), np.nan, np.float32)
    found[..., 2] = 0
    order, rank = order[rank < count], rank[rank < count]
    found[n[order], j[order], rank, :2] = points[order]
    found[n[order], j[order], rank, 2] = scores[order]
    return found
