"""From a row of distances to a `Prediction`: the label, or an honest reason why not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.classify.comparison import is_still
from gesture_core.classify.library import ExampleLibrary
from gesture_core.classify.neighbors import Votes, speakers, votes_of
from gesture_core.classify.rejection import refusals
from gesture_core.classify.weighing import Weighing
from gesture_core.types import Prediction, Signals


def decide(
    distances: np.ndarray,
    queries: Sequence[Signals | np.ndarray],
    library: ExampleLibrary,
    k: int = 1,
    thresholds: np.ndarray | None = None,
    weighing: Weighing | None = None,
    margin: float | None = None,
) -> list[Prediction]:
    """One `Prediction` for each query.

    Parameters
    ----------
    distances : (Q, N) float array
        Queries against the examples of ``library``.
    queries : sequence of Q Signals or arrays
        For the names of the selected channels.
    library : ExampleLibrary
    k : int
        Neighbours that vote, without ``weighing``.
    thresholds : (C,) float array, optional
        Largest distance at which each class lends its label.
    weighing : Weighing, optional
        What each example says; then all of them decide.
    margin : float, optional
        Smallest margin of a label.
    """
    classes = library.classes
    votes = votes_of(distances, library.codes, len(classes), k, weighing)
    codes = refusals(votes, thresholds, margin, [is_still(query) for query in queries])
    named = speakers(distances, library.codes, votes, k)
    return [
        _prediction(
            index,
            votes,
            classes,
            codes[index],
            _limit(codes[index], int(votes.winners[index]), thresholds, margin),
            tuple(
                (library.names[i], str(library.labels[i]), float(distances[index, i])) for i in named[index]
            ),
            query.selected if isinstance(query, Signals) else (),
        )
        for index, query in enumerate(queries)
    ]


def _limit(code: str, winner: int, thresholds: np.ndarray | None, margin: float | None) -> float:
    """The limit that a winner without a label did not meet."""
    if code == "E_REJECTED" and thresholds is not None:
        return float(thresholds[winner])
    return margin if code == "E_UNSURE" and margin is not None else 0.0


def _prediction(
    index: int,
    votes: Votes,
    classes: np.ndarray,
    code: str,
    limit: float,
    neighbors: tuple[tuple[str, str, float], ...],
    selected: tuple[str, ...],
) -> Prediction:
    winner = int(votes.winners[index])
    if code == "E_NO_SALIENT":
        return Prediction(
            None,
            "rejected",
            code=code,
            message="nothing moves enough, and no example is that still; "
            "a person who stands still makes no gesture; try: an example of the posture, if it is a class",
        )
    if code == "E_NO_COMMON":
        return Prediction(
            None,
            "error",
            selected=selected,
            code=code,
            message="no example has a dimension in common with this input; "
            "try: examples in which the same joints are seen",
        )
    label, distance = str(classes[winner]), float(votes.distances[index])
    margin = float(votes.margins[index])
    known = {"margin": margin if np.isfinite(margin) else None, "neighbors": neighbors, "selected": selected}
    if code:
        message = f"{label} at best, whose nearest example is at {distance:.4g}, above {limit:.4g}"
        if code == "E_UNSURE":
            rival = next((f" before {other}" for _, other, _ in neighbors if other != label), "")
            message = (
                f"{label}{rival} by a margin of {margin:.4g}, below {limit:.4g}; "
                "try: more examples of both, or a lower classify.margin"
            )
        return Prediction(None, "rejected", distance, code=code, message=message, **known)  # type: ignore[arg-type]
    return Prediction(label, "ok", distance, **known)  # type: ignore[arg-type]
