"""Examples inside a stream: all cells of a column at once, frame after frame in one compiled loop."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from gesture_core.dtw.subsequence import BORDER, UNREACHABLE, SubsequenceState

BLOCK = 64
"""Frames of one call: one program for all blocks, whose loop stops at their own number of frames."""
Columns = tuple[Array, Array, Array, Array, Array]


class JaxSubsequences(SubsequenceState):
    """The last two columns of costs and lengths, and the last local costs, on JAX's default device."""

    def __init__(self, examples: Sequence[np.ndarray], floor: float) -> None:
        super().__init__(examples, floor, np.float32)
        count = self.cells.shape[1]
        far, none = jnp.full(count, UNREACHABLE, jnp.float32), jnp.zeros(count, jnp.int32)
        begins = np.zeros(count, bool)
        begins[self.first - 1] = True
        self._columns: Columns = (
            jnp.where(begins, 0, far), far, none, none, jnp.zeros(count, jnp.float32)
        )  # fmt: skip
        self._fixed = (jnp.asarray(self.cells), jnp.asarray(begins), jnp.asarray(self.end))

    def advance(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B, N) accumulated costs and lengths."""
        costs: np.ndarray = np.empty((len(frames), len(self.frames)))
        lengths: np.ndarray = np.empty(costs.shape, np.int32)
        for start in range(0, len(frames), BLOCK):
            some = frames[start : start + BLOCK]
            padded = np.zeros((BLOCK, frames.shape[1]), np.float32)
            padded[: len(some)] = some
            self._columns, found, spans = _follow(self._columns, padded, len(some), *self._fixed)
            costs[start : start + BLOCK] = np.asarray(found)[: len(some)]
            lengths[start : start + BLOCK] = np.asarray(spans)[: len(some)]
        return costs, lengths


@jax.jit
def _follow(
    columns: Columns, frames: Array, count: int, cells: Array, begins: Array, ends: Array
) -> tuple[Columns, Array, Array]:
    """The columns after ``count`` of the frames, and what stands at the examples' ends after each."""

    def step(at: Array, carry: tuple[Columns, Array, Array]) -> tuple[Columns, Array, Array]:
        (one, two, length_one, length_two, last), found, spans = carry
        local = jnp.square(frames[at][:, None] - cells).sum(axis=0)
        both = one[1:-1] + local[BORDER:]
        skip = one[:-2] + (local[1:-1] + local[BORDER:])
        wait = two[1:-1] + (last[BORDER:] + local[BORDER:]) / 2
        skipped = skip < both
        least = jnp.where(skipped, skip, both)
        waited = wait < least
        length = jnp.where(skipped, length_one[:-2], length_one[1:-1]) + 1
        length = jnp.where(waited, length_two[1:-1] + 2, length)
        # The cell before an example's first one is where every path begins; the one before that is
        # the last of another example's border, which nothing may leave.
        never = jnp.concatenate([begins[1:], begins[:1]])
        now = jnp.pad(jnp.where(waited, wait, least), (BORDER, 0), constant_values=UNREACHABLE)
        now = jnp.where(begins, 0, jnp.where(never, UNREACHABLE, now))
        length = jnp.where(begins, 0, jnp.pad(length, (BORDER, 0)))
        columns = (now, one, length, length_one, local)
        return columns, found.at[at].set(now[ends]), spans.at[at].set(length[ends])

    costs, lengths = (jnp.zeros((len(frames), len(ends)), kind) for kind in (jnp.float32, jnp.int32))
    done: tuple[Columns, Array, Array] = lax.fori_loop(0, count, step, (columns, costs, lengths))
    return done
