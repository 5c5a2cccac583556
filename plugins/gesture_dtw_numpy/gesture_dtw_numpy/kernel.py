"""Distance kernel on NumPy alone: anti-diagonals of many lanes at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.dtw.lanes import GradientLaneKernel, Lanes
from gesture_core.dtw.spec import DtwSpec
from gesture_core.plugin.abilities import SubsequenceKernel
from gesture_dtw_numpy.gradient import lane_gradients
from gesture_dtw_numpy.subsequences import NumpySubsequences


class NumpyKernel(GradientLaneKernel, SubsequenceKernel):
    """Warping distances wherever NumPy runs, in the dtype of the batches."""

    lane_cells = 1 << 15
    lane_count = 512

    def supports(self, spec: DtwSpec) -> bool:
        """Every specification, masks with holes included."""
        return True

    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) accumulated costs."""
        rows, columns = len(lanes.x), len(lanes.y)
        flipped = lanes.y[::-1]
        # Diagonal k holds the cells (i, k - i); row i is stored at i + 1, after a border of infinity.
        last = np.full((rows + 1, len(lanes)), np.inf, lanes.x.dtype)
        before = last.copy()
        before[0] = 0
        out = np.empty(len(lanes), lanes.x.dtype)
        for k in range(rows + columns - 1):
            first, stop = max(0, k - columns + 1), min(rows, k + 1)
            skip = columns - 1 - k
            cost = _cost(lanes.x[first:stop], flipped[first + skip : stop + skip], lanes.cost)
            up, left = last[first:stop], last[first + 1 : stop + 1]
            least = _least(up, left, before[first:stop], lanes.gamma)
            now = np.full_like(last, np.inf)
            np.add(cost, least, out=now[first + 1 : stop + 1])
            if lanes.low is not None and lanes.high is not None:
                column = k - np.arange(first, stop, dtype=np.int32)[:, None]
                outside = (column < lanes.low[first:stop]) | (column >= lanes.high[first:stop])
                now[first + 1 : stop + 1][outside] = np.inf
            elif lanes.cells is not None:
                row = np.arange(first, stop)
                now[first + 1 : stop + 1][~lanes.cells[row, k - row]] = np.inf
            ends = np.flatnonzero(lanes.n + lanes.m - 2 == k)
            out[ends] = now[lanes.n[ends], ends]
            last, before = now, last
        return out

    def warp_gradients(self, lanes: Lanes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(P,), (n_max, C, P), (m_max, C, P): soft accumulated costs and their gradients."""
        return lane_gradients(lanes)

    def subsequences(self, examples: Sequence[np.ndarray], floor: float) -> NumpySubsequences:
        """A stream in which ``examples`` are looked for, in float64."""
        return NumpySubsequences(examples, floor)


def _cost(x: np.ndarray, y: np.ndarray, cost: str) -> np.ndarray:
    """(K, P) local costs of (K, C, P) frames, summed over the dimensions in their order."""
    difference = x - y
    terms = np.abs(difference) if cost == "absolute" else difference * difference
    total: np.ndarray = terms[:, 0].copy()
    for dimension in range(1, terms.shape[1]):
        total += terms[:, dimension]
    return np.asarray(np.sqrt(total)) if cost == "euclidean" else total


def _least(up: np.ndarray, left: np.ndarray, diagonal: np.ndarray, gamma: np.ndarray | None) -> np.ndarray:
    """The least of three, soft with ``gamma``; infinity where all three are."""
    least: np.ndarray = np.minimum(np.minimum(up, left), diagonal)
    if gamma is None:
        return least
    shift = np.where(np.isinf(least), 0, least)
    total = sum(np.exp((shift - value) / gamma) for value in (up, left, diagonal))
    with np.errstate(divide="ignore"):
        least = least - gamma * np.log(total)
    return least
