"""Soft-DTW through the frameworks' own differentiation, the divergence, paths and barycenters."""

from __future__ import annotations

import numpy as np
import pytest

from gesture_core.dtw import (
    DtwSpec,
    barycenter,
    soft_divergence,
    soft_warping,
    soft_warping_gradient,
    warping_distances,
    warping_path,
)
from gesture_core.dtw.reference import local_costs, reference_distance
from gesture_core.errors import ConfigError, InputError
from gesture_core.plugin import registry
from gesture_core.types import Signals

DBA = DtwSpec(mode="dependent", cost="squared", reduce="sum")
SOFT = DBA.replace(gamma=1.0)
SOFT_KERNELS = [name for name in registry().names("kernel", usable=True) if name != "fastdtw"]


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
        values = np.asarray(soft_dtw(jax.numpy.asarray(x), jax.numpy.asarray(y), gamma, cost))
        of_x, of_y = (
            np.asarray(part)
            for part in jax.grad(lambda a, b: soft_dtw(a, b, gamma, cost).sum(), argnums=(0, 1))(x, y)
        )
    for pair in range(2):
        found = soft_warping_gradient([x[pair]], [y[pair]], spec, kernel="numpy")
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


@pytest.mark.parametrize("mode", ["independent", "dependent"])
def test_divergence_is_that_of_the_dimensions_that_a_pair_is_compared_on(mode: str) -> None:
    rng = np.random.default_rng(0)
    spec = SOFT.replace(mode=mode)
    masks = np.array([[1, 0], [0, 1], [1, 1], [0, 0]], bool)
    series = [
        Signals(rng.normal(size=(n, 2)), np.arange(n), ("a_x", "b_x"), mask)
        for n, mask in zip((4, 5, 6, 7), masks, strict=True)
    ]
    table = soft_divergence(series, series, spec, kernel="numpy")
    for i, x in enumerate(series):
        for j, y in enumerate(series):
            use = masks[i] | masks[j]
            if not use.any():
                assert table[i, j] == np.inf
                continue
            pair, *own = (
                reference_distance(a.values, b.values, spec, use) for a, b in ((x, y), (x, x), (y, y))
            )
            assert table[i, j] == pytest.approx(pair - sum(own) / 2, abs=1e-4) and table[i, j] > -1e-5


@pytest.mark.parametrize("name", SOFT_KERNELS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("gamma", [1e-300, 1e-13, 1e-6])
def test_hardly_soft_warping_gradient_are_those_of_the_hard_path(
    name: str, dtype: type, gamma: float
) -> None:
    rng = np.random.default_rng(3)
    x: np.ndarray = np.cumsum(rng.normal(size=(40, 2)), axis=0).astype(dtype)
    y: np.ndarray = np.cumsum(rng.normal(size=(47, 2)), axis=0).astype(dtype)
    path = warping_path(x, y, DBA)
    of_x, of_y = np.zeros((40, 2)), np.zeros((47, 2))
    slope = 2 * (x[path[:, 0]].astype(np.float64) - y[path[:, 1]])
    np.add.at(of_x, path[:, 0], slope)
    np.add.at(of_y, path[:, 1], -slope)
    found = soft_warping_gradient([x], [y], DBA.replace(gamma=gamma), kernel=name)
    accuracy = {"rtol": 0, "atol": np.abs(slope).max() * 4 * np.finfo(dtype).eps}
    np.testing.assert_allclose(found.queries[0], of_x, **accuracy)
    np.testing.assert_allclose(found.examples[0], of_y, **accuracy)


@pytest.mark.parametrize("gamma", [0.01, 1.0])
def test_single_precision_gradients_of_long_series(gamma: float) -> None:
    rng = np.random.default_rng(1)
    x, y = (np.cumsum(rng.normal(size=(300, 3)), axis=0).astype(np.float32) for _ in range(2))
    spec = DBA.replace(gamma=gamma)
    single, double = (
        soft_warping_gradient([x.astype(d)], [y.astype(d)], spec) for d in (np.float32, np.float64)
    )
    assert single.queries[0].dtype == np.float32
    largest = np.abs(double.queries[0]).max()
    assert np.abs(single.queries[0] - double.queries[0]).max() < 1e-6 * largest


def test_gradients_need_softness() -> None:
    with pytest.raises(ConfigError, match=r"without dtw\.gamma"):
        soft_warping_gradient(bumps(), bumps(), DBA)


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


def test_paths_take_what_distances_take_and_no_more() -> None:
    x, y = np.random.default_rng(0).normal(size=(5, 2)), np.random.default_rng(1).normal(size=(6, 2))
    together = DtwSpec(mode="dependent")
    wide = np.column_stack([y, y[:, 0]])
    for one, other in ((x, wide), (wide, x)):
        with pytest.raises(InputError, match="E_DIMENSIONS"):
            warping_path(one, other, together)
    with pytest.raises(InputError, match="E_EMPTY"):
        warping_path(x[:0], y, together)
    with pytest.raises(InputError, match="E_NOT_FINITE"):
        warping_path(x, y * np.nan, together)
    with pytest.raises(ConfigError, match="4 weights for series of 2"):
        warping_path(x, y, together.replace(weights=(1, 1, 1, 1)))
    with pytest.raises(ConfigError, match="dimension = 2"):
        warping_path(x, y, dimension=2)
    with pytest.raises(ConfigError, match="one path for all"):
        warping_path(x, y, together, dimension=0)
    # The default is that of distances: one path for each dimension.
    with pytest.raises(ConfigError, match="which of 2 dimensions"):
        warping_path(x, y)
    costs = [
        np.abs(x[p[:, 0], d] - y[p[:, 1], d]).sum() for d in (0, 1) for p in [warping_path(x, y, dimension=d)]
    ]
    assert np.mean(costs) == pytest.approx(warping_distances([x], [y])[0, 0], rel=1e-12)


def test_paths_of_signals_leave_out_what_is_not_compared() -> None:
    rng = np.random.default_rng(2)
    names, present = ("a", "b", "c"), np.array([True, False, True])
    x, y = (Signals(rng.normal(size=(n, 3)), np.arange(n), names, present=present) for n in (7, 9))
    together = DtwSpec(mode="dependent")
    path = warping_path(x, y, together)
    np.testing.assert_array_equal(path, warping_path(x.values[:, ::2], y.values[:, ::2], together))
    with pytest.raises(ConfigError, match=r"dimension = 1; try: one of \[0, 2\]"):
        warping_path(x, y, dimension=1)
    apart = Signals(y.values, y.times, names, present=~present)
    with pytest.raises(InputError, match="no dimension in common"):
        warping_path(x, apart, together)


def test_barycenters_are_nearer_than_members() -> None:
    series = bumps()
    hard = warping_distances([barycenter(series)], series, DBA).sum()
    assert hard <= warping_distances(series, series, DBA).sum(axis=1).min()
    found = barycenter(series, SOFT, start=series[0], iterations=20)
    soft = soft_warping([found, series[0]], series).sum(axis=1)
    assert soft[0] < soft[1]


@pytest.mark.parametrize("spec", [DBA, SOFT], ids=["hard", "soft"])
def test_a_weight_counts_as_often_as_a_series_is_there(spec: DtwSpec) -> None:
    series = bumps(3)
    weighted = barycenter(series, spec, weights=[0.5, 0.25, 0.25], start=series[1])
    repeated = barycenter([series[0], *series], spec, start=series[1])
    np.testing.assert_allclose(weighted, repeated, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("weights", [[1.0, 1.0], [1.0, 1.0, -1.0], [0.0, 0.0, 0.0], [1.0, 1.0, np.nan]])
def test_weights_that_average_nothing_are_refused(weights: list[float]) -> None:
    with pytest.raises(InputError, match="expected 3 numbers"):
        barycenter(bumps(3), weights=weights)


@pytest.mark.parametrize("spec", [DtwSpec(cost="squared"), DtwSpec(mode="dependent")], ids=str)
def test_only_what_has_an_average_is_averaged(spec: DtwSpec) -> None:
    with pytest.raises(ConfigError, match="dependent, squared costs only"):
        barycenter(bumps(), spec)


def test_a_weighted_barycenter_goes_on_until_the_weighted_cost_stands() -> None:
    rng = np.random.default_rng(0)
    series = [np.cumsum(rng.normal(size=(20 + i, 2)), axis=0) for i in range(4)]
    spec = DBA.replace(weights=(1000.0, 0.001))
    found = barycenter(series, spec, tolerance=1e-9)
    again = barycenter(series, spec, start=found, tolerance=1e-9)
    np.testing.assert_allclose(again, found)


def test_a_first_barycenter_of_one_dimension_may_be_flat() -> None:
    series = [np.sin(np.linspace(0, 3, n)) for n in (9, 12)]
    np.testing.assert_array_equal(
        barycenter(series, start=series[0]), barycenter(series, start=series[0][:, None])
    )
    assert barycenter(series, SOFT, start=series[0], iterations=1, kernel="numpy").shape == (9, 1)


@pytest.mark.parametrize("weights", [np.ones(5), np.ones((1, 5)), np.full((5, 5), np.nan)])
def test_weights_that_fit_no_pairs_are_refused(weights: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"expected \(5, 5\) finite numbers"):
        soft_warping_gradient(bumps(), bumps(), SOFT, weights, "numpy")


def test_what_is_masked_is_not_averaged() -> None:
    series = [np.arange(4.0), np.ma.masked_array(np.arange(4.0), [False, True, False, False])]
    for spec in (DBA, SOFT):
        with pytest.raises(InputError, match="E_NOT_FINITE series 1 has masked values"):
            barycenter(series, spec)
