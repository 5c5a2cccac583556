"""Hard warping: blocks of rows, unrolled, over columns, every operation across all lanes."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from gesture_core.dtw.lanes import unreached
from gesture_dtw_jax.tiles import ROWS, Tile


@partial(jax.jit, static_argnames="cost")
def hard_tile(tile: Tile, cost: str) -> Array:
    """(W,) accumulated cost at the tile's last cell."""
    low, high = tile.low, tile.high
    outside = jnp.full_like(tile.x[0, 0], unreached(tile.x.dtype))
    border = jnp.broadcast_to(outside, (len(tile.y), *outside.shape))

    def block(index: Array, above: Array) -> Array:
        x = lax.dynamic_slice_in_dim(tile.x, index * ROWS, ROWS)
        first = tile.start[index]
        corner = jnp.where(first > 0, above[jnp.maximum(first - 1, 0)], outside)
        corner = jnp.where(index == 0, jnp.zeros_like(corner), corner)

        def column(j: Array, carry: tuple) -> tuple:
            left, diagonal, below = carry
            up, now = above[j], []
            for row in range(ROWS):
                value = local_cost(x[row], tile.y[j], cost)
                value += jnp.minimum(jnp.minimum(up, diagonal), left[row])
                if low is not None and high is not None:
                    value = jnp.where(in_band(low, high, index * ROWS + row, j), value, outside)
                diagonal, up = left[row], value
                now.append(value)
            return tuple(now), above[j], lax.dynamic_update_index_in_dim(below, up, j, 0)

        carry = ((outside,) * ROWS, corner, border)
        return lax.fori_loop(first, tile.stop[index], column, carry)[2]

    return lax.fori_loop(0, tile.blocks, block, border)[tile.columns - 1]


def local_cost(x: Array, y: Array, cost: str) -> Array:
    """(W,) cost of (C, W) frames, summed over the dimensions in their order."""
    difference = x - y
    terms = jnp.abs(difference) if cost == "absolute" else difference * difference
    total = terms[0] if len(terms) == 1 else terms.sum(axis=0)
    return root(total) if cost == "euclidean" else total


@jax.custom_jvp
def root(value: Array) -> Array:
    """The square root, with slope zero at zero: the choice among its subgradients."""
    return jnp.sqrt(value)


@root.defjvp
def _root_slope(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    value = jnp.sqrt(primals[0])
    return value, jnp.where(value > 0, 0.5 / jnp.where(value > 0, value, 1), 0) * tangents[0]


def in_band(low: Array, high: Array, row: Array, column: Array) -> Array:
    """(W,) whether the cell lies inside each lane's band."""
    return (column >= low[row]) & (column < high[row])
