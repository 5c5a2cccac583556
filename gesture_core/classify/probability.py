"""Scores of classes as probabilities: one temperature, from examples that are left out in turn.

The scores are divided by the temperature under which the softmax gives the examples the probabilities
that they deserve (Guo et al. 2017), when each is decided by the others. So that few examples which are
all right do not make a certainty, the targets are those of Platt (1999): (N + 1) / (N + 2) instead of 1.
"""

from __future__ import annotations

import numpy as np

from gesture_core.classify.decision import scores_of
from gesture_core.classify.learning import learn_weights
from gesture_core.errors import InputError
from gesture_core.settings import ClassifySettings

_GRID = np.geomspace(1e-3, 1e3, 181)
"""Temperatures that are tried, in units of the usual lead of the best score."""
_MOST = 200
"""Times that examples are left out; of more examples, several are left out together."""
_LEAST = 1e-12


def probabilities(scores: np.ndarray, temperature: float) -> np.ndarray:
    """(Q, C) shares that add up to 1 in each row; equal ones where no class has a finite score."""
    best = scores.max(axis=1, keepdims=True)
    scaled = np.where(np.isfinite(best), scores - np.where(np.isfinite(best), best, 0.0), 0.0) / temperature
    powers = np.exp(scaled)
    shares: np.ndarray = powers / powers.sum(axis=1, keepdims=True)
    return shares


def temperature_of(within: np.ndarray, codes: np.ndarray, classes: int, chosen: ClassifySettings) -> float:
    """The temperature from the (N, N) distances among examples of the given (N,) codes.

    Raises
    ------
    InputError
        E_EXAMPLES where no class has two examples: one that is left out leaves nothing of its class.
    """
    count = len(codes)
    told = np.flatnonzero(np.bincount(codes, minlength=classes)[codes] > 1)
    if len(told) == 0:
        raise InputError(
            "probabilities cannot be calibrated: no class has two examples",
            remedy="two examples of a class at least, or decision_function",
            code="E_EXAMPLES",
        )
    scores: np.ndarray = np.full((count, classes), -np.inf)
    for start in range(min(count, _MOST)):
        out = np.arange(start, count, _MOST)
        rest = np.delete(np.arange(count), out)
        weights = None
        if chosen.neighbors == 0:
            among = within[np.ix_(rest, rest)]
            weights = learn_weights(among, codes[rest], classes, chosen.sharpness, chosen.shrinkage)
        k = min(max(chosen.neighbors, 1), len(rest))
        scores[out] = scores_of(within[np.ix_(out, rest)], codes[rest], classes, k, weights)
    scores, truth = scores[told], codes[told]
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
