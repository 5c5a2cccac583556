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

from gesture_core.dtw.subsequence import UNREACHABLE, SubsequenceState
from gesture_core.files import usable_cores
from gesture_dtw_numba.compiled import compiled

CELLS = 1024
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
            scratch = np.empty((TILE + 2, self._widest), np.float32)
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

    def running(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The sums as they are, and after each of the frames."""
        before = len(self._squares)
        sums = np.empty((before + len(frames), frames.shape[1]))
        squares = np.empty(len(sums))
        sums[:before], squares[:before] = self._sums, self._squares
        add_up(frames, before, sums, squares)
        return sums, squares


# Each loop is a function of its own over arrays of one dimension, with few of them: only so does the compiler
# see rows without gaps, test at the start that they share no memory, and make vector instructions of it.
# That is also why lengths are float32, and why the choice of a step, its cost and its length are three loops.


def _add_costs(x: Any, y: Any, k0: Any, k1: Any, row: Any) -> None:
    row[:] = 0
    for d in range(0, len(x), 4):
        x0, x1, x2, x3 = x[d], x[d + 1], x[d + 2], x[d + 3]
        y0, y1, y2, y3 = y[d][k0:k1], y[d + 1][k0:k1], y[d + 2][k0:k1], y[d + 3][k0:k1]
        for k in range(len(row)):
            d0, d1, d2, d3 = y0[k] - x0, y1[k] - x1, y2[k] - x2, y3[k] - x3
            row[k] = (((row[k] + d0 * d0) + d1 * d1) + d2 * d2) + d3 * d3


def _add_costs_of_four(
    p: Any, q: Any, r: Any, s: Any, y: Any, k0: Any, k1: Any, row_p: Any, row_q: Any, row_r: Any, row_s: Any
) -> None:
    """The same of four frames, with the same bits: an example is read once for all of them."""
    row_p[:] = 0
    row_q[:] = 0
    row_r[:] = 0
    row_s[:] = 0
    for d in range(0, len(p), 4):
        p0, p1, p2, p3 = p[d], p[d + 1], p[d + 2], p[d + 3]
        q0, q1, q2, q3 = q[d], q[d + 1], q[d + 2], q[d + 3]
        r0, r1, r2, r3 = r[d], r[d + 1], r[d + 2], r[d + 3]
        s0, s1, s2, s3 = s[d], s[d + 1], s[d + 2], s[d + 3]
        y0, y1, y2, y3 = y[d][k0:k1], y[d + 1][k0:k1], y[d + 2][k0:k1], y[d + 3][k0:k1]
        for k in range(len(row_p)):
            a, b, c, e = y0[k], y1[k], y2[k], y3[k]
            d0, d1, d2, d3 = a - p0, b - p1, c - p2, e - p3
            row_p[k] = (((row_p[k] + d0 * d0) + d1 * d1) + d2 * d2) + d3 * d3
            d0, d1, d2, d3 = a - q0, b - q1, c - q2, e - q3
            row_q[k] = (((row_q[k] + d0 * d0) + d1 * d1) + d2 * d2) + d3 * d3
            d0, d1, d2, d3 = a - r0, b - r1, c - r2, e - r3
            row_r[k] = (((row_r[k] + d0 * d0) + d1 * d1) + d2 * d2) + d3 * d3
            d0, d1, d2, d3 = a - s0, b - s1, c - s2, e - s3
            row_s[k] = (((row_s[k] + d0 * d0) + d1 * d1) + d2 * d2) + d3 * d3


def _choose(choice: Any, cost_one: Any, cost_two: Any, here: Any, last: Any) -> None:
    """0 for a step by one frame of both, 1 over a frame of the example, 2 over one of the stream."""
    half, none, skipped, waited = np.float32(0.5), np.float32(0), np.float32(1), np.float32(2)
    from_one, wait_one, own, above, before = cost_one[1:], cost_two[1:], here[2:], here[1:], last[2:]
    for k in range(len(here) - 2):
        both = from_one[k] + own[k]
        skip = cost_one[k] + (above[k] + own[k])
        wait = wait_one[k] + half * (before[k] + own[k])
        least = skip if skip < both else both
        kind = skipped if skip < both else none
        choice[k] = waited if wait < least else kind


def _pay(cost: Any, cost_one: Any, cost_two: Any, here: Any, last: Any) -> None:
    half = np.float32(0.5)
    cells, from_one, wait_one, own, above, before = (
        cost[2:], cost_one[1:], cost_two[1:], here[2:], here[1:], last[2:],
    )  # fmt: skip
    for k in range(len(cells)):
        both = from_one[k] + own[k]
        skip = cost_one[k] + (above[k] + own[k])
        wait = wait_one[k] + half * (before[k] + own[k])
        least = skip if skip < both else both
        cells[k] = wait if wait < least else least


def _lengthen(span: Any, span_one: Any, span_two: Any, choice: Any) -> None:
    one, two = np.float32(1), np.float32(2)
    cells, from_one, wait_one = span[2:], span_one[1:], span_two[1:]
    for k in range(len(cells)):
        length = span_one[k] if choice[k] == one else from_one[k]
        cells[k] = (wait_one[k] + two) if choice[k] == two else (length + one)


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
            whole = count - count % 4
            for f in range(0, whole, 4):
                at = begin + f
                add_costs_of_four(
                    x[at], x[at + 1], x[at + 2], x[at + 3], y, k0, k1, scratch[f + 1][:width],
                    scratch[f + 2][:width], scratch[f + 3][:width], scratch[f + 4][:width],
                )  # fmt: skip
            for f in range(whole, count):
                add_costs(x[begin + f], y, k0, k1, scratch[f + 1][:width])
            for f in range(count):
                now = (turn + begin + f) % 3
                one, two = (now + 2) % 3, (now + 1) % 3
                cost, span = costs[now][k0:k1], lengths[now][k0:k1]
                cost_one, cost_two = costs[one][k0:k1], costs[two][k0:k1]
                here, last = scratch[f + 1][:width], scratch[f][:width]
                choice = scratch[TILE + 1][:width]
                choose(choice, cost_one, cost_two, here, last)
                lengthen(span, lengths[one][k0:k1], lengths[two][k0:k1], choice)
                pay(cost, cost_one, cost_two, here, last)
                for n in range(left, right):
                    enter = first[n] - 1 - k0
                    cost[enter], span[enter], cost[enter - 1] = np.float32(0), np.float32(0), far
                    out_costs[begin + f, n] = cost[end[n] - k0]
                    out_lengths[begin + f, n] = np.int32(span[end[n] - k0])
            local[k0:k1] = scratch[count, :width]


def _add_up(frames: Any, before: Any, sums: Any, squares: Any) -> None:
    for t in range(len(frames)):
        row, total = before + t, 0.0
        for d in range(frames.shape[1]):
            value = float(frames[t, d])
            sums[row, d] = sums[row - 1, d] + value
            total += value * value
        squares[row] = squares[row - 1] + total


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


# A product and the sum that takes it may be one instruction, in both alike: no bit depends on the block.
add_costs = compiled(_add_costs, fastmath={"contract"})
add_costs_of_four = compiled(_add_costs_of_four, fastmath={"contract"})
choose = compiled(_choose)
pay = compiled(_pay)
lengthen = compiled(_lengthen)
follow = compiled(_follow)
add_up = compiled(_add_up)
# Its sums may be added in any order, which is the same for every cell of every block.
spreads = compiled(_spreads, fastmath={"reassoc", "nsz", "contract"})
