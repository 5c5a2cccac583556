"""Examples inside a stream: all cells of a column at once, on the CPU or a CUDA device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from gesture_core.dtw.subsequence import BORDER, UNREACHABLE, SubsequenceState

BLOCK = 64
"""Frames whose local costs are computed at once."""


class TorchSubsequences(SubsequenceState):
    """The last two columns of costs and lengths, and the last local costs, in float32."""

    def __init__(self, examples: Sequence[np.ndarray], floor: float, device: str) -> None:
        super().__init__(examples, floor, np.float32)
        self._device, count = device, self.cells.shape[1]
        self._cells = self._tensor(self.cells)
        self._begin, self._end = self._tensor(self.first - 1), self._tensor(self.end)
        self._one, self._two = (torch.full((count,), UNREACHABLE, device=device) for _ in range(2))
        self._one[self._begin] = 0
        self._length_one, self._length_two = (
            torch.zeros(count, dtype=torch.int32, device=device) for _ in range(2)
        )
        self._local = torch.zeros(count, device=device)

    @torch.no_grad()
    def advance(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B, N) accumulated costs and lengths."""
        costs = torch.empty((len(frames), len(self.frames)), device=self._device)
        lengths = torch.empty(costs.shape, dtype=torch.int32, device=self._device)
        for start in range(0, len(frames), BLOCK):
            some = self._tensor(frames[start : start + BLOCK])
            local = torch.zeros((len(some), len(self._local)), device=self._device)
            for channel, cells in zip(some.T, self._cells, strict=True):
                local += (channel[:, None] - cells).square_()
            for at, own in enumerate(local, start):
                self._step(own)
                costs[at], lengths[at] = self._one[self._end], self._length_one[self._end]
        return costs.cpu().numpy().astype(np.float64), lengths.cpu().numpy()

    def _step(self, local: torch.Tensor) -> None:
        """One frame of the stream, whose cost at each cell is ``local``."""
        both = self._one[1:-1] + local[BORDER:]
        skip = self._one[:-2] + (local[1:-1] + local[BORDER:])
        wait = self._two[1:-1] + (self._local[BORDER:] + local[BORDER:]) / 2
        skipped = skip < both
        least = torch.where(skipped, skip, both)
        waited = wait < least
        length = torch.where(skipped, self._length_one[:-2], self._length_one[1:-1]) + 1
        # The columns of two frames ago are used again.
        now, span = self._two, self._length_two
        span[BORDER:] = torch.where(waited, self._length_two[1:-1] + 2, length)
        now[BORDER:] = torch.where(waited, wait, least)
        now[self._begin], now[self._begin - 1], span[self._begin] = 0, UNREACHABLE, 0
        self._one, self._two = now, self._one
        self._length_one, self._length_two = span, self._length_one
        self._local = local

    def _tensor(self, array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self._device)
