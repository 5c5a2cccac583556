"""The kernel passes the conformance suite and announces what it can do."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("torch")

from gesture_dtw_torch.kernel import TorchKernel

from gesture_core.plugin.abilities import ApproximateKernel, DeviceKernel, GradientKernel
from gesture_core.plugin.interfaces import DistanceKernel
from gesture_core.testing import KERNEL_CHECKS


@pytest.mark.parametrize("check", KERNEL_CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_the_contract(check: Callable[[DistanceKernel], None]) -> None:
    check(TorchKernel())


def test_it_announces_what_it_can_do() -> None:
    kernel = TorchKernel()
    assert isinstance(kernel, GradientKernel) and isinstance(kernel, DeviceKernel)
    assert not isinstance(kernel, ApproximateKernel)
    assert kernel.device


def test_what_is_no_device_is_refused() -> None:
    assert TorchKernel(where="cpu").device == "cpu"
    with pytest.raises(ValueError, match="no device of Torch"):
        TorchKernel(where="nowhere")
