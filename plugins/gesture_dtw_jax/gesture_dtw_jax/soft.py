"""Soft-DTW (Cuturi and Blondel 2017) by anti-diagonals: values that JAX can differentiate."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from gesture_core.dtw.batches import UNREACHED
from gesture_dtw_jax.hard import local_cost
from gesture_dtw_jax.tiles import Tile


def soft_dtw(x: Array, y: Array, gamma: float = 1.0, cost: str = "squared") -> Array:
    """Soft-DTW of each pair of a batch; works under `jax.jit`, `jax.grad` and `jax.vmap`.

    Parameters
    ----------
    x, y : (P, n, C) and (P, m, C) float arrays
    gamma : float
    cost : "absolute", "squared" or "euclidean"
        Over the C dimensions, which are warped together.

    Returns
    -------
    (P,) array
        In the dtype of the series: float32 loses about its precision times the accumulated cost over
        ``gamma`` in the weight of each step; under ``jax.enable_x64`` pass float64 series.
    """
    pairs = x.shape[0]
    n, m = jnp.full(pairs, x.shape[1]), jnp.full(pairs, y.shape[1])
    turned = (jnp.moveaxis(x, 0, 2), jnp.moveaxis(y, 0, 2))
    return soft_lanes(*turned, n, m, None, None, jnp.full(pairs, gamma, x.dtype), cost)


@partial(jax.jit, static_argnames="cost")
def soft_tile(tile: Tile[Array], cost: str) -> Array:
    """(W,) soft accumulated cost at each lane's own last cell."""
    assert tile.gamma is not None
    return soft_lanes(tile.x, tile.y, tile.n, tile.m, tile.low, tile.high, tile.gamma, cost)


@partial(jax.jit, static_argnames="cost")
def soft_tile_gradients(tile: Tile[Array], cost: str) -> tuple[Array, Array, Array]:
    """(W,), (T, C, W), (T, C, W): values, and their gradients with respect to x and y."""

    def values(x: Array, y: Array) -> Array:
        assert tile.gamma is not None
        return soft_lanes(x, y, tile.n, tile.m, tile.low, tile.high, tile.gamma, cost)

    found, pull = jax.vjp(values, tile.x, tile.y)
    return found, *pull(jnp.ones_like(found))


def soft_lanes(
    x: Array, y: Array, n: Array, m: Array, low: Array | None, high: Array | None, gamma: Array, cost: str
) -> Array:
    """(P,) soft accumulated cost of (n_max, C, P) with (m_max, C, P), each lane up to its lengths."""
    rows, columns, lanes = x.shape[0], y.shape[0], x.shape[2]
    border = jnp.asarray(UNREACHED[x.dtype], x.dtype)
    index = jnp.arange(rows)
    # Diagonal k meets row i in column k - i: row i of a window into the reversed, padded y.
    flipped = jnp.pad(y[::-1], ((rows, rows), (0, 0), (0, 0)))

    def diagonal(carry: tuple[Array, Array, Array], k: Array) -> tuple[tuple[Array, Array, Array], None]:
        last, before, result = carry
        column = k - index[:, None]
        inside = (column >= 0) & (column < columns)
        if low is not None and high is not None:
            inside &= (column >= low) & (column < high)
        window = lax.dynamic_slice_in_dim(flipped, rows + columns - 1 - k, rows)
        least = soft_least(last[:-1], last[1:], before[:-1], gamma)
        # A cost outside the table may be infinite, and must not reach the gradient.
        safe = jnp.where(inside[:, None], x, window)
        one, other = ([side[:, c] for c in range(x.shape[1])] for side in (safe, window))
        now = jnp.where(inside, local_cost(one, other, cost) + least, border)
        result = jnp.where(n + m - 2 == k, jnp.take_along_axis(now, (n - 1)[None], axis=0)[0], result)
        shifted = jnp.concatenate([jnp.full((1, lanes), border), now])
        return (shifted, last, result), None

    empty = jnp.full((rows + 1, lanes), border)
    start = (empty, empty.at[0].set(0), jnp.zeros(lanes, x.dtype))
    # Backwards each diagonal is computed anew from the two before it: all that is kept of it.
    again = jax.checkpoint(diagonal, prevent_cse=False)
    (_, _, result), _ = lax.scan(again, start, jnp.arange(rows + columns - 1))
    return result


def soft_least(up: Array, left: Array, diagonal: Array, gamma: Array) -> Array:
    """``-gamma * log(sum(exp(-v / gamma)))`` of three."""
    least = lax.stop_gradient(jnp.minimum(jnp.minimum(up, left), diagonal))
    total = sum(jnp.exp((least - value) / gamma) for value in (up, left, diagonal))
    return least - gamma * jnp.log(total)
