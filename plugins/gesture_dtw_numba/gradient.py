"""Soft-DTW values and gradients of many lanes, by Cuturi and Blondel's two recursions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from gesture_dtw_numba.cells import exp_negative, soft_least
from gesture_dtw_numba.compiled import LANES, compiled, sources


@cache
def compiled_gradients() -> Callable[..., int]:
    """The compiled function; it returns the checksum of the code that it was compiled from."""
    version = sources()

    def gradients(
        x: Any,
        y: Any,
        n: Any,
        m: Any,
        low: Any,
        high: Any,
        gamma: Any,
        squared: Any,
        euclidean: Any,
        room: Any,
    ) -> int:
        """Values into ``room[0]`` (LANES,), gradients into the next two, (n, C, LANES) and (m, C, LANES).

        ``room`` goes on with local costs (n, m, LANES), the table and the moved weights, both
        (n + 1, m + 1, LANES), and the border value.
        """
        values, of_x, of_y, local, table, moved, border = room
        _forward(x, y, low, high, gamma, squared, euclidean, local, table, border)
        for lane in range(LANES):
            values[lane] = table[n[lane], m[lane], lane]
        _backward(n, m, gamma, local, table, moved)
        _pull(x, y, squared, euclidean, local, moved, of_x, of_y)
        return version

    return compiled(gradients)


@njit(nogil=True, error_model="numpy")
def _forward(
    x: Any,
    y: Any,
    low: Any,
    high: Any,
    gamma: Any,
    squared: Any,
    euclidean: Any,
    local: Any,
    table: Any,
    border: Any,
) -> None:
    rows, columns = len(x), len(y)
    one = x.dtype.type(1)
    local[:] = 0
    table[:] = border
    table[0, 0] = 0
    for i in range(rows):
        for j in range(columns):
            here = local[i, j]
            for c in range(x.shape[1]):
                for lane in range(LANES):
                    d = abs(x[i, c, lane] - y[j, c, lane])
                    here[lane] += d * d if squared else d
            if euclidean:
                for lane in range(LANES):
                    here[lane] = np.sqrt(here[lane])
            above, own = table[i], table[i + 1]
            for lane in range(LANES):
                best = soft_least(
                    above[j + 1, lane], own[j, lane], above[j, lane], gamma[lane], one / gamma[lane]
                )
                own[j + 1, lane] = here[lane] + best
            if low is not None:
                for lane in range(LANES):
                    if not low[i, lane] <= j < high[i, lane]:
                        own[j + 1, lane] = border


@njit(nogil=True, error_model="numpy")
def _backward(n: Any, m: Any, gamma: Any, local: Any, table: Any, moved: Any) -> None:
    """How much each cell's value moves its lane's: one at the end, else what successors pass on."""
    rows, columns = local.shape[0], local.shape[1]
    zero = table.dtype.type(0)
    moved[:] = 0
    for i in range(rows - 1, -1, -1):
        for j in range(columns - 1, -1, -1):
            total, own = moved[i, j], table[i + 1, j + 1]
            for step in range(3):
                a, b = i + (step != 1), j + (step != 0)
                if a < rows and b < columns:
                    weight, value, cost = moved[a, b], table[a + 1, b + 1], local[a, b]
                    for lane in range(LANES):
                        gap = min((value[lane] - cost[lane] - own[lane]) / gamma[lane], zero)
                        total[lane] += weight[lane] * exp_negative(gap)
            for lane in range(LANES):
                if n[lane] == i + 1 and m[lane] == j + 1:
                    total[lane] = 1


@njit(nogil=True, error_model="numpy")
def _pull(x: Any, y: Any, squared: Any, euclidean: Any, local: Any, moved: Any, of_x: Any, of_y: Any) -> None:
    """From cells to frames; zero where a cost has a kink."""
    of_x[:] = 0
    of_y[:] = 0
    for i in range(len(x)):
        for j in range(len(y)):
            weight, cost = moved[i, j], local[i, j]
            for c in range(x.shape[1]):
                a, b, left, right = x[i, c], y[j, c], of_x[i, c], of_y[j, c]
                for lane in range(LANES):
                    d = a[lane] - b[lane]
                    if euclidean:
                        slope = d / cost[lane] if cost[lane] > 0 else cost[lane]
                    elif squared:
                        slope = d + d
                    else:
                        slope = np.sign(d)
                    slope *= weight[lane]
                    left[lane] += slope
                    right[lane] -= slope
