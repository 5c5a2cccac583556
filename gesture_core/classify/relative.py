"""How much a sequence holds: the measure against which a distance is large or small.

A squared warping distance grows with the square of a movement's size. With one example of each
gesture a small gesture is then near to everything and a large one far even from its own kind: the
small ones become hubs (Radovanovic, Nanopoulos and Ivanovic 2010). Divided by the geometric mean of
both sizes, a distance says what share of the two movements the warping could not match, as a cosine
does for vectors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.classify.common import common_sum
from gesture_core.types import Signals


def pair_sizes(queries: Sequence[Signals], examples: Sequence[Signals], rest: float = 0.0) -> np.ndarray:
    """Geometric mean of the sizes of every pair.

    The size of a sequence is the sum of its squared values over frames and over the channels that
    the pair is compared on, and ``rest`` for each frame.

    Parameters
    ----------
    queries, examples : sequences of Signals with the same channels
    rest : float
        In the squared unit of the channels.

    Returns
    -------
    (Q, N) float64
        Zero where one of the two holds nothing at all.
    """
    size_q = common_sum(queries, examples, _squares(queries), 1.0) + rest * _frames(queries)[:, None]
    size_e = common_sum(queries, examples, 1.0, _squares(examples)) + rest * _frames(examples)[None]
    # Differences of sums may fall below zero by rounding.
    return np.sqrt(np.maximum(size_q, 0) * np.maximum(size_e, 0))


def size_shares(queries: Sequence[Signals], examples: Sequence[Signals], rest: float = 0.0) -> np.ndarray:
    """Share of both sizes that lies in the channels that a pair is compared on.

    Missing legs then weigh little in a gesture of the hands, and much in a lunge.

    Returns
    -------
    (Q, N) float64
        Geometric mean of the two shares, 0 to 1.
    """
    whole = np.sqrt(np.outer(_whole(queries, rest), _whole(examples, rest)))
    common = pair_sizes(queries, examples, rest)
    return np.divide(common, whole, out=np.zeros_like(common), where=whole > 0)


def divided(distances: np.ndarray, by: np.ndarray) -> np.ndarray:
    """``distances / by``; infinity where there is nothing to divide by, and no distance above zero."""
    out = np.where(distances > 0, np.inf, 0.0)
    return np.divide(distances, by, out=out, where=by > 0)


def _squares(series: Sequence[Signals]) -> np.ndarray:
    """(B, D) sums of squares over the frames."""
    return np.array([np.einsum("td,td->d", item.values, item.values, dtype=np.float64) for item in series])


def _whole(series: Sequence[Signals], rest: float) -> np.ndarray:
    """(B,) size over all channels that are present."""
    return _squares(series).sum(axis=1) + rest * _frames(series)


def _frames(series: Sequence[Signals]) -> np.ndarray:
    return np.array([len(item) for item in series], np.float64)
