"""What an evaluation gave: answers, accuracy and its interval, confusion, curves of what rejection costs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gesture_core.settings import Settings

_DRAWN = 1000
"""Outcomes that are drawn of exact probabilities."""


@dataclass(frozen=True)
class Answer:
    """One tested sequence: what it is, what it was taken for, and how sure that was.

    ``confidence`` is the probability of the label, NaN where none is known; ``score`` is that of its class,
    NaN where the nearest examples vote.
    """

    name: str
    label: str
    subject: str
    fold: str
    predicted: str | None
    distance: float
    margin: float
    threshold: float = np.inf
    code: str = ""
    confidence: float = np.nan
    score: float = np.nan

    @property
    def right(self) -> bool:
        """Whether the label was found and not rejected."""
        return self.predicted == self.label


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The result of one protocol under one preset.

    Attributes
    ----------
    answers : list of Answer
        One for each tested sequence and fold.
    protocol : str
    settings : Settings
    changes : mapping
        Values of a grid, where there was one.
    """

    answers: list[Answer]
    protocol: str
    settings: Settings
    changes: dict[str, Any] = field(default_factory=dict)

    @property
    def accuracy(self) -> float:
        """Share of answers that are right."""
        return float(np.mean([answer.right for answer in self.answers]))

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the accuracy (Wilson 1927), as if the answers were independent."""
        return wilson(sum(answer.right for answer in self.answers), len(self.answers))

    @property
    def by_fold(self) -> dict[str, float]:
        """Accuracy in each fold."""
        names = dict.fromkeys(answer.fold for answer in self.answers)
        return {n: float(np.mean([a.right for a in self.answers if a.fold == n])) for n in names}

    @property
    def classes(self) -> list[str]:
        """The labels, sorted."""
        return sorted({answer.label for answer in self.answers})

    @property
    def recall(self) -> dict[str, float]:
        """Share of each class that was found."""
        return {
            label: float(np.mean([a.right for a in self.answers if a.label == label]))
            for label in self.classes
        }

    def confusion(self) -> tuple[list[str], np.ndarray]:
        """Names of the columns and the (C, C or more) counts.

        The classes come first, then what was answered but never tested, then "(none)" if any was not
        recognised; in more brackets where a class is called so.
        """
        others = {answer.predicted for answer in self.answers if answer.predicted is not None}
        columns = [*self.classes, *sorted(others - {*self.classes})]
        places = {name: place for place, name in enumerate(columns)}
        if any(answer.predicted is None for answer in self.answers):
            none = "(none)"
            while none in places:
                none = f"({none})"
            columns.append(none)
        counts = np.zeros((len(self.classes), len(columns)), np.int64)
        for answer in self.answers:
            column = -1 if answer.predicted is None else places[answer.predicted]
            counts[places[answer.label], column] += 1
        return columns, counts

    def rejection_curve(self) -> list[tuple[float, float, float]]:
        """(threshold, coverage, accuracy of what is left), from the loosest to the strictest."""
        return self._curve(np.array([a.distance for a in self.answers]), 1.0)

    def margin_curve(self) -> list[tuple[float, float, float]]:
        """(smallest margin, coverage, accuracy of what is left), from the loosest to the strictest."""
        return self._curve(np.array([a.margin for a in self.answers]), -1.0)

    def score_curve(self) -> list[tuple[float, float, float]]:
        """(smallest score, coverage, accuracy of what is left), from the loosest to the strictest."""
        return self._curve(np.array([a.score for a in self.answers]), -1.0)

    def confidence_curve(self) -> list[tuple[float, float, float]]:
        """(smallest probability, coverage, accuracy of what is left), from the loosest to the strictest."""
        return self._curve(np.array([a.confidence for a in self.answers]), -1.0)

    def confidence_for(self, accuracy: float) -> tuple[float, float, float] | None:
        """The loosest point of `confidence_curve` of at least this accuracy; None without one."""
        points = self.confidence_curve()
        return next((point for point in points if point[2] >= accuracy), None)

    @property
    def calibration_error(self) -> float | None:
        """Expected calibration error of the probabilities of the labels, in ten bins (Guo et al. 2017).

        None where no label has a probability. Few answers make it larger than it is; see `exact_error`.
        """
        known = [a for a in self.answers if a.predicted is not None and np.isfinite(a.confidence)]
        if not known:
            return None
        return _gap(np.array([a.confidence for a in known]), np.array([a.right for a in known]))

    @property
    def exact_error(self) -> tuple[float, float] | None:
        """What `calibration_error` would be if the same probabilities were exact, by chance alone.

        The mean, and what 95 of 100 cases are below; None where no label has a probability.
        """
        sure = np.array([a.confidence for a in self.answers if a.predicted is not None])
        sure = sure[np.isfinite(sure)]
        if not len(sure):
            return None
        random = np.random.default_rng(0)  # one outcome at a time: of a million labels all are gigabytes
        found = [_gap(sure, random.uniform(size=len(sure)) < sure) for _ in range(_DRAWN)]
        return float(np.mean(found)), float(np.quantile(found, 0.95))

    def _curve(self, values: np.ndarray, sign: float) -> list[tuple[float, float, float]]:
        """What is left where ``sign * value`` is at most ``sign * limit``, for every value as the limit.

        What has no label already has none at any limit.
        """
        right = np.array([a.right for a in self.answers])
        given = np.array([a.predicted is not None for a in self.answers])
        curve = []
        for limit in sorted({float(v) for v in values[given & np.isfinite(values)]}, key=lambda v: -sign * v):
            kept = given & (sign * values <= sign * limit)
            curve.append((limit, float(kept.mean()), float(right[kept].mean())))
        return curve


def _gap(sure: np.ndarray, right: np.ndarray) -> float:
    """Mean over ten bins of how far the shares of ``right`` are from the probabilities."""
    bins = np.minimum((10 * sure).astype(int), 9)
    return float(np.abs(np.bincount(bins, sure - right)).sum() / len(sure))


def wilson(right: int, total: int, z: float = 1.96) -> tuple[float, float]:
    """Interval of a share from ``right`` successes in ``total`` trials (Wilson 1927)."""
    if total == 0:
        return 0.0, 1.0
    share = right / total
    middle = share + z * z / (2 * total)
    spread = z * np.sqrt(share * (1 - share) / total + z * z / (4 * total * total))
    scale = 1 + z * z / total
    return max(0.0, float((middle - spread) / scale)), min(1.0, float((middle + spread) / scale))
