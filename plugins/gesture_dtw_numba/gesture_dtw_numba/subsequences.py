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
        missing = len(self._padded) - frames.shape[1]
        x = np.pad(frames, ((0, 0), (0, missing))) if missing else frames
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
        return costs, lengths

    def relative(self, costs: np.ndarray, lengths: np.ndarray, before: int) -> tuple[np.ndarray, np.ndarray]:
        """(B, N) distances and lengths."""
        distances = np.empty(costs.shape)
        relate(
            costs, lengths, self._sums, self._squares, before, self.frames, self.spread, self.floor, distances
        )
        return distances, lengths

    def running(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The sums as they are, and after each of the frames."""
        before = len(self._squares)
        sums = np.empty((before + len(frames), frames.shape[1]))
        squares = np.empty(len(sums))
        sums[:before], squares[:before] = self._sums, self._squares
        add_up(frames, before, sums, squares)
        return sums, squares


# A row is cut out of its table in the function that loops over it: references to one that is handed over are
# counted, which takes longer than forty cells do. Rows are of one dimension, and few to a loop: only so does
# the compiler see that they have no gaps, test at the start that they share no memory, and make vector
# instructions of short rows, too. That is also why lengths are float32, and costs and lengths two loops.


def _add_costs(x: Any, at: Any, y: Any, k0: Any, k1: Any, rows: Any, f: Any) -> None:
    p, row = x[at], rows[f][: k1 - k0]
    row[:] = 0
    for d in range(0, len(p), 4):
        p0, p1, p2, p3 = p[d], p[d + 1], p[d + 2], p[d + 3]
        y0, y1, y2, y3 = y[d][k0:k1], y[d + 1][k0:k1], y[d + 2][k0:k1], y[d + 3][k0:k1]
        for k in range(len(row)):
            d0, d1, d2, d3 = y0[k] - p0, y1[k] - p1, y2[k] - p2, y3[k] - p3
            row[k] = (((row[k] + d0 * d0) + d1 * d1) + d2 * d2) + d3 * d3


def _add_costs_of_four(x: Any, at: Any, y: Any, k0: Any, k1: Any, rows: Any, f: Any) -> None:
    """The same of four frames, with the same bits: an example is read once for all of them."""
    width = k1 - k0
    p, q, r, s = x[at], x[at + 1], x[at + 2], x[at + 3]
    row_p, row_q, row_r, row_s = (
        rows[f][:width],
        rows[f + 1][:width],
        rows[f + 2][:width],
        rows[f + 3][:width],
    )
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


def _step(costs: Any, now: Any, k0: Any, k1: Any, rows: Any, f: Any) -> None:
    """What the cheapest step into each cell leads to, and which it is.

    0 by one frame of both, 1 over a frame of the example, 2 over one of the stream.
    """
    half, none, skipped, waited = np.float32(0.5), np.float32(0), np.float32(1), np.float32(2)
    one, two = costs[(now + 2) % 3][k0:k1], costs[(now + 1) % 3][k0:k1]
    cost, here, before, choice = costs[now][k0 + 2 : k1], rows[f + 1], rows[f], rows[TILE + 1]
    for k in range(len(cost)):
        own = here[k + 2]
        both = one[k + 1] + own
        skip = one[k] + (here[k + 1] + own)
        wait = two[k + 1] + half * (before[k + 2] + own)
        least = skip if skip < both else both
        kind = skipped if skip < both else none
        choice[k] = waited if wait < least else kind
        cost[k] = wait if wait < least else least


def _lengthen(lengths: Any, now: Any, k0: Any, k1: Any, rows: Any) -> None:
    single, double = np.float32(1), np.float32(2)
    one, two = lengths[(now + 2) % 3][k0:k1], lengths[(now + 1) % 3][k0:k1]
    length, choice = lengths[now][k0 + 2 : k1], rows[TILE + 1]
    for k in range(len(length)):
        # All are read before one is chosen: else the choice is one of addresses, which is read cell by cell.
        both, skip, wait, kind = one[k + 1], one[k], two[k + 1], choice[k]
        before = skip if kind == single else both
        length[k] = (wait + double) if kind == double else (before + single)


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
                add_costs_of_four(x, begin + f, y, k0, k1, scratch, f + 1)
            for f in range(whole, count):
                add_costs(x, begin + f, y, k0, k1, scratch, f + 1)
            for f in range(count):
                now = (turn + begin + f) % 3
                step(costs, now, k0, k1, scratch, f)
                lengthen(lengths, now, k0, k1, scratch)
                for n in range(left, right):
                    enter = first[n] - 1
                    costs[now, enter], lengths[now, enter], costs[now, enter - 1] = (
                        np.float32(0),
                        np.float32(0),
                        far,
                    )
                    out_costs[begin + f, n] = costs[now, end[n]]
                    out_lengths[begin + f, n] = np.int32(lengths[now, end[n]])
            local[k0:k1] = scratch[count, :width]


def _add_up(frames: Any, before: Any, sums: Any, squares: Any) -> None:
    for t in range(len(frames)):
        now, last, values = sums[before + t], sums[before + t - 1], frames[t]
        total = 0.0
        for d in range(len(values)):
            value = float(values[d])
            now[d] = last[d] + value
            total += value * value
        squares[before + t] = squares[before + t - 1] + total


def _relate(
    costs: Any, lengths: Any, sums: Any, squares: Any, before: Any, frames: Any, spread: Any, floor: Any,
    distances: Any,
) -> None:  # fmt: skip
    far = np.float32(UNREACHABLE / 10)
    for b in range(costs.shape[0]):
        row = before + b
        for n in range(costs.shape[1]):
            distances[b, n] = np.inf
            if not costs[b, n] < far:
                lengths[b, n] = 0
                continue
            length, total = lengths[b, n], 0.0
            now, then = sums[row], sums[row - length]
            for d in range(len(now)):
                difference = now[d] - then[d]
                total += difference * difference
            variance = max((squares[row] - squares[row - length] - total / length) / length, 0.0)
            size = np.sqrt((spread[n] + floor) * (variance + floor))
            if size > 0:
                distances[b, n] = costs[b, n] / frames[n] / size


# A product and the sum that takes it may be one instruction, in both alike: no bit depends on the block.
add_costs = compiled(_add_costs, fastmath={"contract"})
add_costs_of_four = compiled(_add_costs_of_four, fastmath={"contract"})
step = compiled(_step)
lengthen = compiled(_lengthen)
follow = compiled(_follow)
# Their sums over the channels may be added in any order, which is the same for every frame of every block.
add_up = compiled(_add_up, fastmath={"reassoc", "nsz", "contract"})
relate = compiled(_relate, fastmath={"reassoc", "nsz", "contract"})
