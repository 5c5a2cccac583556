"""Distance kernel on JAX: tiles of fixed shape, so that compilations stay few."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

from gesture_core.dtw.lanes import GradientLaneKernel, Lanes
from gesture_core.plugin.abilities import DeviceKernel, SubsequenceKernel
from gesture_core.plugin.interfaces import Subsequences
from gesture_dtw_jax.hard import hard_tile
from gesture_dtw_jax.soft import soft_tile, soft_tile_gradients
from gesture_dtw_jax.tiles import WIDTHS, make_tile

LANES_TIMES_WIDTH = 2048
"""Upper limit of lanes times dimensions of a tile wider than the narrowest: its blocks stay in the cache."""


class JaxKernel(GradientLaneKernel, DeviceKernel, SubsequenceKernel):
    """Warping distances on JAX's default device, in the dtype of the batches.

    One program is compiled for each bucket of lengths (a power of two), tile width, cost, dtype,
    and presence of a band and of softness; loops stop at the tile's own lengths.
    """

    @property
    def device(self) -> str:
        """``"cpu"``, ``"gpu"`` or ``"tpu"``."""
        return jax.default_backend()

    def tile_size(self, frames: int, width: int) -> int:
        """The widest bucket whose rows of one block stay in the cache."""
        return max((size for size in WIDTHS if size * width <= LANES_TIMES_WIDTH), default=WIDTHS[0])

    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) accumulated costs."""
        with jax.enable_x64(lanes.x.dtype == np.float64):
            compute = hard_tile if lanes.gamma is None else soft_tile
            return np.asarray(compute(make_tile(lanes), lanes.cost))[: len(lanes)]

    def warp_gradients(self, lanes: Lanes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(P,), (n_max, C, P), (m_max, C, P): soft accumulated costs and their gradients."""
        with jax.enable_x64(lanes.x.dtype == np.float64):
            values, of_x, of_y = (np.asarray(a) for a in soft_tile_gradients(make_tile(lanes), lanes.cost))
        count = len(lanes)
        return values[:count], of_x[: len(lanes.x), :, :count], of_y[: len(lanes.y), :, :count]

    def subsequences(self, examples: Sequence[np.ndarray], floor: float) -> Subsequences:
        """A stream in which ``examples`` are looked for, in float32."""
        from gesture_dtw_jax.subsequences import JaxSubsequences

        return JaxSubsequences(examples, floor)
