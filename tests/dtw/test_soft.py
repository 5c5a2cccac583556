"""Soft-DTW through the frameworks' own differentiation, the divergence, paths and barycenters."""

from __future__ import annotations

import numpy as np
import pytest

from gesture_core.dtw.barycenter import DBA, SOFT, dba, soft_barycenter
from gesture_core.dtw.distances import warping_distances
from gesture_core.dtw.paths import warping_path
from gesture_core.dtw.reference import local_costs, reference_distance
from gesture_core.dtw.soft import soft_divergence, soft_gradients
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError


def bumps(count: int = 5) -> list[np.ndarray]:
    rng = np.random.default_rng(4)
    shift = rng.uniform(-0.5, 0.5, count)
    return [np.exp(-((np.linspace(-3, 3, 20 + i) - s) ** 2))[:, None] for i, s in enumerate(shift)]


@pytest.mark.parametrize("cost", ["squared", "euclidean", "absolute"])
@pytest.mark.parametrize("gamma", [1e-3, 0.1, 10.0])
def test_jax_grad(cost: str, gamma: float) -> None:
    jax = pytest.importorskip("jax")
    from gesture_dtw_jax.soft import soft_dtw

    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, 6, 2)), rng.normal(size=(2, 4, 2))
    spec = DtwSpec(mode="dependent", cost=cost, reduce="sum", gamma=gamma)  # type: ignore[arg-type]
    with jax.enable_x64(True):
        values = np.asarray(soft_dtw(x, y, gamma, cost))
        of_x, of_y = (
            np.asarray(part)
            for part in jax.grad(lambda a, b: soft_dtw(a, b, gamma, cost).sum(), argnums=(0, 1))(x, y)
        )
    for pair in range(2):
        found = soft_gradients([x[pair]], [y[pair]], spec, kernel="numpy")
        assert values[pair] == pytest.approx(reference_distance(x[pair], y[pair], spec), abs=1e-10)
        np.testing.assert_allclose(of_x[pair], found.queries[0], atol=1e-9)
        np.testing.assert_allclose(of_y[pair], found.examples[0], atol=1e-9)


@pytest.mark.parametrize("cost", ["squared", "euclidean", "absolute"])
def test_torch_autograd(cost: str) -> None:
    torch = pytest.importorskip("torch")
    from gesture_dtw_torch.soft import soft_dtw

    torch.manual_seed(0)
    x = torch.randn(2, 6, 2, dtype=torch.float64, requires_grad=True)
    y = torch.randn(2, 4, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda a, b: soft_dtw(a, b, 0.5, cost), (x, y))


@pytest.mark.parametrize("gamma", [1e-3, 1.0, 10.0])
def test_divergence(gamma: float) -> None:
    spec = SOFT.replace(gamma=gamma)
    series = bumps()
    table = soft_divergence(series, series, spec)
    assert np.abs(np.diag(table)).max() < 1e-9
    assert (table > -1e-9).all() and np.allclose(table, table.T, atol=1e-9)


def test_gradients_need_softness() -> None:
    with pytest.raises(ConfigError, match=r"without dtw\.gamma"):
        soft_gradients(bumps(), bumps(), DBA)


def test_a_path_costs_what_the_distance_says() -> None:
    rng = np.random.default_rng(5)
    for band in ({}, {"window": 0.3}, {"shape": "itakura"}):
        x, y = rng.normal(size=(23, 2)), rng.normal(size=(19, 2))
        spec = DtwSpec(mode="dependent", reduce="sum", **band)
        path = warping_path(x, y, spec)
        assert path[0].tolist() == [0, 0] and path[-1].tolist() == [22, 18]
        steps = {tuple(step) for step in np.diff(path, axis=0).tolist()}
        assert steps <= {(0, 1), (1, 0), (1, 1)}
        cost = local_costs(x, y, spec, np.arange(2))[path[:, 0], path[:, 1]].sum()
        assert cost == pytest.approx(warping_distances([x], [y], spec)[0, 0], rel=1e-12)
    one = warping_path(x, y, DtwSpec(), dimension=1)
    assert (one == warping_path(x[:, 1], y[:, 1], DtwSpec())).all()
    with pytest.raises(ConfigError, match="which of 2 dimensions"):
        warping_path(x, y, DtwSpec())


def test_barycenters_are_nearer_than_members() -> None:
    series = bumps()
    hard = warping_distances([dba(series)], series, DBA).sum()
    assert hard <= warping_distances(series, series, DBA).sum(axis=1).min()
    found = soft_barycenter(series, start=series[0], iterations=20)
    soft = warping_distances([found, series[0]], series, SOFT).sum(axis=1)
    assert soft[0] < soft[1]
