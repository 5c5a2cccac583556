"""Who is tested on whom: the splits of an evaluation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gesture_core.classify.library import medoids
from gesture_core.errors import ConfigError

PROTOCOLS = ("leave-one-subject-out", "leave-one-out", "donor", "split")


@dataclass(frozen=True, eq=False)
class Fold:
    """One split: indices of the examples and of the queries, and what it is called."""

    name: str
    train: np.ndarray
    test: np.ndarray


def folds(
    protocol: str,
    codes: np.ndarray,
    subjects: Sequence[str],
    within: np.ndarray,
    train: Sequence[bool] | None = None,
) -> Iterator[Fold]:
    """The folds of ``protocol``.

    Parameters
    ----------
    protocol : str
        ``leave-one-subject-out``: each subject against all others. ``leave-one-out``: each
        sequence against all others. ``donor``: one subject gives one example a class (the medoid
        of their trials), all others are tested; each subject in turn. ``split``: as ``train`` says.
    codes : (N,) int array
        Class of each sequence.
    subjects : sequence of N str
    within : (N, N) float array
        Distances, for the medoids.
    train : sequence of N bool, optional
        Examples of the ``split``.

    Raises
    ------
    ConfigError
        For an unknown protocol, a single subject, or an empty side of the split.
    """
    who = np.asarray(subjects)
    if protocol in ("leave-one-subject-out", "donor") and len(np.unique(who)) < 2:
        raise ConfigError(
            f"protocol {protocol} needs two subjects and there is {len(np.unique(who))}",
            remedy="--subjects with a regular expression that finds them, or --protocol leave-one-out",
            code="E_SUBJECTS",
        )
    if protocol == "leave-one-subject-out":
        from sklearn.model_selection import LeaveOneGroupOut

        for kept, tested in LeaveOneGroupOut().split(codes, codes, who):
            yield Fold(str(who[tested[0]]), kept, tested)
    elif protocol == "leave-one-out":
        every = np.arange(len(codes))
        for index in every:
            yield Fold(str(index), np.delete(every, index), every[index : index + 1])
    elif protocol == "donor":
        for subject in np.unique(who):
            own = np.flatnonzero(who == subject)
            chosen = own[medoids(within[np.ix_(own, own)], codes[own])]
            yield Fold(str(subject), chosen, np.flatnonzero(who != subject))
    elif protocol == "split":
        given = np.zeros(len(codes), bool) if train is None else np.asarray(train, bool)
        if not given.any() or given.all():
            raise ConfigError(
                "the split leaves no example or no query",
                remedy="--train with a regular expression that finds the examples",
                code="E_SPLIT",
            )
        yield Fold("split", np.flatnonzero(given), np.flatnonzero(~given))
    else:
        raise ConfigError(f"protocol {protocol!r}", remedy=f"one of {', '.join(PROTOCOLS)}", code="E_OPTION")
