"""Nearest neighbours of a distance matrix, their vote, and the margin of the winner."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral

import numpy as np

from gesture_core.classify.weighing import Weighing, leading
from gesture_core.errors import ConfigError, InputError
from gesture_core.types import Neighbors

# Classes that an answer of weighed examples names.
_NAMED = 3


def k_nearest(distances: np.ndarray, k: int = 1) -> Neighbors:
    """The ``k`` smallest entries of each row, nearest first.

    Parameters
    ----------
    distances : (Q, N) float array
        Infinity where a pair cannot be compared. NaN counts as infinity, so that it never wins.
    k : int
        1 to N.

    Returns
    -------
    Neighbors
        (Q, k) distances and indices; ties go to the lower index.

    Raises
    ------
    ConfigError
        Where ``k`` is no whole number between 1 and the number of examples.
    """
    distances = np.asarray(distances, np.float64)
    if distances.ndim != 2:
        raise InputError(f"distances have shape {distances.shape}, expected (Q, N)", code="E_DIMENSIONS")
    if not isinstance(k, Integral) or not 1 <= k <= distances.shape[1]:
        raise ConfigError(
            f"{k} neighbours were asked for and there are {distances.shape[1]} examples",
            remedy=f"classify.neighbors between 1 and {distances.shape[1]}",
            code="E_NEIGHBORS",
        )
    clean = np.where(np.isnan(distances), np.inf, distances)
    order = np.argsort(clean, axis=1, kind="stable")[:, :k]
    return Neighbors(np.take_along_axis(clean, order, axis=1), order.astype(np.int64))


@dataclass(frozen=True, eq=False)
class Votes:
    """What the neighbours of each query say.

    Attributes
    ----------
    winners : (Q,) int64
        Index into the classes; -1 where no example could be compared with the query.
    distances : (Q,) float
        To the nearest example of the winning class.
    margins : (Q,) float
        Distance to the nearest example of any other class minus ``distances``: infinite where no
        other class can be compared, negative where a vote of several neighbours overruled the
        nearest one. Where all examples were weighed, what the winner's score is ahead of the next.
    order : (Q, C) int64, optional
        The classes, best first, where all examples were weighed.
    """

    winners: np.ndarray
    distances: np.ndarray
    margins: np.ndarray
    order: np.ndarray | None = None


def vote(distances: np.ndarray, codes: np.ndarray, classes: int, k: int = 1) -> Votes:
    """Majority of the ``k`` nearest examples (Cover and Hart 1967).

    Equal counts go to the class whose nearest example is nearer, then to the one whose nearest
    example comes first. Examples at an infinite distance have no vote.

    Parameters
    ----------
    distances : (Q, N) float array
    codes : (N,) int array
        Class of each example, 0 to ``classes - 1``.
    classes : int
    k : int
    """
    near = k_nearest(distances, k)
    best = class_minima(distances, codes, classes)
    winners = np.full(len(near.indices), -1, np.int64)
    for query, (row, where) in enumerate(zip(near.distances, near.indices, strict=True)):
        voters = where[np.isfinite(row)]
        if len(voters) == 0:
            continue
        count = np.bincount(codes[voters], minlength=classes)
        tied = {int(c) for c in np.flatnonzero(count == count.max())}
        # Voters are ordered by distance, then index: the first of a tied class decides.
        winners[query] = next(int(codes[v]) for v in voters if int(codes[v]) in tied)
    rows = np.arange(len(winners))
    own = np.where(winners >= 0, best[rows, winners], np.inf)
    rest = best.copy()
    rest[rows, winners] = np.inf
    other = rest.min(axis=1) if classes > 1 else np.full(len(rows), np.inf)
    margins = np.where(winners >= 0, other - np.where(np.isfinite(own), own, 0), np.inf)
    return Votes(winners, own, margins)


def weigh(distances: np.ndarray, codes: np.ndarray, classes: int, weighing: Weighing) -> Votes:
    """The class with the highest score when every example has its say.

    Parameters
    ----------
    distances : (Q, N) float array
    codes : (N,) int array
        Class of each example, 0 to ``classes - 1``.
    classes : int
    weighing : Weighing
        Learned from these N examples.
    """
    nearest = class_minima(distances, codes, classes)
    order, found, leads = leading(weighing, distances, nearest)
    winners = np.where(found, order[:, 0], -1)
    own = np.where(found, nearest[np.arange(len(nearest)), order[:, 0]], np.inf)
    return Votes(winners, own, leads, order)


def votes_of(
    distances: np.ndarray, codes: np.ndarray, classes: int, k: int = 1, weighing: Weighing | None = None
) -> Votes:
    """What all examples say where they are weighed, otherwise the `vote` of the ``k`` nearest."""
    if weighing is not None:
        return weigh(distances, codes, classes, weighing)
    return vote(distances, codes, classes, k)


def speakers(distances: np.ndarray, codes: np.ndarray, votes: Votes, k: int = 1) -> list[np.ndarray]:
    """Examples to name beside each answer: the ``k`` nearest, nearest first.

    Where all examples were weighed, the nearest one of each of the three best classes, best class
    first. Examples at an infinite distance are left out.

    Returns
    -------
    list of Q int64 arrays
        Indices of examples.
    """
    if votes.order is None:
        near = k_nearest(distances, k)
        return [where[np.isfinite(row)] for row, where in zip(near.distances, near.indices, strict=True)]
    clean = np.where(np.isnan(distances), np.inf, distances).astype(np.float64)
    named = []
    for row, order in zip(clean, votes.order, strict=True):
        each = [np.where(codes == c, row, np.inf) for c in order[:_NAMED]]
        named.append(np.array([one.argmin() for one in each if np.isfinite(one).any()], np.int64))
    return named


def class_minima(distances: np.ndarray, codes: np.ndarray, classes: int) -> np.ndarray:
    """(Q, classes) distance to the nearest example of each class, infinity where there is none."""
    clean = np.where(np.isnan(distances), np.inf, distances)
    out = np.full((len(clean), classes), np.inf)
    for code in range(classes):
        members = codes == code
        if members.any():
            out[:, code] = clean[:, members].min(axis=1)
    return out
