"""Every registered kernel, the project's own and third parties', passes the conformance suite."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from conftest import ROOT

from gesture_core.dtw.spec import DtwSpec
from gesture_core.plugin import registry
from gesture_core.testing import KERNEL_CHECKS, Case, compare, draw_batch

KERNELS = registry().names("kernel", usable=True)


@pytest.mark.timeout(900)  # mostly compilation, which a busy machine draws out
@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("check", KERNEL_CHECKS, ids=lambda check: check.__name__)
def test_kernel(name: str, check: Callable[..., None]) -> None:
    check(registry().make("kernel", name))


def test_a_third_partys_kernel_passes_as_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "example_plugin"))
    from gesture_example.plain import PlainKernel

    kernel = PlainKernel()
    for check in KERNEL_CHECKS:
        check(kernel)
    rng = np.random.default_rng(0)
    spec = DtwSpec(mode="dependent", reduce="sum")
    assert compare(kernel, Case(draw_batch(rng, 3, 9, 2), draw_batch(rng, 4, 9, 2), spec)) == 12


def test_a_wrong_kernel_does_not_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "example_plugin"))
    from gesture_example import plain

    monkeypatch.setattr(plain, "_warp", lambda cost: float(np.trace(cost)))
    with pytest.raises(AssertionError):
        for check in KERNEL_CHECKS:
            check(plain.PlainKernel())
