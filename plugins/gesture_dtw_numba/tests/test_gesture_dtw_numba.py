"""The kernel passes the conformance suite and announces what it can do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("numba")

from gesture_dtw_numba.kernel import NumbaKernel

from gesture_core.dtw.spec import DtwSpec
from gesture_core.plugin.abilities import ApproximateKernel, GradientKernel, PairKernel, SearchKernel
from gesture_core.plugin.interfaces import DistanceKernel
from gesture_core.testing import KERNEL_CHECKS, draw_batch


@pytest.mark.parametrize("check", KERNEL_CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_the_contract(check: Callable[[DistanceKernel], None]) -> None:
    check(NumbaKernel())


def test_it_announces_what_it_can_do() -> None:
    kernel = NumbaKernel()
    for ability in (PairKernel, SearchKernel, GradientKernel):
        assert isinstance(kernel, ability)
    assert not isinstance(kernel, ApproximateKernel)


@pytest.mark.parametrize("spec", [DtwSpec(), DtwSpec(gamma=0.5), DtwSpec(mode="dependent", window=0.9)])
def test_threads_change_no_bit(spec: DtwSpec) -> None:
    rng = np.random.default_rng(0)
    queries, examples = draw_batch(rng, 40, 20, 3), draw_batch(rng, 30, 20, 3)
    alone, together = (
        kernel.distances(kernel.prepare(examples, spec), queries)
        for kernel in (NumbaKernel(threads=1), NumbaKernel(threads=3))
    )
    np.testing.assert_array_equal(alone, together)


def test_threads_change_no_bit_of_a_stream() -> None:
    rng = np.random.default_rng(1)
    examples = [rng.normal(size=(m, 6)).astype(np.float32) for m in rng.integers(1, 90, 110)]
    frames = rng.normal(size=(400, 6)).astype(np.float32)  # enough of them that threads are started
    alone, together = (NumbaKernel(threads=n).subsequences(examples, 0.05).push(frames) for n in (1, 3))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)
