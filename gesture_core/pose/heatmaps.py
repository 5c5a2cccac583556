"""Joints from heat maps, and people from heat maps and part-affinity fields.

A heat map is high where its joint is; its peaks are refined below the size of a cell. A field of a limb
points from its first joint to its second wherever the limb is, so that a pair of peaks belongs together
as far as the field along the straight line between them points the same way (Cao et al. 2017, "Realtime
Multi-Person 2D Pose Estimation using Part Affinity Fields").
"""

from __future__ import annotations

import numpy as np

# Of the assembly of people; the figures are OpenPose's where it names one.
ALONG = 0.05
"""Field strength that counts as "along the limb" at one sample."""
SHARE = 0.8
"""Share of samples on the line between two joints that must be along the limb."""
SAMPLES = 10
LEAST_JOINTS = 4
LEAST_SCORE = 0.2
"""Joints of a person, and their mean score; what has less is nobody."""
_FLOOR = 1e-4

LIMBS: dict[str, tuple[tuple[int, int], ...]] = {
    "coco18": (
        (1, 8), (8, 9), (9, 10), (1, 11), (11, 12), (12, 13), (1, 2), (2, 3), (3, 4), (2, 16),
        (1, 5), (5, 6), (6, 7), (5, 17), (1, 0), (0, 14), (0, 15), (14, 16), (15, 17),
    ),
    "body25": (
        (1, 8), (9, 10), (10, 11), (8, 9), (8, 12), (12, 13), (13, 14), (1, 2), (2, 3), (3, 4),
        (2, 17), (1, 5), (5, 6), (6, 7), (5, 18), (1, 0), (0, 15), (0, 16), (15, 17), (16, 18),
        (14, 19), (19, 20), (14, 21), (11, 22), (22, 23), (11, 24),
    ),
    "mpi15": (
        (0, 1), (1, 2), (2, 3), (3, 4), (1, 5), (5, 6), (6, 7), (1, 14), (14, 8), (8, 9), (9, 10),
        (14, 11), (11, 12), (12, 13),
    ),
}  # fmt: skip
"""Joints of each limb in the channel order of the fields: channels 2k (x) and 2k + 1 (y) are limb k's."""


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
    # Few cells are above the floor, so that looking at their neighbours costs less than comparing maps.
    chosen = np.flatnonzero(maps > floor)
    n, j, y, x = np.unravel_index(chosen, maps.shape)
    row = wide + 2  # with a border below every cell, so that neighbours need no test of the edge
    framed = np.full((*maps.shape[:2], high + 2, row), -np.inf, maps.dtype)
    framed[:, :, 1:-1, 1:-1] = maps
    cells = framed.reshape(-1)
    place = chosen // (high * wide) * (high + 2) * row + (y + 1) * row + x + 1
    here = cells[place]
    peak = np.ones(len(n), bool)
    for step in (-row - 1, -row, -row + 1, -1, 1, row - 1, row, row + 1):
        beside = cells[place + step]
        # Written so that a neighbour which is no number says nothing.
        peak &= ~(here <= beside) if step < 0 else ~(here < beside)
    place, y, x = place[peak], y[peak], x[peak]
    # The peak of a Gaussian is the vertex of the parabola through the logarithms of three neighbouring
    # cells, exactly; at the border of a map the cell itself is kept.
    dx = np.where((x > 0) & (x < wide - 1), _vertex(cells, place, 1), 0)
    dy = np.where((y > 0) & (y < high - 1), _vertex(cells, place, row), 0)
    points = np.stack([x + dx, y + dy], axis=-1).astype(np.float32)
    return n[peak], j[peak], points, np.clip(cells[place], 0, 1).astype(np.float32)


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


def limb_scores(field: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(A, B) mean of the field along the lines from each of A `starts` to each of B `ends`.

    Zero where too few samples point along the line.

    Parameters
    ----------
    field : (2, h, w) array
    starts, ends : (A, 2) and (B, 2) arrays, x and y in cells
    """
    high, wide = field.shape[1:]
    step = ends[None] - starts[:, None]
    length = np.linalg.norm(step, axis=2)
    unit = step / np.maximum(length, 1e-6)[..., None]
    at = np.linspace(0, 1, SAMPLES, dtype=np.float32)
    line = starts[:, None, None] + step[:, :, None] * at[:, None]
    x = np.clip(np.rint(line[..., 0]).astype(np.intp), 0, wide - 1)
    y = np.clip(np.rint(line[..., 1]).astype(np.intp), 0, high - 1)
    along = field[0, y, x] * unit[..., None, 0] + field[1, y, x] * unit[..., None, 1]
    good = (along > ALONG).mean(axis=2) >= SHARE
    # Lines longer than half the picture are seldom limbs: OpenPose's own penalty.
    far = np.minimum(0.5 * max(high, wide) / np.maximum(length, 1e-6) - 1, 0)
    return np.where(good, np.maximum(along.mean(axis=2) + far, 0), 0)


def assemble(
    maps: np.ndarray, fields: np.ndarray, skeleton: str, floor: float
) -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """People in each picture of a batch, best first.

    Parameters
    ----------
    maps : (N, J, h, w) array
        Heat maps without the background.
    fields : (N, 2 L, h, w) array
        Part-affinity fields, channels as `LIMBS`.
    skeleton : str
        A key of `LIMBS`.
    floor : float
        Least height of a peak.

    Returns
    -------
    for each picture a list of (points (J, 2) in cells, scores (J,)); NaN and 0 where missing
    """
    picture, joint, points, scores = find_peaks(maps, floor)
    found = []
    for n in range(len(maps)):
        mine = np.nonzero(picture == n)[0]
        of_joint = [mine[joint[mine] == j] for j in range(maps.shape[1])]
        whole = []
        for person in _people(fields[n], points, scores, of_joint, LIMBS[skeleton]):
            has = person >= 0
            if has.sum() >= LEAST_JOINTS and scores[person[has]].mean() >= LEAST_SCORE:
                xy = np.full((len(person), 2), np.nan, np.float32)
                xy[has] = points[person[has]]
                score = np.zeros(len(person), np.float32)
                score[has] = scores[person[has]]
                whole.append((xy, score))
        found.append(sorted(whole, key=lambda one: -float(one[1].sum())))
    return found


def _people(
    fields: np.ndarray,
    points: np.ndarray,
    scores: np.ndarray,
    of_joint: list[np.ndarray],
    limbs: tuple[tuple[int, int], ...],
) -> list[np.ndarray]:
    """For each person a (J,) array of peak numbers, -1 where missing: limbs joined, strongest first."""
    edges: list[tuple[float, int, int, int, int]] = []
    for k, (a, b) in enumerate(limbs):
        starts, ends = of_joint[a], of_joint[b]
        if not len(starts) or not len(ends):
            continue
        strength = limb_scores(fields[2 * k : 2 * k + 2], points[starts], points[ends])
        first, second = np.nonzero(strength > 0)
        rank = strength[first, second] + 0.5 * scores[starts][first] + 0.5 * scores[ends][second]
        used: set[int] = set()  # each peak belongs to one limb of a kind
        for pair in np.argsort(-rank, kind="stable"):
            i, j = int(first[pair]), int(second[pair])
            p, q = int(starts[i]), int(ends[j])
            if not used & {p, q}:
                used |= {p, q}
                edges.append((float(strength[i, j]), a, p, b, q))
    people: list[np.ndarray] = []
    owner: dict[int, int] = {}
    for _, a, p, b, q in sorted(edges, key=lambda edge: -edge[0]):
        one, two = owner.get(p), owner.get(q)
        if one is None and two is None:
            person = np.full(len(of_joint), -1)
            person[[a, b]] = p, q
            owner[p] = owner[q] = len(people)
            people.append(person)
        elif one is not None and two is not None:
            if one == two or ((people[one] >= 0) & (people[two] >= 0)).any():
                continue
            people[one] = np.maximum(people[one], people[two])
            for peak in people[two][people[two] >= 0]:
                owner[int(peak)] = one
            people[two] = np.full(len(of_joint), -1)
        else:
            joined, new, place = (one, q, b) if one is not None else (two, p, a)
            if joined is not None and people[joined][place] < 0:
                people[joined][place] = new
                owner[new] = joined
    return [person for person in people if (person >= 0).any()]
