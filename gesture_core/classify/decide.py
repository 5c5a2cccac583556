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
    codes = refusals(votes, thresholds, margin)
    named = speakers(distances, library.codes, votes, k)
    return [
        _prediction(
            index,
            votes,
            classes,
            _wanting(codes[index], int(votes.winners[index]), thresholds, margin),
            tuple(
                (library.names[i], str(library.labels[i]), float(distances[index, i])) for i in named[index]
            ),
            query.selected if isinstance(query, Signals) else (),
            is_still(query),
        )
        for index, query in enumerate(queries)
    ]


def _wanting(
    code: str, winner: int, thresholds: np.ndarray | None, margin: float | None
) -> tuple[str, float] | None:
    """Why a winner gives no label: the code, and the limit that was not met."""
    if code == "E_REJECTED" and thresholds is not None:
        return code, float(thresholds[winner])
    if code == "E_UNSURE" and margin is not None:
        return code, margin
    return None


def _prediction(
    index: int,
    votes: Votes,
    classes: np.ndarray,
    wanting: tuple[str, float] | None,
    neighbors: tuple[tuple[str, str, float], ...],
    selected: tuple[str, ...],
    still: bool,
) -> Prediction:
    winner = int(votes.winners[index])
    if winner < 0 and still:
        return Prediction(
            None,
            "rejected",
            code="E_NO_SALIENT",
            message="nothing moves enough, and no example is that still; "
            "a person who stands still makes no gesture; try: an example of the posture, if it is a class",
        )
    if winner < 0:
        return Prediction(
            None,
            "error",
            selected=selected,
            code="E_NO_COMMON",
            message="no example has a dimension in common with this input; "
            "try: examples in which the same joints are seen",
        )
    label, distance = str(classes[winner]), float(votes.distances[index])
    margin = float(votes.margins[index])
    known = {"margin": margin if np.isfinite(margin) else None, "neighbors": neighbors, "selected": selected}
    if wanting is not None:
        code, limit = wanting
        message = f"{label} at best, whose nearest example is at {distance:.4g}, above {limit:.4g}"
        if code == "E_UNSURE":
            rival = next((f" before {other}" for _, other, _ in neighbors if other != label), "")
            message = (
                f"{label}{rival} by a margin of {margin:.4g}, below {limit:.4g}; "
                "try: more examples of both, or a lower classify.margin"
            )
        return Prediction(None, "rejected", distance, code=code, message=message, **known)  # type: ignore[arg-type]
    return Prediction(label, "ok", distance, **known)  # type: ignore[arg-type]
