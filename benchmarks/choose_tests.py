"""Tests of a choice on a subject that it has not seen, for benchmarks/choose.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from datasets import PAPER_EXAMPLES

from gesture_core.classify.classifiers import learn
from gesture_core.classify.decision import votes_of
from gesture_core.classify.learning import medoids
from gesture_core.settings import load_settings


def tested(problem: Any, subject: str, distances: np.ndarray) -> dict[str, list[bool]]:
    """Whether each item of ``subject`` is recognised, by row of the accuracy table."""
    out = {}
    labels, subjects = problem.labels, problem.subjects
    for group in ("", *np.unique(problem.groups[problem.groups != ""])):
        there = np.ones(len(labels), bool) if not group else problem.groups == group
        queries = np.flatnonzero((subjects == subject) & there)
        examples = np.flatnonzero((subjects != subject) & there)
        out[f"{problem.name}, {group or 'all'}"] = _right(labels, distances, queries, examples)
    if problem.name == "utd_openpose":
        queries = np.flatnonzero(subjects == subject)
        row = f"{problem.name}, one example a class from each other subject"
        for donor in np.unique(subjects[subjects != subject]):
            own = np.flatnonzero(subjects == donor)
            chosen = own[medoids(distances[np.ix_(own, own)], problem.codes[own])]
            out.setdefault(row, []).extend(_right(labels, distances, queries, chosen))
        if subject != "s1":
            names = problem.names.tolist()
            chosen = np.array([names.index(name) for name in PAPER_EXAMPLES])
            out[f"{problem.name}, the authors' six examples"] = _right(labels, distances, queries, chosen)
    return out


def _right(
    labels: np.ndarray, distances: np.ndarray, queries: np.ndarray, examples: np.ndarray
) -> list[bool]:
    classes, codes = np.unique(labels, return_inverse=True)
    settings = load_settings("modern", classify__classifier="weighed", classify__landmarks=len(labels))
    fitted = learn(settings, (), codes[examples], len(classes), distances[np.ix_(examples, examples)])[2]
    votes = votes_of(fitted, distances[np.ix_(queries, examples)])
    return list((votes.winners >= 0) & (classes[votes.winners] == labels[queries]))
