"""From a row of distances to a `Prediction`: the label, or an honest reason why not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.classify.comparison import is_still
from gesture_core.classify.library import ExampleLibrary
from gesture_core.classify.neighbors import Votes, k_nearest, vote
from gesture_core.types import Prediction, Signals


def decide(
    distances: np.ndarray,
    queries: Sequence[Signals | np.ndarray],
    library: ExampleLibrary,
    k: int = 1,
    thresholds: np.ndarray | None = None,
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
        Neighbours that vote.
    thresholds : (C,) float array, optional
        Largest distance at which each class lends its label.
    """
    near = k_nearest(distances, k)
    classes = library.classes
    votes = vote(distances, library.codes, len(classes), k)
    return [
        _prediction(
            index,
            votes,
            classes,
            None if thresholds is None else np.asarray(thresholds),
            tuple(
                (library.names[i], str(library.labels[i]), float(d))
                for d, i in zip(near.distances[index], near.indices[index], strict=True)
                if np.isfinite(d)
            ),
            query.selected if isinstance(query, Signals) else (),
            is_still(query),
        )
        for index, query in enumerate(queries)
    ]


def _prediction(
    index: int,
    votes: Votes,
    classes: np.ndarray,
    thresholds: np.ndarray | None,
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
    if thresholds is not None and not distance <= thresholds[winner]:
        return Prediction(
            None,
            "rejected",
            distance,
            code="E_REJECTED",
            message=f"nearest class {label} at {distance:.4g}, above its threshold {thresholds[winner]:.4g}",
            **known,  # type: ignore[arg-type]
        )
    return Prediction(label, "ok", distance, **known)  # type: ignore[arg-type]
