"""The student network: inverted residuals down to stride 32, one top-down path, heat maps at stride 4.

The blocks are the inverted residuals of MobileNetV2 (Sandler et al. 2018); large 5x5 kernels at the
coarse strides give each joint a view of the whole body at little cost, and the top-down path is the
one of feature pyramids (Lin et al. 2017). Every convolution pads explicitly by ``kernel // 2``.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from .settings import Network

JOINTS = 18
STRIDE = 4


def convolution(
    inputs: int, outputs: int, kernel: int = 1, stride: int = 1, groups: int = 1
) -> nn.Sequential:
    """Convolution, batch norm, ReLU; the padding is explicit and symmetric."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class InvertedResidual(nn.Module):
    """Expand (1x1), filter every channel (kxk), project (1x1); a residual where the shapes allow it.

    ``fused`` replaces the first two by one dense kxk convolution: faster on CPUs at fine strides,
    where there are few channels (Gupta and Akin 2020, fused inverted residuals).
    """

    def __init__(
        self, inputs: int, outputs: int, expand: int, kernel: int, stride: int, fused: bool = False
    ) -> None:
        super().__init__()
        hidden = inputs * expand
        first = (
            [convolution(inputs, hidden, kernel, stride)]
            if fused
            else [convolution(inputs, hidden), convolution(hidden, hidden, kernel, stride, groups=hidden)]
        )
        self.body = nn.Sequential(*first, nn.Conv2d(hidden, outputs, 1, bias=False), nn.BatchNorm2d(outputs))
        self.residual = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        y: Tensor = self.body(x)
        return x + y if self.residual else y


def stage(
    inputs: int, outputs: int, depth: int, expand: int, kernel: int, fused: bool = False
) -> nn.Sequential:
    """``depth`` blocks, the first of stride 2."""
    blocks = [InvertedResidual(inputs, outputs, expand, kernel, 2, fused)]
    blocks += [InvertedResidual(outputs, outputs, expand, kernel, 1, fused) for _ in range(depth - 1)]
    return nn.Sequential(*blocks)


class Compact(nn.Module):
    """Picture to heat maps.

    Parameters
    ----------
    widths : five channel counts, at strides 2, 4, 8, 16 and 32.
    depths : four block counts, at strides 4, 8, 16 and 32.
    expand : expansion of the inverted residuals.
    neck : channels of the top-down path.
    fused : whether strides 4 and 8 use dense blocks.

    The input is (N, 3, H, W) float32, BGR, 0..255, H and W multiples of 32; normalisation is part of
    the network. The output is (N, 19, H / 4, W / 4): 18 heat maps in OpenPose order, then the
    background (one minus the highest of them).
    """

    def __init__(
        self,
        widths: tuple[int, ...] = (16, 24, 40, 80, 128),
        depths: tuple[int, ...] = (2, 3, 4, 3),
        expand: int = 4,
        neck: int = 48,
        fused: bool = False,
    ) -> None:
        super().__init__()
        self.stem = convolution(3, widths[0], 3, 2)
        self.stride4 = stage(widths[0], widths[1], depths[0], 2 if fused else expand, 3, fused)
        self.stride8 = stage(widths[1], widths[2], depths[1], 2 if fused else expand, 3, fused)
        self.stride16 = stage(widths[2], widths[3], depths[2], expand, 5)
        self.stride32 = stage(widths[3], widths[4], depths[3], expand, 5)
        self.lateral = nn.ModuleList(nn.Conv2d(width, neck, 1) for width in widths[1:])
        self.smooth = nn.ModuleList(
            nn.Sequential(convolution(neck, neck, 5, groups=neck), convolution(neck, neck)) for _ in range(3)
        )
        self.head = nn.Sequential(convolution(neck, neck, 3), nn.Conv2d(neck, JOINTS, 1))
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
        last = self.head[-1]
        assert isinstance(last, nn.Conv2d) and last.bias is not None
        nn.init.normal_(last.weight, std=0.001)
        nn.init.zeros_(last.bias)

    def heat(self, x: Tensor) -> Tensor:
        """(N, 18, H / 4, W / 4) heat maps; what the losses see."""
        x = self.stem((x - 127.5) * (1 / 64.0))
        levels = []
        for block in (self.stride4, self.stride8, self.stride16, self.stride32):
            x = block(x)
            levels.append(x)
        top = self.lateral[3](levels[3])
        for index in (2, 1, 0):
            top = functional.interpolate(top, scale_factor=2.0, mode="nearest")
            top = self.smooth[index](top + self.lateral[index](levels[index]))
        heat: Tensor = self.head(top)
        return heat

    def forward(self, x: Tensor) -> Tensor:
        heat = self.heat(x)
        return torch.cat([heat, 1 - heat.amax(dim=1, keepdim=True)], dim=1)


def build(kind: Network) -> Compact:
    """An untrained network of these sizes."""
    return Compact(kind.widths, kind.depths, kind.expand, kind.neck, kind.fused)
