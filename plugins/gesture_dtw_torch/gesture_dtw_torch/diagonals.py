"""The warping table by anti-diagonals: row i of diagonal k is the cell (i, k - i).

A diagonal is stored one row down, below a border row, so that the three predecessors of all its
cells are three slices of the two diagonals before it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from gesture_core.dtw.batches import UNREACHED


class Band(NamedTuple):
    """First column and column past the last of each row, both (n_max, P) int32."""

    low: Tensor
    high: Tensor


class Diagonal(NamedTuple):
    """The rows ``first`` to ``stop`` of diagonal ``k``, and the frames of y that they meet."""

    k: int
    first: int
    stop: int
    y: slice


def diagonals(rows: int, columns: int) -> Iterator[Diagonal]:
    """All diagonals of a table, for a reversed y."""
    for k in range(rows + columns - 1):
        first, stop = max(0, k - columns + 1), min(rows, k + 1)
        skip = columns - 1 - k
        yield Diagonal(k, first, stop, slice(first + skip, stop + skip))


def border_value(x: Tensor) -> float:
    """What cells hold that no path reaches."""
    return UNREACHED[np.dtype(str(x.dtype).removeprefix("torch."))]


def local_costs(x: Tensor, y: Tensor, cost: str) -> Tensor:
    """(K, P) costs of (K, C, P) frames, summed over the dimensions in their order."""
    total = None
    for c in range(x.shape[1]):
        term = x[:, c] - y[:, c]
        term = term.abs_() if cost == "absolute" else term.mul_(term)
        total = term if total is None else total.add_(term)
    assert total is not None
    return total.sqrt_() if cost == "euclidean" else total


Step = Callable[[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor], None]
"""``step(up, left, diagonal, x, y, out)``: the cells of one diagonal from their predecessors and frames."""


def hard_diagonals(
    x: Tensor, flipped: Tensor, n: Tensor, m: Tensor, band: Band | None, step: Step, ahead: int = 0
) -> Tensor:
    """(P,) accumulated cost of each lane at its own last cell, for a reversed y.

    With ``ahead``, the diagonals begin that many rows into their memory.
    """
    rows, columns, lanes = x.shape[0], flipped.shape[0], x.shape[2]
    # Three diagonals in turn. No cell beside a diagonal is ever read but those of the border, which
    # no diagonal has written yet, and the one in the first row, which all leave alone.
    last, before, now = (x.new_full((ahead + rows + 1, lanes), border_value(x))[ahead:] for _ in range(3))
    before[0] = 0
    result = x.new_empty(len(n))
    ends = _ends(n, m)
    for k, first, stop, window in diagonals(rows, columns):
        if k == 1:
            now[0] = border_value(x)
        up, left, diagonal = last[first:stop], last[first + 1 : stop + 1], before[first:stop]
        step(up, left, diagonal, x[first:stop], flipped[window], now[first + 1 : stop + 1])
        _forbid(now[:, : len(n)], k, first, stop, band)
        if k in ends:
            result[ends[k]] = now[n[ends[k]], ends[k]]
        last, before, now = now, last, before
    return result


def eager_step(x: Tensor, cost: str) -> Step:
    """The step of `hard_diagonals`, one operation of Torch after the other, without new memory."""
    local, least = x.new_empty((len(x), x.shape[2])), x.new_empty((len(x), x.shape[2]))

    def step(up: Tensor, left: Tensor, diagonal: Tensor, x: Tensor, y: Tensor, out: Tensor) -> None:
        v = torch.minimum(up, left, out=least[: len(up)])
        torch.minimum(v, diagonal, out=v)
        if x.shape[1] > 1:
            torch.add(v, local_costs(x, y, cost), out=out)
            return
        d = torch.sub(x[:, 0], y[:, 0], out=local[: len(up)])
        if cost == "squared":
            torch.addcmul(v, d, d, out=out)
        else:
            torch.add(v, d.abs_(), out=out)

    return step


def soft_diagonals(
    x: Tensor,
    y: Tensor,
    n: Tensor,
    m: Tensor,
    band: Band | None,
    gamma: Tensor,
    cost: str,
    keep: bool = False,
) -> tuple[Tensor, Tensor | None]:
    """(P,) soft accumulated cost of each lane at its own last cell.

    With ``keep``, also the whole table, (K, n_max + 1, P) by diagonals.
    """
    rows, columns, lanes = x.shape[0], y.shape[0], x.shape[2]
    flipped = y.flip(0)
    border = border_value(x)
    count = rows + columns - 1
    table = x.new_full((count if keep else 3, rows + 1, lanes), border)
    last, before = x.new_full((rows + 1, lanes), border), x.new_full((rows + 1, lanes), border)
    before[0] = 0
    result = x.new_empty(lanes)
    ends = _ends(n, m)
    for k, first, stop, window in diagonals(rows, columns):
        now = table[k if keep else k % 3]
        three = (last[first:stop], last[first + 1 : stop + 1], before[first:stop])
        now[first + 1 : stop + 1] = local_costs(x[first:stop], flipped[window], cost)
        now[first + 1 : stop + 1] += soft_least(*three, gamma)
        _forbid(now, k, first, stop, band)
        if k in ends:
            result[ends[k]] = now[n[ends[k]], ends[k]]
        last, before = now, last
    return result, table if keep else None


def soft_least(up: Tensor, left: Tensor, diagonal: Tensor, gamma: Tensor) -> Tensor:
    """``-gamma * log(sum(exp(-v / gamma)))`` of three."""
    least = torch.minimum(torch.minimum(up, left), diagonal)
    total = ((least - up) / gamma).exp_()
    total += ((least - left) / gamma).exp_()
    total += ((least - diagonal) / gamma).exp_()
    return least - gamma * total.log_()


def soft_shares(up: Tensor, left: Tensor, diagonal: Tensor, gamma: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The derivatives of `soft_least`: what it owes to each of the three; together one."""
    least = torch.minimum(torch.minimum(up, left), diagonal)
    parts = tuple(((least - value) / gamma).exp_() for value in (up, left, diagonal))
    whole = parts[0] + parts[1] + parts[2]
    return parts[0] / whole, parts[1] / whole, parts[2] / whole


def _forbid(now: Tensor, k: int, first: int, stop: int, band: Band | None) -> None:
    """Put the border value into the diagonal's cells outside the band."""
    if band is not None:
        column = k - torch.arange(first, stop, device=now.device)[:, None]
        outside = (column < band.low[first:stop]) | (column >= band.high[first:stop])
        now[first + 1 : stop + 1].masked_fill_(outside, border_value(now))


def _ends(n: Tensor, m: Tensor) -> dict[int, Tensor]:
    """The lanes whose last cell lies on each diagonal."""
    ends = n + m - 2
    return {k: torch.nonzero(ends == k)[:, 0] for k in torch.unique(ends).tolist()}
