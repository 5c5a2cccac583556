"""Every example has a say, and how much it says for each class is learned from the examples themselves.

The nearest example alone decides as if all examples were equally telling. Yet one example of a wide
class is near to many strangers, a clip that shows no clear gesture is near to everything, and that
two examples of a class agree counts for nothing. Here a sequence is described by its similarities to
all examples (the dissimilarity representation of Pekalska and Duin 2002; with warping distances
Gudmundsson, Runarsson and Sigurdsson 2008, Kate 2016), and a linear discriminant on these
similarities tells the classes apart. Nothing is left out and reclassified to learn it, so it does not
matter that one person's trials are nearly copies of each other, and it needs no more than one example
a class, where it decides nearly as the nearest example does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from gesture_core.settings import ClassifySettings

# Scores are sums in an order that a library's blocking may change; what is shown is rounded to hide it,
# and classes whose scores differ by less are equal.
_DECIMALS = 6
_EQUAL = 1e-9
# Distances below this count as none: what divides by them would overflow.
_LEAST = 1e-300


@dataclass(frozen=True, eq=False)
class Weighing:
    """What the nearness of each example says for each class.

    Attributes
    ----------
    scales : (N,) float64
        The distance that counts as one for each example.
    weights : (N, C) float64
        What a similarity of 1 to an example adds to the score of each class.
    sharpness : float
        A similarity is exp(-sharpness * distance / scale).
    """

    scales: np.ndarray
    weights: np.ndarray
    sharpness: float

    def similarities(self, distances: np.ndarray) -> np.ndarray:
        """(Q, N) similarity to each example, 1 for a copy, 0 where a pair cannot be compared."""
        return np.exp(-self._exponents(distances))

    def voices(self, distances: np.ndarray) -> np.ndarray:
        """(Q, N, C) what each example says for each class; their sum over the examples is the score."""
        return self.similarities(distances)[:, :, None] * self.weights

    def scores(self, distances: np.ndarray) -> np.ndarray:
        """(Q, C) score of each class, about 1 for a class that was met and 0 for others."""
        ranks, factors = self.ranked(distances)
        return ranks * factors[:, None]

    def ranked(self, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(Q, C) scores as if the nearest example were a copy, and the (Q,) factors that undo it.

        The factor leaves the order of the classes as it is, and keeps it where everything is so far
        away that the scores themselves are zero.
        """
        exponents = self._exponents(distances)
        nearest = exponents.min(axis=1, initial=np.inf)
        nearest = np.where(np.isfinite(nearest), nearest, 0.0)
        likeness = np.exp(nearest[:, None] - exponents)
        # One row at a time, summed over the examples in their order: a row does not depend on its batch.
        ranks = [(row[:, None] * self.weights).sum(axis=0) for row in likeness]
        return np.array(ranks).reshape(len(ranks), self.weights.shape[1]), np.exp(-nearest)

    def _exponents(self, distances: np.ndarray) -> np.ndarray:
        return _exponents(distances, self.scales, self.sharpness)


def learn_weights(
    within: np.ndarray, codes: np.ndarray, classes: int, sharpness: float, shrinkage: float
) -> Weighing:
    """Learn from the distances among the examples what each of them says.

    Parameters
    ----------
    within : (N, N) float array
        Distances of every example, as a query, to every example; the diagonal is ignored.
    codes : (N,) int array
        Class of each example, 0 to ``classes - 1``; a class may have none.
    classes : int
    sharpness : float
        Above zero; how fast a similarity falls with the distance.
    shrinkage : float
        Above zero; the penalty on the squared weights.

    Returns
    -------
    Weighing

    Notes
    -----
    Distances are divided by the geometric mean of the local scales of both sequences, as in the
    self-tuning affinity of Zelnik-Manor and Perona (2004). The scale of an example is the median
    distance of the examples of other classes to it, so that an example which is far from everything,
    or near to everything, counts no more for that; the scale of a query is not known, and the median
    over the examples stands for it.

    The weights are the least-squares solution of K W = T with a ridge, where K holds the
    similarities among the examples and T is 1 for members of a class and 0 for others, less the
    mean over the classes. Where all classes have equally many examples, this is the coding under
    which least squares give Fisher's linear discriminant (Ye 2007). Otherwise each example counts by
    the inverse of the size of its class, so that no class pulls the border to itself by its number,
    and its target is multiplied by the fourth root of the mean size over its own: few examples have
    to speak for more of the space between them. Without the root a new class of one clip is met less
    often than by the nearest example; with the square root it takes what is not its own.
    """
    codes = np.asarray(codes, np.int64)
    scales, usual = _local_scales(within, codes)
    distances = np.array(within, np.float64)
    np.fill_diagonal(distances, 0.0)
    # Roots one by one: the product of two scales may be more than float64 holds.
    roots = np.sqrt(scales)
    similarity = np.exp(-_exponents(distances, roots[:, None] * roots[None], sharpness))
    members = np.bincount(codes, minlength=classes).astype(np.float64)
    met = members > 0
    targets = np.where(met, -1 / met.sum(), 0.0)[None].repeat(len(codes), axis=0)
    scarcity = members[met].mean() / members[codes]
    targets[np.arange(len(codes)), codes] += scarcity**0.25
    counted = similarity.T * scarcity
    weights = np.linalg.solve(counted @ similarity + shrinkage * np.eye(len(codes)), counted @ targets)
    return Weighing(roots * np.sqrt(usual), weights, sharpness)


def weighing_of(
    within: np.ndarray, codes: np.ndarray, classes: int, chosen: ClassifySettings
) -> Weighing | None:
    """What the settings let the examples say: None unless all of them decide."""
    if chosen.neighbors != 0:
        return None
    return learn_weights(within, codes, classes, chosen.sharpness, chosen.shrinkage)


def leading(
    weighing: Weighing, distances: np.ndarray, nearest: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The class with the highest score for each query, and its lead.

    Parameters
    ----------
    weighing : Weighing
    distances : (Q, N) float array
    nearest : (Q, C) float array
        Distance to the nearest example of each class; classes at infinity take no part. Of equal
        scores the nearer class leads, then the first one.

    Returns
    -------
    order : (Q, C) int64
        Classes, the highest score first, those at infinity last.
    found : (Q,) bool
        Whether the first of them can be compared at all.
    leads : (Q,) float
        Score of the first class minus that of the second; infinite where there is no second.
    """
    ranks, factors = weighing.ranked(distances)
    there = np.isfinite(nearest)
    ranks = np.where(there, ranks, -np.inf)
    best = np.where(there, np.abs(ranks), 0).max(axis=1, initial=0.0)
    steps = np.round(ranks / (np.where(best > 0, best, 1.0)[:, None] * _EQUAL))
    classes = np.broadcast_to(np.arange(ranks.shape[1]), ranks.shape)
    order = np.lexsort((classes, nearest, -steps), axis=1).astype(np.int64)
    rows = np.arange(len(ranks))
    found = there[rows, order[:, 0]]
    leads = np.full(len(ranks), np.inf)
    if ranks.shape[1] > 1:
        second = rows[found & there[rows, order[:, 1]]]
        lead = ranks[second, order[second, 0]] - ranks[second, order[second, 1]]
        leads[second] = np.round(np.maximum(lead, 0.0) * factors[second], _DECIMALS)
    return order, found, leads


def _local_scales(within: np.ndarray, codes: np.ndarray) -> tuple[np.ndarray, float]:
    """(N,) median distance of the other classes' examples to each example, and the median of these.

    Never zero: where an example knows of no distance, or only of copies, the median stands for it, and
    1 where there is none at all.
    """
    scales = np.full(len(codes), np.nan)
    for column in range(len(codes)):
        others = within[codes != codes[column], column]
        others = others[np.isfinite(others) & (others > _LEAST)]
        if len(others):
            scales[column] = np.median(others)
    known = scales[np.isfinite(scales)]
    usual = float(np.median(known)) if len(known) else 1.0
    return np.where(np.isfinite(scales), scales, usual), usual


def _exponents(distances: np.ndarray, scales: np.ndarray, sharpness: float) -> np.ndarray:
    """``sharpness * distances / scales``, infinite where a pair cannot be compared."""
    distances = np.asarray(distances, np.float64)
    return np.where(np.isnan(distances), np.inf, distances) * (sharpness / scales)
