"""A trained network made larger without a change of what it answers (Chen et al. 2016, Net2Net).

New channels are read with weights of zero and new blocks add nothing, so that training goes on from
where the small network stood, with more room.
"""

from __future__ import annotations

import torch
from torch import nn

from .network import Compact, InvertedResidual


def grow(small: Compact, large: Compact) -> None:
    """Put the weights of ``small`` into ``large``, in place; both then give the same maps.

    ``large`` has at least the channels and blocks of ``small`` and the same ``fused``, ``expand`` and
    number of stages; a ValueError says which tensor does not fit.
    """
    for module in large.modules():
        if isinstance(module, InvertedResidual) and module.residual:
            norm = module.body[-1]
            assert isinstance(norm, nn.BatchNorm2d)
            nn.init.zeros_(norm.weight)  # a block that is new answers what it is given
    target = large.state_dict()
    with torch.no_grad():
        for name, old in small.state_dict().items():
            new = target[name]
            if any(a > b for a, b in zip(old.shape, new.shape, strict=True)):
                raise ValueError(f"{name}: {tuple(old.shape)} does not fit into {tuple(new.shape)}")
            if name.endswith("weight") and old.ndim == 1:
                new.fill_(1.0)
            if old.ndim > 1:
                new[: old.shape[0], old.shape[1] :] = 0
            new[tuple(slice(0, size) for size in old.shape)] = old
