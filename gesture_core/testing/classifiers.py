"""The suite of classifiers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from gesture_core.errors import GestureError
from gesture_core.plugin.interfaces import Classifier
from gesture_core.testing.answers import ask
from gesture_core.testing.signals import draw_signals
from gesture_core.types import Signals

_CLASSES = 3


def _problem(classifier: Classifier, seed: int = 0) -> tuple[list[Signals], np.ndarray, np.ndarray]:
    """Signals of three classes, their codes, and the distances among them, of which one is infinite."""
    rng = np.random.default_rng(seed)
    codes = np.repeat(np.arange(_CLASSES), max(4, classifier.least))
    kinds = [draw_signals(10 * seed + code, 30) for code in range(_CLASSES)]
    series = []
    for code in codes:
        noise = rng.normal(scale=0.1, size=kinds[code].values.shape)
        series.append(replace(kinds[code], values=kinds[code].values + noise))
    flat = np.array([item.values.reshape(-1) for item in series], np.float64)
    distances = np.linalg.norm(flat[:, None] - flat[None], axis=2)
    distances[0, 1] = distances[1, 0] = np.inf
    return series, codes, distances


def _fitted(
    classifier: Classifier, series: list[Signals], codes: np.ndarray, distances: np.ndarray
) -> Mapping[str, Any]:
    given = distances if classifier.compares else None
    state: Mapping[str, Any] = ask(classifier.fit, series, codes, _CLASSES, given, np.arange(len(codes)))
    return state


def check_classifier_state(classifier: Classifier) -> None:
    """It says what it needs, and learns plain arrays: numbers or texts, which a file can hold."""
    name = type(classifier).__name__
    assert isinstance(classifier, Classifier), f"{name} lacks fit, scores, least or compares"
    assert isinstance(classifier.least, int) and classifier.least >= 1, f"{name}.least is no whole number"
    assert isinstance(classifier.compares, bool), f"{name}.compares is neither True nor False"
    state = _fitted(classifier, *_problem(classifier))
    assert isinstance(state, Mapping), f"{name}.fit returns {type(state).__name__}, expected a mapping"
    for key, value in state.items():
        kind = np.asarray(value).dtype.kind
        assert isinstance(key, str) and kind in "biufU", (
            f"{name}.fit returns {key!r} of type {np.asarray(value).dtype}; a file holds numbers and texts"
        )


def check_classifier_answer(classifier: Classifier) -> None:
    """(Q, C) finite scores, highest for the own class of what it has learned."""
    name = type(classifier).__name__
    series, codes, distances = _problem(classifier)
    state = _fitted(classifier, series, codes, distances)
    scores = np.asarray(ask(classifier.scores, state, series, distances))
    wanted = (len(series), _CLASSES)
    assert scores.shape == wanted, (
        f"{name}.scores returns the shape {scores.shape}, expected (Q, C): {wanted}"
    )
    assert np.isfinite(scores).all(), f"{name}.scores are not all finite"
    right = float((scores.argmax(axis=1) == codes).mean())
    assert right > 0.9, f"{name} gives {right:.0%} of its own examples, three plain classes, their label"


def check_classifier_rows(classifier: Classifier) -> None:
    """The bits of a row depend on no other row, and a second fit learns the same; what is passed in stays."""
    name = type(classifier).__name__
    series, codes, distances = _problem(classifier)
    before = distances.copy()
    state = _fitted(classifier, series, codes, distances)
    together = np.asarray(ask(classifier.scores, state, series, distances))
    other, more, apart = _problem(classifier, 1)
    _fitted(classifier, other, more, apart)
    for row in (0, len(series) - 1):
        alone = np.asarray(ask(classifier.scores, state, series[row : row + 1], distances[row : row + 1]))
        assert np.array_equal(alone[0], together[row]), (
            f"{name}.scores of a query depend on the others of its batch, or on what was fitted in between"
        )
    again = np.asarray(
        ask(classifier.scores, _fitted(classifier, series, codes, distances), series, distances)
    )
    assert np.array_equal(again, together), f"{name} learns something else from the same examples"
    assert np.array_equal(before, distances), f"{name} changes the distances that it was given"


def check_classifier_odd(classifier: Classifier) -> None:
    """A class without examples, and a query that nothing can be compared with: scores or a GestureError."""
    name = type(classifier).__name__
    series, codes, distances = _problem(classifier)
    kept = np.flatnonzero(codes != 1)
    some, own = [series[i] for i in kept], distances[np.ix_(kept, kept)]
    try:
        state = classifier.fit(
            some, codes[kept], _CLASSES, own if classifier.compares else None, np.arange(len(kept))
        )
        scores = np.asarray(classifier.scores(state, some[:2], np.full((2, len(kept)), np.inf)))
    except GestureError:
        return
    except Exception as error:
        raise AssertionError(
            f"{name} without examples of a class raises {type(error).__name__}: {error}"
        ) from error
    assert scores.shape == (2, _CLASSES) and np.isfinite(scores).all(), (
        f"{name}.scores of what cannot be compared with anything are {scores[0]}; finite ones are expected"
    )


CLASSIFIER_CHECKS: tuple[Callable[[Classifier], None], ...] = (
    check_classifier_state,
    check_classifier_answer,
    check_classifier_rows,
    check_classifier_odd,
)
"""The suite of classifiers."""
