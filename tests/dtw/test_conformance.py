"""Every registered kernel, the project's own and third parties', passes the conformance suite."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gesture_core.plugin import registry
from gesture_core.testing import KERNEL_CHECKS

KERNELS = registry().names("kernel", usable=True)


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("check", KERNEL_CHECKS, ids=lambda check: check.__name__)
def test_kernel(name: str, check: Callable[..., None]) -> None:
    check(registry().make("kernel", name))
