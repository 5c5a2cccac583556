"""Distance kernel on JAX: tiles of fixed shape, so that compilations stay few."""

from __future__ import annotations

import jax
import numpy as np

from gesture_core.dtw.lanes import LaneKernel, Lanes
from gesture_dtw_jax.hard import hard_tile
from gesture_dtw_jax.soft import soft_tile
from gesture_dtw_jax.tiles import WIDTHS, make_tile


class JaxKernel(LaneKernel):
    """Warping distances on JAX's default device, in the dtype of the batches.

    One program is compiled for each bucket of lengths (a power of two), tile width, cost, dtype,
    and presence of a band and of softness; loops stop at the tile's own lengths.
    """

    lane_count = WIDTHS[-1]

    @property
    def device(self) -> str:
        """``"cpu"``, ``"gpu"`` or ``"tpu"``."""
        return jax.default_backend()

    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) accumulated costs."""
        with jax.enable_x64(lanes.x.dtype == np.float64):
            compute = hard_tile if lanes.gamma is None else soft_tile
            return np.asarray(compute(make_tile(lanes), lanes.cost))[: len(lanes)]
