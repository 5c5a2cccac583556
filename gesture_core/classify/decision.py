"""From rows of distances to predictions: the class that wins, and an honest reason where it gets no label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral

import numpy as np

from gesture_core.classify.comparison import is_still
from gesture_core.classify.examples import ExampleLibrary
from gesture_core.classify.learning import ExampleWeights
from gesture_core.errors import ConfigError
from gesture_core.records import Prediction
from gesture_core.types import Neighbors, Signals, Status

# Scores are sums in an order that a library's blocking may change; what is shown is rounded to hide it,
# and classes whose scores differ by less are equal.
_DECIMALS = 6
_EQUAL = 1e-9
# Classes whose nearest example is named beside an answer of weighted examples.
_NAMED = 3
# Share of frames with a repaired joint from which on a prediction says so.
_MANY = 0.1
# Status and message of a query that no example could be compared with.
_NOTHING_TO_COMPARE: Mapping[str, tuple[Status, str]] = {
    "E_NO_SALIENT": (
        "rejected",
        "nothing moves enough, and no example is that still; "
        "a person who stands still makes no gesture; try: an example of the posture, if it is a class",
    ),
    "E_NO_COMMON": (
        "error",
        "no example has a dimension in common with this input; "
        "try: examples in which the same joints are seen",
    ),
}


@dataclass(frozen=True, eq=False)
class Votes:
    """Which class wins each query, by the vote of its neighbours or by the weights of all examples.

    Attributes
    ----------
    winners : (Q,) int64
        Index into the classes; -1 where no example could be compared with the query.
    distances : (Q,) float
        To the nearest example of the winning class.
    margins : (Q,) float
        Distance to the nearest example of any other class minus ``distances``: infinite where no
        other class can be compared, negative where a vote of several neighbours overruled the
        nearest one. With weights, the lead of the winner's score over the next.
    order : (Q, C) int64, optional
        With weights, the classes, best first.
    """

    winners: np.ndarray
    distances: np.ndarray
    margins: np.ndarray
    order: np.ndarray | None = None


def votes_of(
    distances: np.ndarray, codes: np.ndarray, classes: int, k: int = 1, weights: ExampleWeights | None = None
) -> Votes:
    """The class with the highest score under ``weights``, or the majority of the ``k`` nearest examples.

    Of equal scores the class whose nearest example is nearer wins, then the first one. In a vote
    (Cover and Hart 1967) equal counts go to the class whose nearest example is nearer, then to the
    one whose nearest example comes first. Examples at an infinite distance have no vote, and NaN
    counts as infinity.

    Parameters
    ----------
    distances : (Q, N) float array
    codes : (N,) int array
        Class of each example, 0 to ``classes - 1``.
    classes, k : int
    weights : ExampleWeights, optional
        Learned from these N examples.
    """
    distances = np.where(np.isnan(distances), np.inf, distances)
    nearest: np.ndarray = np.full((len(distances), classes), np.inf)
    for code in range(classes):
        nearest[:, code] = distances[:, codes == code].min(axis=1, initial=np.inf)
    rows = np.arange(len(distances))
    if weights is not None:
        order, leads = _ranking(weights, distances, nearest)
        found = np.isfinite(nearest[rows, order[:, 0]])
        own = np.where(found, nearest[rows, order[:, 0]], np.inf)
        return Votes(np.where(found, order[:, 0], -1), own, leads, order)
    near = k_nearest(distances, k)
    winners = np.full(len(rows), -1, np.int64)
    for query, indices in enumerate(near.indices):
        voters = codes[indices[np.isfinite(near.distances[query])]]
        if len(voters):
            # Voters are ordered by distance, then index: of equal counts the first one's class wins.
            winners[query] = voters[np.bincount(voters)[voters].argmax()]
    found = winners >= 0
    own = np.where(found, nearest[rows, winners], np.inf)
    nearest[rows, winners] = np.inf
    margins = np.where(found, nearest.min(axis=1) - np.where(np.isfinite(own), own, 0), np.inf)
    return Votes(winners, own, margins)


def scores_of(
    distances: np.ndarray, codes: np.ndarray, classes: int, k: int = 1, weights: ExampleWeights | None = None
) -> np.ndarray:
    """(Q, C) score of each class, the highest that of the winner of `votes_of`; its arguments are those.

    With ``weights``, the sum of what all examples add: about 1 for the right class and 0 for others.
    Of the nearest example alone, minus the distance to the nearest one of each class. Of several, the
    votes of a class, less d / (1 + d) of that distance. Minus infinity where no example of a class can
    be compared with the query.
    """
    clean = np.where(np.isnan(distances), np.inf, distances)
    nearest: np.ndarray = np.full((len(clean), classes), np.inf)
    for code in range(classes):
        nearest[:, code] = clean[:, codes == code].min(axis=1, initial=np.inf)
    there = np.isfinite(nearest)
    if weights is not None:
        scores, factors = weights.scores(clean)
        return np.where(there, scores * factors[:, None], -np.inf)
    if k == 1:
        return -nearest
    near, near_by = k_nearest(clean, k), np.where(there, nearest, 0.0)
    votes = np.zeros(nearest.shape)
    for query, indices in enumerate(near.indices):
        voters = codes[indices[np.isfinite(near.distances[query])]]
        votes[query] = np.bincount(voters, minlength=classes)
    return np.where(there, votes - near_by / (1 + np.abs(near_by)), -np.inf)


def _ranking(
    weights: ExampleWeights, distances: np.ndarray, nearest: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The (Q, C) classes of each query, best first, and the (Q,) lead of the first one's score.

    ``nearest`` is the (Q, C) distance to the nearest example of each class; classes at infinity take
    no part and come last. The lead is infinite where there is no second class.
    """
    scores, factors = weights.scores(distances)
    there = np.isfinite(nearest)
    scores = np.where(there, scores, -np.inf)
    best = np.where(there, np.abs(scores), 0).max(axis=1, initial=0.0)
    steps = np.round(scores / (np.where(best > 0, best, 1.0)[:, None] * _EQUAL))
    classes = np.broadcast_to(np.arange(scores.shape[1]), scores.shape)
    order = np.lexsort((classes, nearest, -steps), axis=1).astype(np.int64)
    leads: np.ndarray = np.full(len(scores), np.inf)
    if scores.shape[1] > 1:
        second = np.flatnonzero(there.sum(axis=1) > 1)
        lead = scores[second, order[second, 0]] - scores[second, order[second, 1]]
        leads[second] = np.round(np.maximum(lead, 0.0) * factors[second], _DECIMALS)
    return order, leads


def k_nearest(distances: np.ndarray, k: int = 1) -> Neighbors:
    """The ``k`` smallest entries of each row of (Q, N) ``distances``, nearest first.

    Ties go to the lower index. NaN counts as infinity, so that it never wins.

    Raises
    ------
    ConfigError
        Where ``k`` is no whole number between 1 and the number of examples.
    """
    distances = np.asarray(distances, np.float64)
    if not isinstance(k, Integral) or not 1 <= k <= distances.shape[1]:
        raise ConfigError(
            f"{k} neighbours were asked for and there are {distances.shape[1]} examples",
            remedy=f"classify.neighbors between 1 and {distances.shape[1]}",
            code="E_NEIGHBORS",
        )
    clean = np.where(np.isnan(distances), np.inf, distances)
    order = np.argsort(clean, axis=1, kind="stable")[:, :k]
    return Neighbors(np.take_along_axis(clean, order, axis=1), order.astype(np.int64))


def named_examples(distances: np.ndarray, codes: np.ndarray, votes: Votes, k: int = 1) -> list[np.ndarray]:
    """Indices of the examples to name beside each answer: the ``k`` nearest, nearest first.

    With weights, the nearest one of each of the three best classes, best class first. Examples at an
    infinite distance are left out.
    """
    named = []
    if votes.order is None:
        near = k_nearest(distances, k)
        for row, indices in zip(near.distances, near.indices, strict=True):
            named.append(indices[np.isfinite(row)])
        return named
    clean = np.where(np.isnan(distances), np.inf, distances)
    for row, order in zip(clean, votes.order, strict=True):
        each = np.where(codes == order[:_NAMED, None], row, np.inf)
        named.append(each.argmin(axis=1)[np.isfinite(each).any(axis=1)])
    return named


def refusals(
    votes: Votes,
    thresholds: np.ndarray | None = None,
    margin: float | None = None,
    still: Sequence[bool] | np.ndarray | None = None,
) -> list[str]:
    """Why each query gets no label: the code of the reason, empty where it gets one.

    E_REJECTED where the distance is above its class's value in the (C,) ``thresholds``, E_UNSURE where
    the margin is below ``margin``. Where no example could be compared, E_NO_SALIENT of a query that
    is ``still``, in which nothing moves, and E_NO_COMMON of any other.
    """
    codes = []
    rows = zip(votes.winners, votes.distances, votes.margins, strict=True)
    for index, (winner, distance, lead) in enumerate(rows):
        if winner < 0:
            codes.append("E_NO_SALIENT" if still is not None and still[index] else "E_NO_COMMON")
        elif thresholds is not None and not distance <= thresholds[winner]:
            codes.append("E_REJECTED")
        else:
            codes.append("E_UNSURE" if margin is not None and lead < margin else "")
    return codes


def decide(
    distances: np.ndarray,
    queries: Sequence[Signals | np.ndarray],
    library: ExampleLibrary,
    k: int = 1,
    thresholds: np.ndarray | None = None,
    weights: ExampleWeights | None = None,
    margin: float | None = None,
) -> list[Prediction]:
    """One `Prediction` for each query, from the (Q, N) ``distances`` to the examples of ``library``.

    ``k`` and ``weights`` are those of `votes_of`, ``thresholds`` and ``margin`` those of `refusals`.
    """
    votes = votes_of(distances, library.codes, len(library.classes), k, weights)
    codes = refusals(votes, thresholds, margin, [is_still(query) for query in queries])
    predictions = []
    for index, named in enumerate(named_examples(distances, library.codes, votes, k)):
        query, code, winner = queries[index], codes[index], votes.winners[index]
        selected, note = (query.selected, _note(query)) if isinstance(query, Signals) else ((), "")
        if code in _NOTHING_TO_COMPARE:
            status, message = _NOTHING_TO_COMPARE[code]
            predictions.append(
                Prediction(None, status, selected=selected, code=code, message=message, note=note)
            )
            continue
        label, distance, lead = str(library.classes[winner]), votes.distances[index], votes.margins[index]
        neighbors = tuple(
            (library.names[i], str(library.labels[i]), float(distances[index, i])) for i in named
        )
        message = ""
        if code == "E_REJECTED" and thresholds is not None:
            limit = thresholds[winner]
            message = f"{label} at best, whose nearest example is at {distance:.4g}, above {limit:.4g}"
        elif code == "E_UNSURE":
            rival = next((f" before {other}" for _, other, _ in neighbors if other != label), "")
            message = (
                f"{label}{rival} by a margin of {lead:.4g}, below {margin:.4g}; "
                "try: more examples of both, or a lower --set classify.margin=…"
            )
        predictions.append(
            Prediction(
                None if code else label,
                "rejected" if code else "ok",
                float(distance),
                float(lead) if np.isfinite(lead) else None,
                neighbors,
                selected,
                code,
                message,
                note,
            )
        )
    return predictions


def _note(query: Signals) -> str:
    """What is worth knowing of the keypoints behind a query."""
    if query.repaired < _MANY:
        return ""
    return f"joints that jumped, or left and right, were repaired in {query.repaired:.0%} of the frames"
