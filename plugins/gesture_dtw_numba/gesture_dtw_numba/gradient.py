"""Soft-DTW values and gradients of many lanes, by Cuturi and Blondel's two recursions.

The forward pass keeps the share of each cell's soft minimum that two of its predecessors have; the
third has the rest to one. Shares come from differences of neighbours, so the backward pass, which
only multiplies and adds, loses nothing however long the series or small the softness. (The textbook form,
the exponential of the difference of three accumulated costs, loses what cancels.)
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from gesture_core.dtw.batches import UNREACHED
from gesture_core.dtw.lanes import GradientLaneKernel, Lanes
from gesture_dtw_numba.cells import soft_shares
from gesture_dtw_numba.compiled import LANES, compiled
from gesture_dtw_numba.layout import aligned

LOCAL, LEFT, CORNER, MOVED, GAMMA, SHARPNESS = range(6)
"""Rows of `GradientScratch.work`."""


class CostRule(NamedTuple):
    """What two frames cost."""

    squared: bool
    euclidean: bool


class GradientScratch(NamedTuple):
    """What gradients are written to, and the arrays in which they are worked out.

    Attributes
    ----------
    values : (LANES,) float
    of_x, of_y : (n, C, LANES) and (m, C, LANES) float
    shares : (n, m, 2, LANES) float
        The share of each cell's soft minimum that the cells above and to the left have.
    row : (m, LANES) float
        One row of the table.
    work : (6, LANES) float
        One array, so that the compiler need not prove that several do not overlap.
    border : float
        `UNREACHED`.
    """

    values: np.ndarray
    of_x: np.ndarray
    of_y: np.ndarray
    shares: np.ndarray
    row: np.ndarray
    work: np.ndarray
    border: float


class GradientLanes(GradientLaneKernel):
    """Gradients by lanes: `GradientLaneKernel` pairs and pads, compiled code computes."""

    lane_count = LANES

    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) soft accumulated costs."""
        return self.warp_gradients(lanes)[0]

    def warp_gradients(self, lanes: Lanes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(P,), (n_max, C, P), (m_max, C, P): soft accumulated costs and their gradients."""
        assert lanes.gamma is not None
        x, y, gamma = _widen(lanes.x, 0), _widen(lanes.y, 0), _widen(lanes.gamma, 1)
        n, m = _widen(lanes.n, 1), _widen(lanes.m, 1)
        low = high = None
        if lanes.low is not None and lanes.high is not None:
            low, high = _widen(lanes.low, 0), _widen(lanes.high, 0)
        dtype = x.dtype
        scratch = GradientScratch(
            aligned((LANES,), dtype),
            np.empty_like(x),
            np.empty_like(y),
            aligned((len(x), len(y), 2, LANES), dtype),
            aligned((len(y), LANES), dtype),
            aligned((6, LANES), dtype),
            dtype.type(UNREACHED[dtype]),
        )
        scratch.work[GAMMA], scratch.work[SHARPNESS] = gamma, 1 / gamma
        rule = CostRule(lanes.cost != "absolute", lanes.cost == "euclidean")
        gradients(x, y, n, m, low, high, rule, scratch)
        count = len(lanes)
        return scratch.values[:count], scratch.of_x[..., :count], scratch.of_y[..., :count]


def _widen(array: np.ndarray, fill: int) -> np.ndarray:
    """The last axis filled up to `LANES`."""
    out = np.full((*array.shape[:-1], LANES), fill, array.dtype)
    out[..., : array.shape[-1]] = array
    return out


@compiled
def gradients(x: Any, y: Any, n: Any, m: Any, low: Any, high: Any, rule: Any, scratch: Any) -> None:
    """Fill ``values``, ``of_x`` and ``of_y`` of ``scratch`` from (n, C, LANES) and (m, C, LANES)."""
    _forward(x, y, n, m, low, high, rule, scratch)
    _backward(x, y, n, m, rule, scratch)


@njit(nogil=True, error_model="numpy")
def _local_costs(frame: Any, y: Any, rule: Any, local: Any) -> None:
    """The costs of two frames (C, LANES), over all dimensions in their order."""
    local[:] = 0
    for c in range(len(frame)):
        for lane in range(LANES):
            d = abs(frame[c, lane] - y[c, lane])
            local[lane] += d * d if rule.squared else d
    if rule.euclidean:
        for lane in range(LANES):
            local[lane] = np.sqrt(local[lane])


@njit(nogil=True, error_model="numpy")
def _forward(x: Any, y: Any, n: Any, m: Any, low: Any, high: Any, rule: Any, scratch: Any) -> None:
    # One row, of which what lies left of the current cell is the next row's already.
    row, work, shares, border = scratch.row, scratch.work, scratch.shares, scratch.border
    row[:] = border
    for i in range(len(x)):
        work[LEFT] = border
        work[CORNER] = 0 if i == 0 else border
        for j in range(len(y)):
            _local_costs(x[i], y[j], rule, work[LOCAL])
            _cell(row[j], shares[i, j], work)
            if low is not None:
                for lane in range(LANES):
                    if not low[i, lane] <= j < high[i, lane]:
                        work[LEFT, lane] = border
                        row[j, lane] = border
        for lane in range(LANES):
            if n[lane] == i + 1:
                scratch.values[lane] = row[m[lane] - 1, lane]


# Loops over lanes are functions of few arrays: in a larger one the compiler leaves them scalar.
@njit(nogil=True, error_model="numpy")
def _cell(own: Any, share: Any, work: Any) -> None:
    """The next cell of a row, which holds the cell above it."""
    for lane in range(LANES):
        up = own[lane]
        best, of_up, of_left = soft_shares(
            up, work[LEFT, lane], work[CORNER, lane], work[GAMMA, lane], work[SHARPNESS, lane]
        )
        share[0, lane] = of_up
        share[1, lane] = of_left
        work[CORNER, lane] = up
        work[LEFT, lane] = work[LOCAL, lane] + best
        own[lane] = work[LEFT, lane]


@njit(nogil=True, error_model="numpy")
def _backward(x: Any, y: Any, n: Any, m: Any, rule: Any, scratch: Any) -> None:
    """How much each cell moves its lane's value, one at the end, handed on by shares and to the frames."""
    row, work, shares, of_x, of_y = scratch.row, scratch.work, scratch.shares, scratch.of_x, scratch.of_y
    of_x[:] = 0
    of_y[:] = 0
    row[:] = 0
    for i in range(len(x) - 1, -1, -1):
        for lane in range(LANES):
            if n[lane] == i + 1:
                row[m[lane] - 1, lane] = 1
        work[LEFT] = 0
        work[CORNER] = 0
        for j in range(len(y) - 1, -1, -1):
            _hand_on(row[j], shares[i, j], work)
            if rule.euclidean:
                _local_costs(x[i], y[j], rule, work[LOCAL])
            for c in range(x.shape[1]):
                _pull(x[i, c], y[j, c], rule, work, of_x[i, c], of_y[j, c])


@njit(nogil=True, error_model="numpy")
def _hand_on(own: Any, share: Any, work: Any) -> None:
    """Give what a cell moves to the three before it; ``own`` holds its part from the row below."""
    for lane in range(LANES):
        moved = own[lane] + work[LEFT, lane]
        up, left = moved * share[0, lane], moved * share[1, lane]
        own[lane] = up + work[CORNER, lane]
        work[LEFT, lane] = left
        work[CORNER, lane] = moved - up - left
        work[MOVED, lane] = moved


@njit(nogil=True, error_model="numpy")
def _pull(x: Any, y: Any, rule: Any, work: Any, of_x: Any, of_y: Any) -> None:
    """From a cell to one dimension of its two frames; zero where a cost has a kink."""
    for lane in range(LANES):
        d = x[lane] - y[lane]
        if rule.euclidean:
            slope = d / work[LOCAL, lane] if work[LOCAL, lane] > 0 else work[LOCAL, lane]
        elif rule.squared:
            slope = d + d
        else:
            slope = np.sign(d)
        slope *= work[MOVED, lane]
        of_x[lane] += slope
        of_y[lane] -= slope
