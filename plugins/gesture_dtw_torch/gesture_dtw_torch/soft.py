"""Soft-DTW (Cuturi and Blondel 2017) that `torch.autograd` differentiates."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from gesture_dtw_torch.diagonals import Band, border_value, diagonals, soft_diagonals, soft_shares


def soft_dtw(x: Tensor, y: Tensor, gamma: float = 1.0, cost: str = "squared") -> Tensor:
    """Soft-DTW of each pair of a batch, differentiable once.

    Parameters
    ----------
    x, y : (P, n, C) and (P, m, C) float tensors
    gamma : float
    cost : "absolute", "squared" or "euclidean"
        Over the C dimensions, which are warped together.

    Returns
    -------
    (P,) tensor
        Values and gradients in the dtype of the series, accumulated in float64.
    """
    pairs = len(x)
    n, m = (torch.full((pairs,), side.shape[1], device=x.device) for side in (x, y))
    turned = x.permute(1, 2, 0).contiguous(), y.permute(1, 2, 0).contiguous()
    return soft_lanes(*turned, n, m, None, x.new_full((pairs,), gamma), cost)


class SoftLanes(torch.autograd.Function):
    """Soft accumulated costs of lanes; the backward pass is Cuturi and Blondel's second recursion.

    In float64 whatever the dtype of the series: paths are weighed by differences of accumulated
    costs. The recursion hands on the shares that each cell's soft minimum gives to its predecessors.
    """

    @staticmethod
    def forward(
        context: Any, x: Tensor, y: Tensor, n: Tensor, m: Tensor, band: Band | None, gamma: Tensor, cost: str
    ) -> Tensor:
        """(P,) values of (n_max, C, P) with (m_max, C, P)."""
        exact = x.double(), y.double(), n, m, band, gamma.double(), cost
        values, table = soft_diagonals(*exact, keep=True)
        context.save_for_backward(x, y, n, m, gamma, table)
        context.cost = cost
        return values.to(x.dtype)

    @staticmethod
    def backward(context: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients with respect to x and y."""
        x, y, n, m, gamma, table = context.saved_tensors
        dtype, x, y, gamma = x.dtype, x.double(), y.double(), gamma.double()
        rows, columns, lanes = len(x), len(y), x.shape[2]
        flipped = y.flip(0)
        of_x, of_flipped = torch.zeros_like(x), torch.zeros_like(y)
        # As in the table, row i of a diagonal lies at i + 1; row 0 takes what goes to the border.
        moved, before, beyond = (x.new_zeros((rows + 1, lanes)) for _ in range(3))
        start = x.new_full((2, rows + 1, lanes), border_value(x))
        start[0, 0] = 0
        for k, first, stop, window in reversed(list(diagonals(rows, columns))):
            last, earlier = (table[k - step] if k >= step else start[k - step + 2] for step in (1, 2))
            ends = (torch.arange(first, stop, device=x.device)[:, None] == n - 1) & (n + m - 2 == k)
            total = moved[first + 1 : stop + 1] + ends * upstream
            parts = soft_shares(last[first:stop], last[first + 1 : stop + 1], earlier[first:stop], gamma)
            before[first:stop] += total * parts[0]
            before[first + 1 : stop + 1] += total * parts[1]
            beyond[first:stop] += total * parts[2]
            x_part, y_part = x[first:stop], flipped[window]
            slope = _slope(x_part - y_part, context.cost) * total[:, None]
            of_x[first:stop] += slope
            of_flipped[window] -= slope
            moved, before, beyond = before, beyond, moved.zero_()
        return of_x.to(dtype), of_flipped.flip(0).to(dtype), None, None, None, None, None


soft_lanes: Callable[..., Tensor] = SoftLanes.apply
"""``soft_lanes(x, y, n, m, band, gamma, cost)``: (P,) values that autograd differentiates."""


def _slope(difference: Tensor, cost: str) -> Tensor:
    """(K, C, P) derivative of the local cost; zero where a cost has a kink."""
    if cost == "absolute":
        return torch.sign(difference)
    if cost == "squared":
        return 2 * difference
    local = difference.square().sum(1, keepdim=True).sqrt_()
    return difference / local.masked_fill_(local == 0, 1)
