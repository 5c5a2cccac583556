"""Examples inside a stream, in compiled loops.

No cell depends on another one of its column, so the cells of many examples, end to end, advance together.
A thread takes some examples whose columns fit into the nearest cache, through all frames of a block.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

from gesture_core.cores import usable_cores
from gesture_core.dtw.subsequence import UNREACHABLE, SubsequenceState
from gesture_dtw_numba.compiled import compiled

CELLS = 512
"""Of one chunk, unless one example has more."""
TILE = 8
"""Frames whose local costs are computed before the recurrence."""
CHANNELS = 4
"""Added in one pass over the cells."""
_WORTH = 1 << 23
"""Differences of channels from which on threads are worth their start."""


class NumbaSubsequences(SubsequenceState):
    """Three columns of costs and lengths, used in turn.

    Parameters
    ----------
    examples, floor
        As in `SubsequenceState`.
    threads : int
        0 for one for each core.
    """

    def __init__(self, examples: Sequence[np.ndarray], floor: float, threads: int = 0) -> None:
        super().__init__(examples, floor, np.float32)
        width, count = self.cells.shape
        padded: np.ndarray = np.zeros((-(-width // CHANNELS) * CHANNELS, count), np.float32)
        padded[:width] = self.cells
        self._padded = padded
        self._costs: np.ndarray = np.full((3, count), UNREACHABLE, np.float32)
        self._costs[2, self.first - 1] = 0
        self._lengths: np.ndarray = np.zeros((3, count), np.float32)
        self._local: np.ndarray = np.zeros(count, np.float32)
        self._turn = 0
        self._threads = threads or usable_cores()
        # Examples first to last of each chunk.
        cuts = [0]
        for number in range(len(self.frames)):
            begin = self.first[cuts[-1]] - 2
            if number > cuts[-1] and self.end[number] + 1 - begin > CELLS:
                cuts.append(number)
        self._cuts = np.array([*cuts, len(self.frames)])
        starts, ends = self.first[self._cuts[:-1]] - 2, self.end[self._cuts[1:] - 1] + 1
        self._widest = int((ends - starts).max())

    def advance(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B, N) accumulated costs and lengths."""
        x: np.ndarray = np.zeros((len(frames), len(self._padded)), np.float32)
        x[:, : frames.shape[1]] = frames
        costs: np.ndarray = np.empty((len(x), len(self.frames)), np.float32)
        lengths: np.ndarray = np.empty(costs.shape, np.int32)

        def part(cuts: np.ndarray) -> None:
            scratch = np.empty((TILE + 1, self._widest), np.float32)
            follow(
                x, self._padded, cuts, self.first, self.end, self._costs, self._lengths, self._local,
                self._turn, scratch, costs, lengths,
            )  # fmt: skip

        chunks = len(self._cuts) - 1
        threads = min(self._threads, chunks) if x.size * self.cells.shape[1] > _WORTH else 1
        if threads > 1:
            places = np.linspace(0, chunks, threads + 1).round().astype(int)
            parts = [self._cuts[a : b + 1] for a, b in pairwise(places)]
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(part, parts))
        else:
            part(self._cuts)
        self._turn = (self._turn + len(x)) % 3
        return costs.astype(np.float64), lengths

    def variances(
        self, sums: np.ndarray, squares: np.ndarray, before: int, lengths: np.ndarray
    ) -> np.ndarray:
        """(B, N) variances of subsequences."""
        out: np.ndarray = np.zeros(lengths.shape)
        spreads(sums, squares, before, lengths, out)
        return out


# Each loop is a function of its own over arrays of one dimension: only so does the compiler see rows
# without gaps that share no memory, and make vector instructions of it. So are lengths float32.


def _add_costs(x: Any, y: Any, k0: Any, k1: Any, row: Any) -> None:
    row[:] = 0
    for d in range(0, len(x), 4):
        x0, x1, x2, x3 = x[d], x[d + 1], x[d + 2], x[d + 3]
        y0, y1, y2, y3 = y[d][k0:k1], y[d + 1][k0:k1], y[d + 2][k0:k1], y[d + 3][k0:k1]
        for k in range(len(row)):
            d0, d1, d2, d3 = x0 - y0[k], x1 - y1[k], x2 - y2[k], x3 - y3[k]
            row[k] += (d0 * d0 + d1 * d1) + (d2 * d2 + d3 * d3)


def _step(
    cost: Any, cost_one: Any, cost_two: Any, span: Any, span_one: Any, span_two: Any, here: Any, last: Any
) -> None:
    half, one, two = np.float32(0.5), np.float32(1), np.float32(2)
    cells = len(cost) - 2
    cost, span, last = cost[2:], span[2:], last[2:]
    from_one, wait_one, own, above = cost_one[1:], cost_two[1:], here[2:], here[1:]
    span_from, span_wait = span_one[1:], span_two[1:]
    for k in range(cells):
        both = from_one[k] + own[k]
        skip = cost_one[k] + (above[k] + own[k])
        wait = wait_one[k] + half * (last[k] + own[k])
        least = min(both, skip)
        length = span_one[k] if skip < both else span_from[k]
        span[k] = (span_wait[k] + two) if wait < least else (length + one)
        cost[k] = min(least, wait)


def _follow(
    x: Any, y: Any, cuts: Any, first: Any, end: Any, costs: Any, lengths: Any, local: Any,
    turn: Any, scratch: Any, out_costs: Any, out_lengths: Any,
) -> None:  # fmt: skip
    far = np.float32(UNREACHABLE)
    for chunk in range(len(cuts) - 1):
        left, right = cuts[chunk], cuts[chunk + 1]
        k0, k1 = first[left] - 2, end[right - 1] + 1
        width = k1 - k0
        for begin in range(0, len(x), TILE):
            count = min(TILE, len(x) - begin)
            scratch[0, :width] = local[k0:k1]
            for f in range(count):
                add_costs(x[begin + f], y, k0, k1, scratch[f + 1][:width])
            for f in range(count):
                now = (turn + begin + f) % 3
                one, two = (now + 2) % 3, (now + 1) % 3
                cost, span = costs[now][k0:k1], lengths[now][k0:k1]
                step(
                    cost, costs[one][k0:k1], costs[two][k0:k1], span, lengths[one][k0:k1],
                    lengths[two][k0:k1], scratch[f + 1][:width], scratch[f][:width],
                )  # fmt: skip
                for n in range(left, right):
                    enter = first[n] - 1 - k0
                    cost[enter], span[enter], cost[enter - 1] = np.float32(0), np.float32(0), far
                    out_costs[begin + f, n] = cost[end[n] - k0]
                    out_lengths[begin + f, n] = np.int32(span[end[n] - k0])
            local[k0:k1] = scratch[count, :width]


def _spreads(sums: Any, squares: Any, before: Any, lengths: Any, out: Any) -> None:
    for b in range(lengths.shape[0]):
        row = before + b
        for n in range(lengths.shape[1]):
            length = lengths[b, n]
            if length > 0:
                total = 0.0
                for d in range(sums.shape[1]):
                    difference = sums[row, d] - sums[row - length, d]
                    total += difference * difference
                whole = (squares[row] - squares[row - length]) / length
                out[b, n] = max(whole - total / (float(length) * length), 0.0)


add_costs = compiled(_add_costs)
step = compiled(_step)
follow = compiled(_follow)
spreads = compiled(_spreads)
