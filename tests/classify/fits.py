"""Classifiers that have learned from codes and distances alone, for tests of the decision."""

from __future__ import annotations

import numpy as np

from gesture_core.classify.classifiers import Fitted
from gesture_core.settings import load_settings


def by_votes(codes: np.ndarray, classes: int, k: int = 1) -> Fitted:
    """The ``k`` nearest of examples with these codes vote."""
    settings = load_settings("paper", [f"neighbors={k}"], environment={})
    return Fitted.fit(settings, (), codes, classes, None)


def by_weights(within: np.ndarray, codes: np.ndarray) -> Fitted:
    """All examples decide, with the distances ``within`` among them."""
    settings = load_settings("paper", ["classifier=weighed"], environment={})
    return Fitted.fit(settings, (), codes, int(codes.max()) + 1, within)
