"""Distance kernel on Torch: anti-diagonals of many lanes, on the CPU or a CUDA device."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from gesture_core.dtw.lanes import LaneKernel, Lanes
from gesture_dtw_torch.diagonals import Band, hard_diagonals, soft_diagonals


@dataclass(frozen=True)
class TorchKernel(LaneKernel):
    """Warping distances in Torch, in the dtype of the batches.

    Attributes
    ----------
    where : str
        A Torch device, or ``"auto"`` for the first CUDA device and else the CPU.
    """

    where: str = "auto"

    lane_count = 1024

    @cached_property
    def device(self) -> str:
        """The Torch device that computes."""
        if self.where != "auto":
            return self.where
        return "cuda" if torch.cuda.is_available() else "cpu"

    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) accumulated costs."""
        x, y, n, m = (self._tensor(array) for array in (lanes.x, lanes.y, lanes.n, lanes.m))
        band = None
        if lanes.low is not None and lanes.high is not None:
            band = Band(self._tensor(lanes.low), self._tensor(lanes.high))
        with torch.no_grad():
            if lanes.gamma is None:
                values = hard_diagonals(x, y, n, m, band, lanes.cost)
            else:
                values, _ = soft_diagonals(x, y, n, m, band, self._tensor(lanes.gamma), lanes.cost)
        return values.cpu().numpy()

    def _tensor(self, array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device)
