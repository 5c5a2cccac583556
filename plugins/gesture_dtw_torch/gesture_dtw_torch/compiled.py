"""Hard diagonals compiled by `torch.compile`: predecessors, costs and sum in one pass over memory.

One form for each cost and dtype, for one dimension and for several, whatever the lengths. Sizes and
offsets of 0 and 1 would each be compiled anew, so the tables lie two rows into their memory, and
diagonals of one cell go step by step. Lanes are filled up to whole vectors: the last few would
otherwise be summed by other instructions than the rest, and a lane's bits would depend on its place.
"""

from __future__ import annotations

from functools import cache

import torch
from torch import Tensor

from gesture_core.errors import MissingDependencyError
from gesture_dtw_torch.diagonals import Band, Step, eager_step, hard_diagonals

AHEAD = 2
WHOLE = 64


def compiled_diagonals(x: Tensor, y: Tensor, n: Tensor, m: Tensor, band: Band | None, cost: str) -> Tensor:
    """(P,) accumulated cost of each lane at its own last cell."""
    x, flipped = _whole(x), _whole(y.flip(0))
    fused, plain = _compiled(cost), eager_step(x, cost)

    def step(up: Tensor, left: Tensor, diagonal: Tensor, x: Tensor, y: Tensor, out: Tensor) -> None:
        (plain if len(up) == 1 else fused)(up, left, diagonal, x, y, out)

    from torch._inductor.exc import InductorError

    try:
        return hard_diagonals(x, flipped, n, m, band, step, AHEAD)
    except InductorError as error:
        raise MissingDependencyError(
            f"Torch cannot compile here: {str(error).splitlines()[0]}",
            subject="torch",
            remedy="install a C++ compiler (g++ or clang), or leave torch.compiled at false",
        ) from error


def _whole(t: Tensor) -> Tensor:
    """``t`` with its lanes filled up to a multiple of `WHOLE`, `AHEAD` rows into its memory."""
    rows, dimensions, lanes = t.shape
    out = t.new_zeros((AHEAD + rows, dimensions, -(-lanes // WHOLE) * WHOLE))[AHEAD:]
    out[:, :, :lanes] = t
    return out


def _absolute(up: Tensor, left: Tensor, diagonal: Tensor, x: Tensor, y: Tensor, out: Tensor) -> None:
    out.copy_(torch.minimum(torch.minimum(up, left), diagonal) + (x - y).abs().sum(1))


def _squared(up: Tensor, left: Tensor, diagonal: Tensor, x: Tensor, y: Tensor, out: Tensor) -> None:
    out.copy_(torch.minimum(torch.minimum(up, left), diagonal) + (x - y).square().sum(1))


def _euclidean(up: Tensor, left: Tensor, diagonal: Tensor, x: Tensor, y: Tensor, out: Tensor) -> None:
    out.copy_(torch.minimum(torch.minimum(up, left), diagonal) + (x - y).square().sum(1).sqrt())


@cache
def _compiled(cost: str) -> Step:
    """The fused step, compiled at its first call for each dtype."""
    steps = {"absolute": _absolute, "squared": _squared, "euclidean": _euclidean}
    return torch.compile(steps[cost], dynamic=True, fullgraph=True)
