"""Which channels a pair is compared on, counted and summed for all pairs at once.

The channels of a pair are those that are salient in either; one that only one of the two has cannot
be compared.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.types import Signals


def common_sum(
    queries: Sequence[Signals], examples: Sequence[Signals], q: np.ndarray | float, e: np.ndarray | float
) -> np.ndarray:
    """(Q, N) sum of ``q * e`` over the channels of each pair that both have.

    ``q`` is (Q, D) or one number, ``e`` is (N, D) or one number.
    """
    seen_q, salient_q = presence(queries)
    seen_e, salient_e = presence(examples)
    # Salient channels are present on their own side; counted by inclusion and exclusion.
    either = _products(q * salient_q, e * seen_e) + _products(q * seen_q, e * salient_e)
    return either - _products(q * salient_q, e * salient_e)


def common_share(queries: Sequence[Signals], examples: Sequence[Signals]) -> np.ndarray:
    """(Q, N) share of the salient channels of a pair that both of them have."""
    _, salient_q = presence(queries)
    _, salient_e = presence(examples)
    both = _products(salient_q, salient_e)
    wanted = salient_q.sum(axis=1)[:, None] + salient_e.sum(axis=1)[None] - both
    common = common_sum(queries, examples, 1.0, 1.0)
    return np.divide(common, wanted, out=np.zeros_like(common), where=wanted > 0)


def _products(q: np.ndarray, e: np.ndarray) -> np.ndarray:
    """``q @ e.T`` summed in the order of the channels, so that no pair's bits depend on its batch."""
    out = np.zeros((len(q), len(e)))
    for channel in range(q.shape[1]):
        out += np.multiply.outer(q[:, channel], e[:, channel])
    return out


def presence(series: Sequence[Signals]) -> tuple[np.ndarray, np.ndarray]:
    """(B, D) of what is present, and of what is salient too, as 0.0 and 1.0."""
    present = np.array([item.present for item in series], bool)
    masks = np.array([item.mask for item in series], bool)
    return present.astype(np.float64), (masks & present).astype(np.float64)
