"""What is learned from the distances among the examples: representatives, thresholds, weights.

The nearest example alone decides as if all examples were equally reliable. Yet one example of a wide
class is near to many strangers, a clip that shows no clear gesture is near to everything, and that
two examples of a class agree counts for nothing. With weights, a sequence is described by its
similarities to all examples (the dissimilarity representation of Pekalska and Duin 2002; with warping
distances Gudmundsson, Runarsson and Sigurdsson 2008, Kate 2016), and a linear discriminant on these
similarities separates the classes. Nothing is left out and reclassified to learn it, so it does not
matter that one person's trials are nearly copies of each other, and it needs no more than one example
a class, where it decides nearly as the nearest example does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.errors import ConfigError

# Distances below this count as none: what divides by them would overflow.
_LEAST = 1e-300


@dataclass(frozen=True, eq=False)
class ExampleWeights:
    """What the nearness of each example counts for each class: a linear discriminant on similarities.

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
        similarities: np.ndarray = np.exp(-_exponents(distances, self.scales, self.sharpness))
        return similarities

    def contributions(self, distances: np.ndarray) -> np.ndarray:
        """(Q, N, C) what each example adds to the score of each class."""
        added: np.ndarray = self.similarities(distances)[:, :, None] * self.weights
        return added

    def scores(self, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(Q, C) scores as if the nearest example were a copy, and the (Q,) factors that undo it.

        The product is the sum of the contributions, about 1 for the right class and 0 for others.
        The factor leaves the order of the classes as it is; without it the order stands even where
        everything is so far away that the product is zero.
        """
        exponents = _exponents(distances, self.scales, self.sharpness)
        nearest = exponents.min(axis=1, initial=np.inf)
        nearest = np.where(np.isfinite(nearest), nearest, 0.0)
        scores: np.ndarray = np.empty((len(exponents), self.weights.shape[1]))
        # One row at a time, summed over the examples in their order: a row does not depend on its batch.
        for index, similarities in enumerate(np.exp(nearest[:, None] - exponents)):
            scores[index] = (similarities[:, None] * self.weights).sum(axis=0)
        return scores, np.exp(-nearest)


def learn_weights(
    within: np.ndarray,
    codes: np.ndarray,
    classes: int,
    sharpness: float,
    shrinkage: float,
    marks: np.ndarray | None = None,
) -> ExampleWeights:
    """Learn how much each example counts from the distances among them and their (N,) codes.

    ``within`` are the (N, M) distances of all of them to those at the (M,) ``marks``, which queries are
    compared with; without marks, to all. ``sharpness`` says how fast a similarity falls with the distance,
    ``shrinkage`` is the penalty on the squared weights; both are above zero.

    Notes
    -----
    Distances are divided by the geometric mean of the local scales of both sequences, as in the
    self-tuning affinity of Zelnik-Manor and Perona (2004). The scale of an example is the median
    distance of the examples of other classes to it, so that an example which is far from everything,
    or near to everything, counts no more for that; the scale of a query is not known, and the median
    over the examples stands for it. Scales are never zero: where an example has no such distance, or
    only copies, the median stands for it too, and 1 where there is none at all. That of an example which
    is no mark is its own median distance to the marks of other classes.

    The weights are the least-squares solution of K W = T with a ridge, where K holds the
    similarities among the examples and T is 1 for members of a class and 0 for others, less the
    mean over the classes. Where all classes have equally many examples, this is the coding under
    which least squares give Fisher's linear discriminant (Ye 2007). Otherwise each example counts by
    the inverse of the size of its class, so that no class pulls the border to itself by its number,
    and its target is multiplied by the fourth root of the mean size over its own: few examples have
    to stand for more of the space between them. Without the root a new class of one clip is met less
    often than by the nearest example; with the square root it takes what is not its own.
    """
    codes = np.asarray(codes, np.int64)
    marks = np.arange(len(codes)) if marks is None else marks
    distances = np.array(within, np.float64)
    distances[marks, np.arange(len(marks))] = 0.0
    others = np.where(codes[:, None] != codes[marks], distances, np.nan)
    others[~np.isfinite(others) | (others <= _LEAST)] = np.nan
    scales, usual = _scales(others.T)
    # Roots one by one: the product of two scales may be more than float64 holds.
    roots, rows = np.sqrt(scales), np.sqrt(_scales(others, usual)[0])
    rows[marks] = roots
    similarity = np.exp(-_exponents(distances, rows[:, None] * roots, sharpness))
    targets, scarcity = targets_of(codes, classes)
    counted = similarity.T * scarcity
    weights = np.linalg.solve(counted @ similarity + shrinkage * np.eye(len(marks)), counted @ targets)
    return ExampleWeights(roots * np.sqrt(usual), weights, sharpness)


def targets_of(codes: np.ndarray, classes: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, C) what the scores of the examples should be, and how much each counts; see `learn_weights`."""
    members = np.bincount(codes, minlength=classes).astype(np.float64)
    met = members > 0
    targets = np.where(met, -1 / met.sum(), 0.0)[None].repeat(len(codes), axis=0)
    scarcity = members[met].mean() / members[codes]
    targets[np.arange(len(codes)), codes] += scarcity**0.25
    return targets, scarcity


def _scales(others: np.ndarray, usual: float | None = None) -> tuple[np.ndarray, float]:
    """The median of what each row holds beside NaN, and the usual one, which stands where it holds none."""
    scales = np.full(len(others), np.nan)
    held = np.isfinite(others).any(axis=1)
    scales[held] = np.nanmedian(others[held], axis=1)
    if usual is None:
        usual = float(np.median(scales[held])) if held.any() else 1.0
    return np.where(held, scales, usual), usual


def _exponents(distances: np.ndarray, scales: np.ndarray, sharpness: float) -> np.ndarray:
    """``sharpness * distances / scales``, infinite where a pair cannot be compared."""
    distances = np.asarray(distances, np.float64)
    exponents: np.ndarray = np.where(np.isnan(distances), np.inf, distances) * (sharpness / scales)
    return exponents


def medoids(distances: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """The representative example of each class.

    That is the example with the smallest total distance to the others of its class (Schneider
    et al. 2019, section III), rows of the (N, N) ``distances`` against columns. Pairs without a common
    dimension (infinite distance) weigh more than any sum of finite ones; ties go to the lower index.

    Returns
    -------
    (C,) int64
        Index of one example for each class, in ascending order of index.
    """
    chosen = []
    for code in np.unique(codes):
        members = np.flatnonzero(codes == code)
        block = np.asarray(distances, np.float64)[np.ix_(members, members)]
        finite = np.isfinite(block)
        total = np.where(finite, block, 0).sum(axis=1)
        order = np.lexsort((members, total, (~finite).sum(axis=1)))
        chosen.append(members[order[0]])
    return np.sort(np.array(chosen, np.int64))


def calibrated_thresholds(
    within: np.ndarray, codes: np.ndarray, classes: int, sd: float, kept: np.ndarray
) -> np.ndarray:
    """(C,) threshold of each class from the distances among its examples.

    Each example is left out once and its distance to the nearest other example of its class is
    taken, of those that are ``kept``: the same quantity that a query of the class will have. The
    threshold is their mean plus ``sd`` standard deviations (Gillian, Knapp and O'Modhrain 2011). A
    class with fewer than three such distances has no deviation of its own and takes the threshold of
    all classes together. ``within`` are the (N, K) distances of all examples to those at ``kept``.

    Raises
    ------
    ConfigError
        E_REJECT where no class has two examples that can be compared.
    """
    own = np.where(np.isnan(within), np.inf, within).astype(np.float64)
    own = np.where(codes[:, None] == codes[kept], own, np.inf)
    own[kept, np.arange(len(kept))] = np.inf
    nearest = own.min(axis=1)
    known = np.isfinite(nearest)
    if not known.any():
        raise ConfigError(
            "a rejection threshold cannot be calibrated: no class has two examples",
            remedy="two examples of a class at least (better three of each), or --reject DISTANCE",
            code="E_REJECT",
        )
    thresholds = np.full(classes, nearest[known].mean() + sd * nearest[known].std())
    for code in range(classes):
        mine = nearest[known & (codes == code)]
        if len(mine) >= 3:
            thresholds[code] = mine.mean() + sd * mine.std()
    return thresholds
