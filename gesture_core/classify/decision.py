"""From rows of distances to predictions: the class that wins, and an honest reason where it gets no label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral

import numpy as np

from gesture_core.classify.classifiers import Fitted, left_out, nearest_of
from gesture_core.classify.comparison import is_still
from gesture_core.classify.examples import ExampleLibrary
from gesture_core.errors import ConfigError, InputError
from gesture_core.plugin.registry import calling
from gesture_core.records import Prediction
from gesture_core.settings import ClassifySettings
from gesture_core.types import Neighbors, Signals, Status

# Scores are sums in an order that a library's blocking may change; what is shown is rounded to hide it,
# and classes whose scores differ by less are equal.
_DECIMALS = 6
_EQUAL = 1e-9
# Classes whose nearest example is named beside an answer of weighted examples.
_NAMED = 3
_GRID = np.geomspace(1e-3, 1e3, 181)
"""Temperatures that are tried, in units of the usual lead of the best score."""
_LEAST = 1e-12
_NOTHING = ClassifySettings()
"""No limit at all."""
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
    """Which class wins each query, by the scores of a classifier or by the vote of the nearest examples.

    Attributes
    ----------
    winners : (Q,) int64
        Index into the classes; -1 where no example could be compared with the query.
    distances : (Q,) float
        To the nearest example of the winning class.
    margins : (Q,) float
        The lead of the winner's score over the next. Where neighbours vote, the distance to the nearest
        example of any other class minus ``distances``: negative where a vote of several overruled the
        nearest one. Infinite where no other class can be compared.
    order : (Q, C) int64
        The classes, best first; those that cannot be compared come last.
    scores : (Q, C) float
        Of each class, as its classifier gives them, highest for the winner. Minus infinity where no example
        of a class can be compared with the query.
    chances : (Q,) float, optional
        Probability that the winner is right, if the query is one of the classes at all.
    """

    winners: np.ndarray
    distances: np.ndarray
    margins: np.ndarray
    order: np.ndarray
    scores: np.ndarray
    chances: np.ndarray | None = None


def votes_of(fitted: Fitted, distances: np.ndarray, queries: Sequence[Signals | np.ndarray] = ()) -> Votes:
    """The class with the highest score, or the majority of the nearest examples.

    What is equal goes to the class whose nearest example is nearer, then to the one whose nearest example
    comes first. Examples at an infinite distance have no vote, and NaN counts as infinity.

    Parameters
    ----------
    fitted : Fitted
    distances : (Q, M) float array
        To the examples that it compares queries with.
    queries : sequence of Q Signals or (T, D) arrays, optional
        Where its classifier looks at them.
    """
    distances = np.where(np.isnan(distances), np.inf, distances)
    nearest, firsts = nearest_of(distances, fitted.codes, fitted.classes)
    rows, there = np.arange(len(distances)), np.isfinite(nearest)
    scores, ranks = fitted.ordered(queries, distances)
    most = np.where(there, np.abs(ranks), 0).max(axis=1, initial=0.0)
    steps = np.round(ranks / (np.where(most > 0, most, 1.0)[:, None] * _EQUAL))
    order = np.lexsort((firsts, nearest, -np.where(there, steps, -np.inf)), axis=1)
    best = order[:, 0]
    found = there[rows, best]
    own = np.where(found, nearest[rows, best], np.inf)
    margins: np.ndarray = np.full(len(rows), np.inf)
    second = np.flatnonzero(there.sum(axis=1) > 1)
    if fitted.votes:
        others = nearest.copy()
        others[rows, best] = np.inf
        margins[second] = others[second].min(axis=1, initial=np.inf) - own[second]
    else:
        lead = scores[second, best[second]] - scores[second, order[second, 1:2].reshape(-1)]
        margins[second] = np.round(np.maximum(lead, 0.0), _DECIMALS)
    scores = np.where(there, scores, -np.inf)
    heat = fitted.temperature
    chances = None if heat is None else probabilities(scores, heat)[rows, best]
    return Votes(np.where(found, best, -1), own, margins, order, scores, chances)


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


def named_examples(distances: np.ndarray, codes: np.ndarray, votes: Votes, k: int) -> list[np.ndarray]:
    """Indices of the examples to name beside each answer: the ``k`` nearest, nearest first.

    Where all of them decide (0), the nearest one of each of the three best classes, best class first.
    Examples at an infinite distance are left out.
    """
    clean = np.where(np.isnan(distances), np.inf, distances)
    named = []
    for row, order in zip(clean, votes.order, strict=True):
        if k > 0:
            own = np.argsort(row, kind="stable")[:k]
        else:
            own = np.where(codes == order[:_NAMED, None], row, np.inf).argmin(axis=1)
            own = own[codes[own] == order[:_NAMED]]
        named.append(own[np.isfinite(row[own])])
    return named


def refusals(
    votes: Votes,
    thresholds: np.ndarray | None = None,
    asked: ClassifySettings = _NOTHING,
    still: Sequence[bool] | np.ndarray | None = None,
) -> list[str]:
    """Why each query gets no label: the code of the reason, empty where it gets one.

    E_REJECTED where the distance is above its class's value in the (C,) ``thresholds``, or the score below
    what is ``asked``; E_UNSURE where the margin or the probability is. Where no example could be compared,
    E_NO_SALIENT of a query that is ``still``, in which nothing moves, and E_NO_COMMON of any other.
    """
    codes, least = [], -np.inf if asked.min_score is None else asked.min_score
    rows = zip(votes.winners, votes.distances, votes.margins, strict=True)
    for index, (winner, distance, lead) in enumerate(rows):
        if winner < 0:
            codes.append("E_NO_SALIENT" if still is not None and still[index] else "E_NO_COMMON")
        elif (thresholds is not None and not distance <= thresholds[winner]) or (
            votes.scores[index, winner] < least
        ):
            codes.append("E_REJECTED")
        else:
            unsure = asked.margin is not None and lead < asked.margin
            if asked.confidence is not None and votes.chances is not None:
                unsure = unsure or bool(votes.chances[index] < asked.confidence)
            codes.append("E_UNSURE" if unsure else "")
    return codes


def decide(
    distances: np.ndarray,
    queries: Sequence[Signals | np.ndarray],
    library: ExampleLibrary,
    fitted: Fitted,
    thresholds: np.ndarray | None = None,
    asked: ClassifySettings = _NOTHING,
) -> list[Prediction]:
    """One `Prediction` for each query, from the (Q, N) ``distances`` to the examples of ``library``.

    ``fitted`` has learned from them; the thresholds, and what is ``asked``, are those of `refusals`.
    """
    votes = votes_of(fitted, distances, queries)
    codes = refusals(votes, thresholds, asked, list(map(is_still, queries)))
    margin, confidence = asked.margin, asked.confidence
    predictions = []
    shown = named_examples(distances, library.codes, votes, fitted.votes)
    for index, named in enumerate(shown):
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
        message, score = "", votes.scores[index, winner]
        if code == "E_REJECTED" and thresholds is not None and not distance <= thresholds[winner]:
            limit = thresholds[winner]
            message = f"{label} at best, whose nearest example is at {distance:.4g}, above {limit:.4g}"
        elif code == "E_REJECTED":
            message = (
                f"{label} at best, with a score of {score:.4g}, below {asked.min_score:.4g}; "
                "try: more examples of it, or a lower --set classify.min_score=…"
            )
        elif code == "E_UNSURE":
            rival = next((f" before {other}" for _, other, _ in neighbors if other != label), "")
            by, value, limit, name = "by a margin of", lead, margin, "margin"
            if votes.chances is not None and (margin is None or lead >= margin):
                by, value, limit, name = (
                    "with a probability of",
                    votes.chances[index],
                    confidence,
                    "confidence",
                )
            message = (
                f"{label}{rival} {by} {value:.4g}, below {limit:.4g}; "
                f"try: more examples of both, or a lower --set classify.{name}=…"
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
                None if votes.chances is None else round(float(votes.chances[index]), _DECIMALS),
                None if asked.min_score is None else float(score),
            )
        )
    return predictions


def _note(query: Signals) -> str:
    """What is worth knowing of the keypoints or readings behind a query."""
    if query.apart:
        return f"readings far from all others of their channel, left out: {query.apart} (signals.repair)"
    if query.repaired < _MANY:
        return ""
    return f"joints that jumped, or left and right, were repaired in {query.repaired:.0%} of the frames"


def probabilities(scores: np.ndarray, temperature: float) -> np.ndarray:
    """(Q, C) shares that add up to 1 in each row; equal ones where no class has a finite score."""
    best = scores.max(axis=1, keepdims=True)
    scaled = np.where(np.isfinite(best), scores - np.where(np.isfinite(best), best, 0.0), 0.0) / temperature
    powers = np.exp(scaled)
    shares: np.ndarray = powers / powers.sum(axis=1, keepdims=True)
    return shares


def temperature_of(fitted: Fitted, within: np.ndarray, series: Sequence[Signals | np.ndarray] = ()) -> float:
    """What divides scores to make them probabilities, from the (N, N) distances among the examples.

    That temperature under which the softmax gives the examples the probabilities that they deserve (Guo et
    al. 2017), when each is decided by the others. So that few examples which are all right do not make a
    certainty, the targets are those of Platt (1999): (N + 1) / (N + 2) instead of 1. ``series`` are the
    examples that ``fitted`` compares queries with.

    Raises
    ------
    InputError
        E_EXAMPLES where no class has two examples: one that is left out leaves nothing of its class.
    """
    codes, classes = fitted.codes, fitted.classes
    told = np.flatnonzero(np.bincount(codes, minlength=classes)[codes] > 1)
    if len(told) == 0:
        raise InputError(
            "probabilities cannot be calibrated: no class has two examples that queries are compared with",
            remedy="two examples of a class at least, no classify.representative, a larger "
            "classify.landmarks, or classify.margin; decision_function",
            code="E_EXAMPLES",
        )
    with calling(fitted.classifier):
        scores = left_out(fitted.classifier, series, codes, classes, within)[told]
    truth = codes[told]
    ordered = np.sort(scores, axis=1)[:, -2:] if classes > 1 else np.zeros((len(told), 2))
    leads = (ordered[:, 1] - ordered[:, 0])[np.isfinite(ordered).all(axis=1)]
    unit = float(np.median(leads)) if len(leads) and np.median(leads) > 0 else 1.0
    smooth = 1 / (len(told) + 2)
    targets = np.full(scores.shape, smooth / max(classes - 1, 1))
    targets[np.arange(len(told)), truth] = 1 - smooth
    losses = []
    for factor in _GRID:
        shares = np.maximum(probabilities(scores, factor * unit), _LEAST)
        losses.append(-(targets * np.log(shares)).sum())
    return float(_GRID[int(np.argmin(losses))] * unit)
