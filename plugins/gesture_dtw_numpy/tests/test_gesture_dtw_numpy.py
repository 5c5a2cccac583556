"""Both kernels pass the conformance suite; the approximation says so and has the package's windows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from gesture_dtw_numpy.fastdtw import FastDtwKernel, fastdtw
from gesture_dtw_numpy.kernel import NumpyKernel

from gesture_core.dtw.spec import BandMask, DtwSpec
from gesture_core.errors import ConfigError
from gesture_core.plugin.abilities import ApproximateKernel, GradientKernel, PairKernel
from gesture_core.plugin.interfaces import DistanceKernel
from gesture_core.testing import KERNEL_CHECKS, draw_batch


@pytest.mark.parametrize("check", KERNEL_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("kernel", [NumpyKernel(), FastDtwKernel()], ids=["numpy", "fastdtw"])
def test_it_keeps_the_contract(kernel: DistanceKernel, check: Callable[[DistanceKernel], None]) -> None:
    check(kernel)


def test_they_announce_what_they_can_do() -> None:
    exact, approximate = NumpyKernel(), FastDtwKernel()
    assert isinstance(exact, GradientKernel) and isinstance(exact, PairKernel)
    assert not isinstance(exact, ApproximateKernel)
    assert isinstance(approximate, ApproximateKernel) and "FastDTW" in approximate.approximation
    assert not isinstance(approximate, GradientKernel)


def test_masks_with_holes_are_computed() -> None:
    holes = np.ones((5, 5), bool)
    holes[2, 2] = False
    assert NumpyKernel().supports(DtwSpec(mask=BandMask.of(holes)))


def test_the_approximation_is_never_below_the_exact_distance() -> None:
    rng = np.random.default_rng(0)
    queries, examples = draw_batch(rng, 4, 40, 2, np.float64), draw_batch(rng, 5, 40, 2, np.float64)
    exact, found = (
        kernel.distances(kernel.prepare(examples, DtwSpec()), queries)
        for kernel in (NumpyKernel(), FastDtwKernel())
    )
    assert (found >= exact - 1e-9).all()
    # A radius beyond the series searches every cell.
    wide = FastDtwKernel(radius=40)
    np.testing.assert_allclose(wide.distances(wide.prepare(examples, DtwSpec()), queries), exact)


def test_the_path_of_the_approximation_joins_both_ends() -> None:
    x, y = np.random.default_rng(1).normal(size=(2, 30, 1))
    cost, path = fastdtw(x, y, 1, "absolute")
    assert path[0] == (0, 0) and path[-1] == (29, 29)
    assert sum(abs(float(x[i, 0] - y[j, 0])) for i, j in path) == pytest.approx(cost)


@pytest.mark.parametrize("radius", [0, -1, 1.5])
def test_a_radius_below_one_is_refused(radius: float) -> None:
    with pytest.raises(ConfigError, match="radius"):
        FastDtwKernel(radius=radius)  # type: ignore[arg-type]
