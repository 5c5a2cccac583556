"""Soft-DTW (Cuturi and Blondel 2017) that `torch.autograd` differentiates."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from gesture_dtw_torch.diagonals import Band, border_value, diagonals, local_costs, soft_diagonals


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
    """
    pairs = len(x)
    n, m = (torch.full((pairs,), side.shape[1], device=x.device) for side in (x, y))
    turned = x.permute(1, 2, 0).contiguous(), y.permute(1, 2, 0).contiguous()
    return SoftLanes.apply(*turned, n, m, None, x.new_full((pairs,), gamma), cost)


class SoftLanes(torch.autograd.Function):
    """Soft accumulated costs of lanes; the backward pass is Cuturi and Blondel's second recursion."""

    @staticmethod
    def forward(
        context: Any, x: Tensor, y: Tensor, n: Tensor, m: Tensor, band: Band | None, gamma: Tensor, cost: str
    ) -> Tensor:
        """(P,) values of (n_max, C, P) with (m_max, C, P)."""
        values, table = soft_diagonals(x, y, n, m, band, gamma, cost, keep=True)
        context.save_for_backward(x, y, n, m, gamma, table)
        context.cost = cost
        return values

    @staticmethod
    def backward(context: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients with respect to x and y."""
        x, y, n, m, gamma, table = context.saved_tensors
        rows, columns, lanes = len(x), len(y), x.shape[2]
        flipped = y.flip(0)
        of_x, of_flipped = torch.zeros_like(x), torch.zeros_like(y)
        # Row i of a diagonal lies at i + 1 in the table, and at i in the arrays of this pass.
        nothing = x.new_zeros((rows + 1, lanes))
        moved, later = nothing, nothing  # of diagonals k + 1 and k + 2
        inner = x.new_full((rows + 1, lanes), border_value(x))
        after, beyond = inner, inner  # their values less their own local costs
        for k, first, stop, window in reversed(list(diagonals(rows, columns))):
            own = table[k, first + 1 : stop + 1]
            total = (
                (torch.arange(first, stop, device=x.device)[:, None] == n - 1) & (n + m - 2 == k)
            ) * upstream
            for weight, value, shift in ((moved, after, 1), (moved, after, 0), (later, beyond, 1)):
                part = slice(first + shift, stop + shift)
                total = total + weight[part] * torch.exp(((value[part] - own) / gamma).clamp_(max=0))
            x_part, y_part = x[first:stop], flipped[window]
            cost = local_costs(x_part, y_part, context.cost)
            slope = _slope(x_part - y_part, cost, context.cost) * total[:, None]
            of_x[first:stop] += slope
            of_flipped[window] -= slope
            later, beyond = moved, after
            moved, after = nothing.clone(), inner.clone()
            moved[first:stop], after[first:stop] = total, own - cost
        return of_x, of_flipped.flip(0), None, None, None, None, None


def _slope(difference: Tensor, local: Tensor, cost: str) -> Tensor:
    """(K, C, P) derivative of the local cost; zero where a cost has a kink."""
    if cost == "absolute":
        return torch.sign(difference)
    if cost == "squared":
        return 2 * difference
    safe = torch.where(local > 0, local, torch.ones_like(local))
    return torch.where(local[:, None] > 0, difference / safe[:, None], torch.zeros_like(difference))
