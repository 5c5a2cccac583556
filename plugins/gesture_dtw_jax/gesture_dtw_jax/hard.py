"""Hard warping: blocks of rows, a diagonal of a block at a time, every operation across all lanes.

Row r of a block stands r columns behind row 0, so that all rows of a step depend on earlier steps
only and are one fused loop over (rows, lanes). What decides the speed on a CPU, found by
measuring: the least of two as a selection (XLA's ``minimum`` spends several instructions on NaN and on the
sign of zero), `STEPS` steps written out (two diagonals that trade places in the loop's carry would
be copied at every step), and barriers between them (XLA would compute each diagonal again inside
the next).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from gesture_core.dtw.batches import FAR, UNREACHED
from gesture_dtw_jax.tiles import ROWS, Tile

STEPS = 3
"""Diagonals that one turn of the loop computes, where copies would show."""
MANY = 8
"""Dimensions from which on local costs hide the copies, and one step compiles in a third of the time."""


barrier: Callable[[Array], Array] = lax.optimization_barrier


@partial(jax.jit, static_argnames="cost")
def hard_tile(tile: Tile[Array], cost: str) -> Array:
    """(W,) accumulated cost at the tile's last cell."""
    frames, channels, width = tile.y.shape
    count = STEPS if channels < MANY else 1
    border = jnp.asarray(UNREACHED[tile.x.dtype], tile.x.dtype)
    # Row r of step k meets column k - r: row r of a window into the reversed y.
    around = ((ROWS + count, ROWS + count), (0, 0), (0, 0))
    flipped = jnp.pad(tile.y[::-1], around, constant_values=FAR[tile.y.dtype])

    def block(index: Array, above: Array) -> Array:
        """The row below a block, given the row above it; both hold column j at j + 1."""
        rows = partial(lax.dynamic_slice_in_dim, start_index=index * ROWS, slice_size=ROWS)
        x = rows(tile.x)
        low = None if tile.low is None else rows(tile.low)
        high = None if tile.high is None else rows(tile.high)
        first = tile.start[index]

        def steps(turn: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            last, before, below = carry
            for step in range(count):
                k = first + turn * count + step
                met = ROWS + count + frames - 1 - k
                # Each dimension by itself: XLA would copy a window that several operations read.
                window = [
                    lax.dynamic_slice(flipped, (met, *met.dtype.type([c, 0])), (ROWS, 1, width))[:, 0]
                    for c in range(channels)
                ]
                best = lesser(lesser(last[1:], before[:-1]), last[:-1])
                now = local_cost([x[:, c] for c in range(channels)], window, cost) + best
                if low is not None and high is not None:
                    column = k - jnp.arange(ROWS, dtype=jnp.int32)[:, None]
                    now = jnp.where((column >= low) & (column < high), now, border)
                entered = lax.dynamic_slice_in_dim(above, k + 2, 1)
                before, last = last, barrier(jnp.concatenate([entered, now]))
                left = jnp.maximum(k - ROWS + 2, 0)
                below = lax.dynamic_update_slice_in_dim(below, last[-1:], left, 0)
            return last, before, below

        empty = jnp.full((ROWS + 1, width), border)
        last = empty.at[0].set(above[first + 1])
        before = empty.at[0].set(above[first])
        turns = (tile.stop[index] - first + ROWS - 1 + count - 1) // count
        below: Array = lax.fori_loop(0, turns, steps, (last, before, jnp.full_like(above, border)))[2]
        # Steps at which the last row has not yet entered the table have left their values here.
        return below.at[0].set(border)

    above = jnp.full((frames + ROWS + count, width), border).at[0].set(0)
    table_end: Array = lax.fori_loop(0, tile.blocks, block, above)
    return table_end[tile.columns]


def lesser(a: Array, b: Array) -> Array:
    """The lesser of two; neither is NaN."""
    return lax.select(a < b, a, b)


def local_cost(x: Sequence[Array], y: Sequence[Array], cost: str) -> Array:
    """Cost of frames, of which C arrays hold a dimension each; summed in the order of the dimensions."""
    total = None
    for one, other in zip(x, y, strict=True):
        difference = one - other
        term = jnp.abs(difference) if cost == "absolute" else difference * difference
        total = term if total is None else total + term
    assert total is not None
    return root(total) if cost == "euclidean" else total


@jax.custom_jvp
def root(value: Array) -> Array:
    """The square root, with slope zero at zero: the choice among its subgradients."""
    return jnp.sqrt(value)


@root.defjvp
def _root_slope(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    value = jnp.sqrt(primals[0])
    return value, jnp.where(value > 0, 0.5 / jnp.where(value > 0, value, 1), 0) * tangents[0]
