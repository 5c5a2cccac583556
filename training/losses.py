"""Targets and losses: peak-weighted squared error of the heat maps, and where their peaks lie."""

from __future__ import annotations

import torch
from torch import Tensor

from .joints import NAMES
from .network import STRIDE

_WEIGHTS = {"wrist": 3.0, "elbow": 3.0, "eye": 0.5, "ear": 0.5}
IMPORTANCE = torch.tensor([_WEIGHTS.get(name.split("_")[-1], 1.0) for name in NAMES])
"""(18,) weight of each joint: arms make gestures, and they are the hardest to find."""

WINDOW = 3  # cells to each side of a joint that the soft-argmax looks at


def cells(joints: Tensor) -> Tensor:
    """(B, 18, 2) places in cells; the centre of cell i is at (i + 0.5) * stride - 0.5 pixels."""
    return (joints[..., :2] + 0.5) / STRIDE - 0.5


def target_maps(joints: Tensor, height: int, width: int, sigma: float) -> Tensor:
    """(B, 18, height, width) Gaussians of peak 1 at the joints that are present, zero elsewhere."""
    place = cells(joints)
    x = torch.arange(width, dtype=torch.float32)
    y = torch.arange(height, dtype=torch.float32)
    across = torch.exp(-((x - place[..., :1]) ** 2) / (2 * sigma**2))
    down = torch.exp(-((y - place[..., 1:]) ** 2) / (2 * sigma**2))
    present = (joints[..., 2] > 0)[..., None, None]
    return down[..., :, None] * across[..., None, :] * present


def heat_loss(heat: Tensor, target: Tensor, joints: Tensor) -> Tensor:
    """Squared error, ten times heavier on the peaks; maps of joints that are not known do not count."""
    known = ((joints[..., 2] >= 0) * IMPORTANCE)[..., None, None]
    weight = (1 + 9 * target) * known
    return ((heat - target) ** 2 * weight).sum() / (known.sum() * target.shape[-1] * target.shape[-2] * 0.02)


def offset_loss(heat: Tensor, joints: Tensor) -> Tensor:
    """Mean distance, in cells, between each joint and the centre of mass of the heat around it."""
    height, width = heat.shape[-2:]
    place = cells(joints)
    x = torch.arange(width, dtype=torch.float32)
    y = torch.arange(height, dtype=torch.float32)
    center = place.round()
    near = ((x - center[..., :1]).abs() <= WINDOW)[..., None, :] & ((y - center[..., 1:]).abs() <= WINDOW)[
        ..., :, None
    ]
    mass = heat.clamp_min(0) ** 2 * near + 1e-6 * near
    total = mass.sum(dim=(-2, -1)).clamp_min(1e-9)
    mean = torch.stack([(mass.sum(-2) * x).sum(-1) / total, (mass.sum(-1) * y).sum(-1) / total], dim=-1)
    present = (joints[..., 2] > 0) * IMPORTANCE
    return ((mean - place).abs().sum(-1) * present).sum() / present.sum().clamp_min(1)
