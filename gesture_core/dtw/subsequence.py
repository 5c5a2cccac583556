"""Where in a stream an example is performed: subsequence warping with an open begin and end.

A path (Sakurai, Faloutsos and Yamamuro 2007) advances by one frame of both, by one frame of the stream and
two of the example, or by two of the stream and one of the example, so that a subsequence lasts between half
and twice the example. Each frame of the example is paid once: a step over two of them costs both, a step
over two frames of the stream costs their mean. The accumulated cost over the m frames of an example is
therefore comparable between all paths, wherever they begin.

That mean squared difference is divided by ``sqrt((v + floor) * (w + floor))``, the variances of the example
and of the subsequence around their own means, summed over the channels: two movements that have nothing in
common are then about as far apart whether they are large or small.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gesture_core.dtw.distances import CPU_ORDER
from gesture_core.errors import InputError, PluginError
from gesture_core.plugin import registry
from gesture_core.plugin.abilities import SubsequenceKernel

__all__ = ["BORDER", "UNREACHABLE", "SubsequenceState"]

UNREACHABLE = 1e30
"""Accumulated cost of what no path has reached; from a tenth of it on, a cost counts as such."""
BORDER = 2
"""Cells before each example: one that every path begins in, and one that none reaches."""


class SubsequenceState(ABC):
    """What kernels share: the examples end to end, and the running sums that variances come from.

    Parameters
    ----------
    examples : sequence of (m, D) arrays
    floor : float
        Added to both variances.
    dtype : numpy float type
        In which costs are computed.

    Attributes
    ----------
    cells : (D, K) array
        The frames of all examples end to end, each behind `BORDER` cells of zeros.
    first, end : (N,) int64
        Cell of each example's first frame, and of its last.
    frames : (N,) int64
        How many each example has.

    Raises
    ------
    InputError
        Where there is no example, or one is empty, not finite, or of another width.
    """

    def __init__(self, examples: Sequence[np.ndarray], floor: float, dtype: type = np.float64) -> None:
        if not examples:
            raise InputError("no example to look for", code="E_EMPTY")
        for number, example in enumerate(examples):
            if example.ndim != 2 or 0 in example.shape or example.shape[1] != examples[0].shape[1]:
                raise InputError(f"example {number} has shape {example.shape}", code="E_DIMENSIONS")
            if not np.isfinite(example).all():
                raise InputError(f"example {number} holds NaN or infinity", code="E_NOT_FINITE")
        self.floor = floor
        self.frames = np.array([len(example) for example in examples], np.int64)
        self.end = np.cumsum(self.frames + BORDER) - 1
        self.first = self.end - self.frames + 1
        width = examples[0].shape[1]
        self.cells: np.ndarray = np.zeros((width, int(self.end[-1]) + 1), dtype)
        for example, first, end in zip(examples, self.first, self.end, strict=True):
            self.cells[:, first : end + 1] = example.T
        self.spread = np.array([example.var(axis=0, dtype=np.float64).sum() for example in examples])
        self._horizon = 2 * int(self.frames.max()) + 1
        # Sums over all frames before each of the last ones: of values, and of their squares together.
        self._sums, self._squares = np.zeros((1, width)), np.zeros(1)

    @abstractmethod
    def advance(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B, N) accumulated costs at the examples' last frames, and (B, N) int32 lengths of the paths."""

    def push(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Take the next (B, D) ``frames``; see `gesture_core.plugin.interfaces.Subsequences`."""
        frames = np.ascontiguousarray(frames)  # sums over the channels depend on how they lie
        if frames.ndim != 2 or frames.shape[1] != len(self.cells):
            raise InputError(f"frames of shape {frames.shape}", code="E_DIMENSIONS")
        before = len(self._squares)
        self._sums, self._squares = self.running(frames)
        costs, lengths = self.advance(frames.astype(self.cells.dtype, copy=False))
        found = self.relative(costs, lengths, before)
        self._sums, self._squares = self._sums[-self._horizon :], self._squares[-self._horizon :]
        return found

    def running(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The sums as they are, and after each of the (B, D) frames.

        Added one after the other, from the last sum on: the same bits in whatever blocks frames come.
        """
        values = frames.astype(np.float64)
        sums = np.concatenate([self._sums, np.cumsum(np.vstack([self._sums[-1:], values]), 0)[1:]])
        squares = np.concatenate([self._squares[-1:], (values**2).sum(axis=1)])
        return sums, np.concatenate([self._squares, np.cumsum(squares)[1:]])

    def relative(self, costs: np.ndarray, lengths: np.ndarray, before: int) -> tuple[np.ndarray, np.ndarray]:
        """(B, N) distances, infinite where no path ends, and lengths, 0 there.

        Row ``before + b`` of the running sums is that at the end of frame b.
        """
        reached = costs < UNREACHABLE / 10
        lengths = np.where(reached, lengths, 0).astype(np.int32)
        ends = before + np.arange(len(lengths))[:, None]
        count = np.maximum(lengths, 1)
        means = (self._sums[ends] - self._sums[ends - lengths]) / count[..., None]
        whole = (self._squares[ends] - self._squares[ends - lengths]) / count
        variances = np.maximum(whole - (means**2).sum(axis=-1), 0)
        size = np.sqrt((self.spread + self.floor) * (variances + self.floor))
        distances = np.full(costs.shape, np.inf)
        np.divide(costs / self.frames, size, out=distances, where=reached & (size > 0))
        return distances, lengths


def choose_subsequence_kernel(
    name: str = "auto", options: Mapping[str, Mapping[str, Any]] | None = None
) -> tuple[str, SubsequenceKernel]:
    """Name and kernel: the one called ``name``, or the fastest one that finds examples inside a stream.

    Raises
    ------
    PluginError
        Where the named kernel is unknown or cannot do it.
    """
    usable = registry().names("kernel", usable=True)
    for candidate in CPU_ORDER if name == "auto" else (name,):
        if name == "auto" and candidate not in usable:
            continue
        kernel = registry().make("kernel", candidate, (options or {}).get(candidate))
        if isinstance(kernel, SubsequenceKernel):
            return candidate, kernel
    raise PluginError(
        f"distance kernel {name!r} does not find examples inside a stream",
        remedy="--kernel auto, numba, numpy, jax or torch",
        code="E_KERNEL_UNSUPPORTED",
    )


def reference_subsequences(
    stream: np.ndarray, example: np.ndarray, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    """The float64 reference: (T,) distances and lengths of the best subsequence that ends in each frame."""
    x, y = np.asarray(stream, np.float64), np.asarray(example, np.float64)
    cost = ((x[:, None] - y[None]) ** 2).sum(axis=2)
    table, begin = np.full(cost.shape, np.inf), np.zeros(cost.shape, np.int64)
    for t in range(len(x)):
        for j in range(len(y)):
            # A path enters the example before its first frame, at any time, for nothing.
            ways = []
            for stream_steps, example_steps in ((1, 1), (1, 2), (2, 1)):
                s, i = t - stream_steps, j - example_steps
                if s < -1 or i < -1:
                    continue
                twice = stream_steps == 2
                paid = (cost[t - 1, j] + cost[t, j]) / 2 if twice else cost[t, i + 1 : j + 1].sum()
                if i == -1:
                    ways.append((paid, s + 1))
                elif s >= 0:
                    ways.append((table[s, i] + paid, begin[s, i]))
            for value, start in ways:
                if value < table[t, j]:
                    table[t, j], begin[t, j] = value, start
    distances, lengths = np.full(len(x), np.inf), np.zeros(len(x), np.int64)
    spread = y.var(axis=0).sum()
    for t in np.flatnonzero(np.isfinite(table[:, -1])).tolist():
        start = begin[t, -1]
        own = x[start : t + 1].var(axis=0).sum()
        size = np.sqrt((spread + floor) * (own + floor))
        lengths[t] = t + 1 - start
        if size > 0:
            distances[t] = table[t, -1] / len(y) / size
    return distances, lengths
