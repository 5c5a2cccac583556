"""Distance kernel on Torch: anti-diagonals of many lanes, on the CPU or a CUDA device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from gesture_core.dtw.lanes import GradientLaneKernel, Lanes
from gesture_core.plugin.abilities import DeviceKernel, SubsequenceKernel
from gesture_core.plugin.interfaces import Subsequences
from gesture_dtw_torch.diagonals import Band, eager_step, hard_diagonals, soft_diagonals
from gesture_dtw_torch.soft import soft_lanes


@dataclass(frozen=True)
class TorchKernel(GradientLaneKernel, DeviceKernel, SubsequenceKernel):
    """Warping distances in Torch, in the dtype of the batches.

    Attributes
    ----------
    where : str
        A Torch device, or ``"auto"`` for the first CUDA device and else the CPU.
    compiled : bool
        Fuse each diagonal of hard warpings with `torch.compile`: needs a C++ compiler and some
        seconds at the first call, and pays for many pairs of several dimensions.
    """

    where: str = "auto"
    compiled: bool = False

    lane_cells = 1 << 18
    lane_count = 4096

    def __post_init__(self) -> None:
        try:
            torch.device("cpu" if self.where == "auto" else self.where)
        except (RuntimeError, TypeError) as error:
            raise ValueError(f"where {self.where!r} is no device of Torch") from error

    @cached_property
    def device(self) -> str:
        """The Torch device that computes."""
        if self.where != "auto":
            return self.where
        return "cuda" if torch.cuda.is_available() else "cpu"

    def tile_size(self, frames: int, width: int) -> int:
        """Many dimensions take as many lanes as four: each operation of Torch has its price."""
        return super().tile_size(frames, min(width, 4))

    def warp(self, lanes: Lanes) -> np.ndarray:
        """(P,) accumulated costs."""
        tensors = self._tensors(lanes)
        with torch.no_grad():
            if lanes.gamma is None and self.compiled:
                from gesture_dtw_torch.compiled import compiled_diagonals

                values = compiled_diagonals(*tensors, lanes.cost)
            elif lanes.gamma is None:
                x, y, n, m, band = tensors
                values = hard_diagonals(x, y.flip(0), n, m, band, eager_step(x, lanes.cost))
            else:
                values, _ = soft_diagonals(*tensors, self._tensor(lanes.gamma), lanes.cost)
        return values.cpu().numpy()

    def warp_gradients(self, lanes: Lanes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(P,), (n_max, C, P), (m_max, C, P): soft accumulated costs and their gradients."""
        assert lanes.gamma is not None
        x, y, *rest = self._tensors(lanes)
        x.requires_grad_(), y.requires_grad_()
        values = soft_lanes(x, y, *rest, self._tensor(lanes.gamma), lanes.cost)
        of_x, of_y = (slope.cpu().numpy() for slope in torch.autograd.grad(values.sum(), (x, y)))
        return values.detach().cpu().numpy(), of_x, of_y

    def subsequences(self, examples: Sequence[np.ndarray], floor: float) -> Subsequences:
        """A stream in which ``examples`` are looked for, in float32."""
        from gesture_dtw_torch.subsequences import TorchSubsequences

        return TorchSubsequences(examples, floor, self.device)

    def _tensors(
        self, lanes: Lanes
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, Band | None]:
        band = None
        if lanes.low is not None and lanes.high is not None:
            band = Band(self._tensor(lanes.low), self._tensor(lanes.high))
        x, y = self._tensor(lanes.x), self._tensor(lanes.y)
        return x, y, self._tensor(lanes.n), self._tensor(lanes.m), band

    def _tensor(self, array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device)
