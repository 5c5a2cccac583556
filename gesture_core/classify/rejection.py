"""When no label is warranted: the nearest example is too far away, or another class as likely."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.classify.neighbors import Votes
from gesture_core.errors import ConfigError


def refusals(
    votes: Votes,
    thresholds: np.ndarray | None = None,
    margin: float | None = None,
    still: Sequence[bool] | np.ndarray | None = None,
) -> list[str]:
    """Why each query gets no label: the code of the reason, empty where it gets one.

    Parameters
    ----------
    votes : Votes
        Of Q queries.
    thresholds : (C,) float array, optional
        Largest distance at which each class lends its label (E_REJECTED).
    margin : float, optional
        Smallest margin that a label needs (E_UNSURE).
    still : sequence of Q bool, optional
        Queries in which nothing moves.

    Returns
    -------
    list of Q str
        Where no example could be compared, E_NO_SALIENT of a query in which nothing moves, and
        E_NO_COMMON of any other.
    """
    codes = []
    rows = zip(votes.winners, votes.distances, votes.margins, strict=True)
    for index, (winner, distance, lead) in enumerate(rows):
        if winner < 0:
            codes.append("E_NO_SALIENT" if still is not None and still[index] else "E_NO_COMMON")
        elif thresholds is not None and not distance <= thresholds[winner]:
            codes.append("E_REJECTED")
        else:
            codes.append("E_UNSURE" if margin is not None and lead < margin else "")
    return codes


def calibrated_thresholds(
    within: np.ndarray, codes: np.ndarray, classes: int, sd: float, kept: np.ndarray | None = None
) -> np.ndarray:
    """A threshold for each class from the distances among its examples.

    Each example is left out once and its distance to the nearest other example of its class is
    taken, of those that are ``kept``: the same quantity that a query of the class will have. The
    threshold is their mean plus ``sd`` standard deviations (Gillian, Knapp and O'Modhrain 2011). A
    class with fewer than three such distances has no deviation of its own and takes the threshold of
    all classes together.

    Parameters
    ----------
    within : (N, N) float array
        Distances among the examples; the diagonal is ignored.
    codes : (N,) int array
        Class of each example.
    classes : int
    sd : float
        Standard deviations above the mean; may be negative.
    kept : int array, optional
        The examples that queries are compared with; all by default.

    Returns
    -------
    (classes,) float array

    Raises
    ------
    ConfigError
        E_REJECT where no class has two examples that can be compared.
    """
    own = np.where(np.isnan(within), np.inf, within).astype(np.float64)
    own = np.where(codes[:, None] == codes[None, :], own, np.inf)
    np.fill_diagonal(own, np.inf)
    if kept is not None:
        own[:, np.isin(np.arange(len(codes)), kept, invert=True)] = np.inf
    nearest = own.min(axis=1) if own.size else np.empty(0)
    known = np.isfinite(nearest)
    if not known.any():
        raise ConfigError(
            "a rejection threshold cannot be calibrated: no class has two examples",
            remedy="two examples of a class at least (better three of each), or classify.reject=<distance>",
            code="E_REJECT",
        )
    thresholds = np.full(classes, nearest[known].mean() + sd * nearest[known].std())
    for code in range(classes):
        mine = nearest[known & (codes == code)]
        if len(mine) >= 3:
            thresholds[code] = mine.mean() + sd * mine.std()
    return thresholds
