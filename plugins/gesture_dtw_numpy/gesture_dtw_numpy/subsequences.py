"""Examples inside a stream: all cells of a column at once, as none depends on another one of its column."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gesture_core.dtw.subsequence import BORDER, UNREACHABLE, SubsequenceState


class NumpySubsequences(SubsequenceState):
    """The last two columns of costs and lengths, and the last local costs."""

    def __init__(self, examples: Sequence[np.ndarray], floor: float) -> None:
        super().__init__(examples, floor)
        count = self.cells.shape[1]
        self._one, self._two = (np.full(count, UNREACHABLE) for _ in range(2))
        self._one[self.first - 1] = 0
        self._length_one, self._length_two = (np.zeros(count, np.int32) for _ in range(2))
        self._local = np.zeros(count)

    def advance(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B, N) accumulated costs and lengths."""
        costs: np.ndarray = np.empty((len(frames), len(self.frames)))
        lengths: np.ndarray = np.empty(costs.shape, np.int32)
        for place, frame in enumerate(frames):
            local = ((frame[:, None] - self.cells) ** 2).sum(axis=0)
            ways = np.stack(
                [
                    self._one[1:-1] + local[2:],
                    self._one[:-2] + (local[1:-1] + local[2:]),
                    self._two[1:-1] + (self._local[2:] + local[2:]) / 2,
                ]
            )
            spans = np.stack(
                [self._length_one[1:-1] + 1, self._length_one[:-2] + 1, self._length_two[1:-1] + 2]
            )
            best = ways.argmin(axis=0)[None]
            now, length = np.full(len(local), UNREACHABLE), np.zeros(len(local), np.int32)
            now[BORDER:] = np.take_along_axis(ways, best, axis=0)[0]
            length[BORDER:] = np.take_along_axis(spans, best, axis=0)[0]
            now[self.first - 1], now[self.first - 2] = 0, UNREACHABLE
            length[self.first - 1] = 0
            costs[place], lengths[place] = now[self.end], length[self.end]
            self._two, self._one = self._one, now
            self._length_two, self._length_one = self._length_one, length
            self._local = local
        return costs, lengths
