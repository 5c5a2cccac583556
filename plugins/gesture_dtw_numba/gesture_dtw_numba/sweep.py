"""One series against a block of lanes: the loop nest in which the time is spent.

The table is computed `ROWS` rows at a time. Only the last row of a pass is kept (``above``); the
rows inside a pass hand their values on in registers and in ``left``, one value for each lane.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from gesture_dtw_numba.cells import least, soft_least
from gesture_dtw_numba.compiled import LANES


@njit(nogil=True, error_model="numpy")
def sweep(
    x: np.ndarray,
    padded: int,
    block: Any,
    rule: Any,
    costs: Any,
    square: Any,
    gamma: Any,
    limited: Any,
    scratch: Any,
) -> bool:
    """Fill ``scratch.above`` with the last row of the accumulated cost; False where it was not reached.

    Parameters
    ----------
    x : (4 K, C) float
        The query, padded at its front.
    padded : int
        Number of padded rows in front, 0 to 3.
    block : (m, C, LANES) float
        The examples.
    rule : Rule
    costs : None or Costs
        None where C is 1, no cell is forbidden and the warping is hard.
    square : None or True
        None for absolute differences. A type tells them apart, not a value: a branch inside the loop
        over lanes keeps the compiler from holding the last column in registers.
    gamma : None or float
    limited : bool
        Stop as soon as every lane is certain to exceed ``scratch.limit``.
    scratch : Scratch
        With the band, where ``rule`` has one.
    """
    euclidean, banded = rule.euclidean, rule.banded
    above, left, corner, border = scratch.above, scratch.left, scratch.corner, scratch.border
    columns, one = len(block), x.dtype.type(1)
    above[:columns] = border
    start, stop, open_from, open_until = 0, columns, 0, columns
    for i in range(0, len(x), 4):
        corner[:] = border
        if costs is not None and banded:
            before, after = start, stop
            start, stop, open_from, open_until = _span(scratch.low, scratch.high, i, columns)
            if start > 0:
                corner[:] = above[start - 1]
            above[before:start] = border
            above[stop:after] = border
        left[:] = border
        if i == 0 and padded == 0:
            corner[:] = 0
        elif i == 0:
            left[padded - 1] = 0
        x0, x1, x2, x3 = x[i, 0], x[i + 1, 0], x[i + 2, 0], x[i + 3, 0]
        for j in range(start, stop):
            if costs is not None:
                _local_costs(x, i, block, j, square, euclidean, costs)
                if banded and not open_from <= j < open_until:
                    _forbid(costs.local, scratch.low, scratch.high, i, j, border)
            for lane in range(LANES):
                if costs is None:
                    e = block[j, 0, lane]
                    c0, c1, c2, c3 = abs(x0 - e), abs(x1 - e), abs(x2 - e), abs(x3 - e)
                    if square is not None:
                        c0, c1, c2, c3 = c0 * c0, c1 * c1, c2 * c2, c3 * c3
                else:
                    local = costs.local
                    c0, c1, c2, c3 = local[0, lane], local[1, lane], local[2, lane], local[3, lane]
                l0, l1, l2, l3 = left[0, lane], left[1, lane], left[2, lane], left[3, lane]
                up = above[j, lane]
                if gamma is None:
                    v0 = c0 + least(up, l0, corner[lane])
                    v1 = c1 + least(v0, l1, l0)
                    v2 = c2 + least(v1, l2, l1)
                    v3 = c3 + least(v2, l3, l2)
                else:
                    sharpness = one / gamma
                    v0 = c0 + soft_least(up, l0, corner[lane], gamma, sharpness)
                    v1 = c1 + soft_least(v0, l1, l0, gamma, sharpness)
                    v2 = c2 + soft_least(v1, l2, l1, gamma, sharpness)
                    v3 = c3 + soft_least(v2, l3, l2, gamma, sharpness)
                left[0, lane], left[1, lane], left[2, lane], left[3, lane] = v0, v1, v2, v3
                corner[lane] = up
                above[j, lane] = v3
        now = limited and i % 16 == 12 and i + 4 < len(x)
        if now and _all_exceed(above, start, stop, corner, scratch.limit):
            return False
    return True


@njit(nogil=True)
def _all_exceed(above: Any, start: Any, stop: Any, least: Any, limit: Any) -> bool:
    """Whether every path through the row has cost more than its lane's limit; costs only grow."""
    if start >= stop:
        return False
    least[:] = above[start]
    for j in range(start + 1, stop):
        for lane in range(LANES):
            least[lane] = min(least[lane], above[j, lane])
    within = 0
    for lane in range(LANES):
        within += least[lane] <= limit[lane]
    return within == 0


@njit(nogil=True)
def _span(low: Any, high: Any, row: Any, columns: Any) -> Any:
    """The columns that any lane visits in four rows, and those that all lanes visit in all of them."""
    start, stop, open_from, open_until = columns, 0, 0, columns
    for r in range(row, row + 4):
        for lane in range(LANES):
            open_from = max(open_from, low[r, lane])
            open_until = min(open_until, high[r, lane])
            if low[r, lane] < high[r, lane]:
                start = min(start, low[r, lane])
                stop = max(stop, min(columns, high[r, lane]))
    return min(start, stop), stop, open_from, open_until


@njit(nogil=True)
def _forbid(local: Any, low: Any, high: Any, row: Any, column: Any, border: Any) -> None:
    """Make cells outside the band cost more than any path."""
    j = np.int32(column)
    for r in range(4):
        for lane in range(LANES):
            inside = (low[row + r, lane] <= j) & (j < high[row + r, lane])
            local[r, lane] = local[r, lane] if inside else border


@njit(nogil=True, error_model="numpy")
def _local_costs(x: Any, row: Any, block: Any, column: Any, square: Any, euclidean: Any, costs: Any) -> None:
    """The costs of four rows against one column, over all dimensions in their order."""
    share, local = costs.share, costs.local
    local[:] = 0
    for d in range(x.shape[1]):
        x0, x1, x2, x3 = x[row, d], x[row + 1, d], x[row + 2, d], x[row + 3, d]
        for lane in range(LANES):
            e, w = block[column, d, lane], share[d, lane]
            c0, c1, c2, c3 = abs(x0 - e), abs(x1 - e), abs(x2 - e), abs(x3 - e)
            if square is not None:
                c0, c1, c2, c3 = c0 * c0, c1 * c1, c2 * c2, c3 * c3
            local[0, lane] += w * c0
            local[1, lane] += w * c1
            local[2, lane] += w * c2
            local[3, lane] += w * c3
    if euclidean:
        for r in range(4):
            for lane in range(LANES):
                local[r, lane] = np.sqrt(local[r, lane])
