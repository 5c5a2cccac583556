"""The kernel passes the conformance suite and announces what it can do."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("jax")

from gesture_dtw_jax.kernel import JaxKernel

from gesture_core.plugin.abilities import ApproximateKernel, DeviceKernel, GradientKernel
from gesture_core.plugin.interfaces import DistanceKernel
from gesture_core.testing import KERNEL_CHECKS


@pytest.mark.parametrize("check", KERNEL_CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_the_contract(check: Callable[[DistanceKernel], None]) -> None:
    check(JaxKernel())


def test_it_announces_what_it_can_do() -> None:
    kernel = JaxKernel()
    assert isinstance(kernel, GradientKernel) and isinstance(kernel, DeviceKernel)
    assert not isinstance(kernel, ApproximateKernel)
    assert kernel.device
