"""People from heat maps and part-affinity fields (Cao et al. 2017, "Realtime Multi-Person 2D Pose").

A field of a limb points from its first joint to its second wherever the limb is. A pair of peaks
belongs together as far as the field along the straight line between them points the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.pose.heatmaps import find_peaks

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


@dataclass(frozen=True)
class AssemblyRules:
    """Thresholds of the assembly; the defaults are those of OpenPose where it names one.

    Attributes
    ----------
    peak : float
        Height of a heat map's peak.
    along : float
        Field strength that counts as "along the limb" at one sample.
    share : float
        Share of samples that must be along the limb.
    samples : int
        On the line between two joints.
    joints : int
        A person has at least so many.
    mean_score : float
        And at least this mean score of joints.
    """

    peak: float = 0.1
    along: float = 0.05
    share: float = 0.8
    samples: int = 10
    joints: int = 4
    mean_score: float = 0.2


def limb_scores(field: np.ndarray, starts: np.ndarray, ends: np.ndarray, rules: AssemblyRules) -> np.ndarray:
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
    at = np.linspace(0, 1, rules.samples, dtype=np.float32)
    line = starts[:, None, None] + step[:, :, None] * at[:, None]
    x = np.clip(np.rint(line[..., 0]).astype(np.intp), 0, wide - 1)
    y = np.clip(np.rint(line[..., 1]).astype(np.intp), 0, high - 1)
    along = field[0, y, x] * unit[..., None, 0] + field[1, y, x] * unit[..., None, 1]
    good = (along > rules.along).mean(axis=2) >= rules.share
    # Lines longer than half the picture are seldom limbs: OpenPose's own penalty.
    far = np.minimum(0.5 * max(high, wide) / np.maximum(length, 1e-6) - 1, 0)
    return np.where(good, np.maximum(along.mean(axis=2) + far, 0), 0)


def assemble(
    maps: np.ndarray, fields: np.ndarray, skeleton: str, rules: AssemblyRules
) -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """People in each picture of a batch, best first.

    Parameters
    ----------
    maps : (N, J, h, w) array
        Heat maps without the background.
    fields : (N, 2 L, h, w) array
        Part-affinity fields, channels as `LIMBS`.

    Returns
    -------
    for each picture a list of (points (J, 2) in cells, scores (J,)); NaN and 0 where missing
    """
    picture, joint, points, scores = find_peaks(maps, rules.peak)
    found = []
    for n in range(len(maps)):
        mine = np.nonzero(picture == n)[0]
        of_joint = [mine[joint[mine] == j] for j in range(maps.shape[1])]
        people = _people(fields[n], points, scores, of_joint, LIMBS[skeleton], rules)
        found.append(_filled(people, points, scores, rules))
    return found


def _people(
    fields: np.ndarray,
    points: np.ndarray,
    scores: np.ndarray,
    of_joint: list[np.ndarray],
    limbs: tuple[tuple[int, int], ...],
    rules: AssemblyRules,
) -> list[np.ndarray]:
    """For each person a (J,) array of peak numbers, -1 where missing: limbs joined, strongest first."""
    edges: list[tuple[float, int, int, int, int]] = []
    for k, (a, b) in enumerate(limbs):
        starts, ends = of_joint[a], of_joint[b]
        if not len(starts) or not len(ends):
            continue
        strength = limb_scores(fields[2 * k : 2 * k + 2], points[starts], points[ends], rules)
        for i, j in _greedy(strength, scores[starts], scores[ends]):
            edges.append((float(strength[i, j]), a, int(starts[i]), b, int(ends[j])))
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


def _greedy(strength: np.ndarray, first: np.ndarray, second: np.ndarray) -> list[tuple[int, int]]:
    """Pairs with positive strength, strongest first, each peak used once."""
    a, b = np.nonzero(strength > 0)
    order = np.argsort(-(strength[a, b] + 0.5 * first[a] + 0.5 * second[b]), kind="stable")
    pairs, used_a, used_b = [], set(), set()
    for i, j in zip(a[order].tolist(), b[order].tolist(), strict=True):
        if i not in used_a and j not in used_b:
            pairs.append((i, j))
            used_a.add(i)
            used_b.add(j)
    return pairs


def _filled(
    people: list[np.ndarray], points: np.ndarray, scores: np.ndarray, rules: AssemblyRules
) -> list[tuple[np.ndarray, np.ndarray]]:
    whole = []
    for person in people:
        has = person >= 0
        if has.sum() < rules.joints or scores[person[has]].mean() < rules.mean_score:
            continue
        xy = np.full((len(person), 2), np.nan, np.float32)
        xy[has] = points[person[has]]
        score = np.zeros(len(person), np.float32)
        score[has] = scores[person[has]]
        whole.append((xy, score))
    return sorted(whole, key=lambda found: -float(found[1].sum()))
