"""Exact search finds what brute force finds, with fewer cells."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesture_core.dtw import search as engine
from gesture_core.dtw.distances import warping_distances
from gesture_core.dtw.search import nearest, search
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError, InputError
from gesture_core.types import Signals


def walks(rng: np.random.Generator, count: int, width: int, longest: int = 40) -> list[np.ndarray]:
    lengths = rng.integers(longest * 3 // 4, longest + 1, count)
    return [np.cumsum(rng.integers(-2, 3, (n, width)), axis=0).astype(np.float32) for n in lengths]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["independent", "dependent"]),
    st.sampled_from(["absolute", "squared", "euclidean"]),
    st.sampled_from(["sum", "mean"]),
    st.booleans(),
    st.booleans(),
    st.sampled_from([{}, {"window": 0.15}, {"window": 6}, {"shape": "itakura"}]),
    st.integers(1, 5),
)
def test_search_is_brute_force(seed, mode, cost, reduce, root, norm, band, k) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(seed)
    spec = DtwSpec(mode=mode, cost=cost, reduce=reduce, root=root, length_norm=norm, **band)
    queries, examples = walks(rng, 6, 2), walks(rng, 60, 2)
    examples[7] = examples[31]  # a tie, which the lower index wins
    queries[2] = examples[31]
    table = warping_distances(queries, examples, spec)
    order = np.argsort(table, axis=1, kind="stable")[:, :k]
    found = search(queries, examples, spec, k)
    np.testing.assert_array_equal(found.neighbors.indices, order)
    np.testing.assert_array_equal(found.neighbors.distances, np.take_along_axis(table, order, axis=1))
    assert 0 < found.share <= 1


def test_search_with_masks_and_pairs_without_a_common_channel() -> None:
    rng = np.random.default_rng(1)
    names = ("a", "b", "c")

    def signals(count: int) -> list[Signals]:
        return [
            Signals(w, np.arange(len(w)), names, rng.random(3) < 0.5, rng.random(3) < 0.6)
            for w in walks(rng, count, 3)
        ]

    queries, examples = signals(12), signals(80)
    spec = DtwSpec(window=0.2)
    table = warping_distances(queries, examples, spec)
    assert np.isinf(table).any()
    found = nearest(queries, examples, spec, k=3)
    order = np.argsort(table, axis=1, kind="stable")[:, :3]
    np.testing.assert_array_equal(found.indices, order)


def test_search_in_parts_under_masks_and_by_a_kernel_that_only_knows_tables(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(engine, "PAIRS_AT_ONCE", 90)
    rng = np.random.default_rng(3)
    queries, examples = walks(rng, 7, 1, 24), walks(rng, 40, 1, 24)
    inner = np.abs(np.subtract.outer(np.arange(9), np.arange(9)))
    holes = (inner < 5) & ~((inner == 0) & (np.arange(9) == 4))
    for spec in (DtwSpec(mask=inner < 3), DtwSpec(mask=holes, root=True), DtwSpec(gamma=0.5)):
        table = warping_distances(queries, examples, spec)
        order = np.argsort(table, axis=1, kind="stable")[:, :2]
        for kernel in ("auto", "numpy"):
            found = search(queries, examples, spec, 2, kernel)
            np.testing.assert_array_equal(found.neighbors.indices, order)
            assert 0 < found.share <= 1 and (spec.gamma is None or found.share == 1)


def test_bounds_save_cells_under_a_band() -> None:
    rng = np.random.default_rng(2)
    found = search(walks(rng, 20, 1, 80), walks(rng, 400, 1, 80), DtwSpec(window=0.1))
    assert found.share < 0.3


def test_wrong_k_is_refused() -> None:
    with pytest.raises(ConfigError, match="k = 3 of 2"):
        nearest([np.zeros(3)], [np.zeros(3), np.ones(3)], k=3)


def test_search_of_long_series_outlasts_the_rounding_of_single_precision() -> None:
    frames = 20_000
    constant, spike = np.full(frames, 0.1, np.float32), np.zeros(frames, np.float32)
    query = np.zeros(frames, np.float32)
    exact = float(constant.astype(np.float64).sum())
    rounded = float(warping_distances([query], [constant])[0, 0])
    assert rounded < exact * (1 - 1e-4)  # what makes this hard
    spike[frames // 2] = rounded + (exact - rounded) / 10
    table = warping_distances([query], [spike, constant])
    assert table.argmin() == 1
    assert nearest([query], [spike, constant]).indices.tolist() == [[1]]


@pytest.mark.parametrize("mode", ["independent", "dependent"])
def test_search_among_squares_that_are_too_small_to_be_told_apart(mode: str) -> None:
    rng = np.random.default_rng(4)
    spec = DtwSpec(mode=mode, cost="squared", reduce="sum")  # type: ignore[arg-type]
    examples = [np.float32(1e-25) * walk for walk in walks(rng, 50, 2)]
    examples.append(np.ones((30, 2), np.float32))
    table = warping_distances(examples[:5], examples, spec)
    found = nearest(examples[:5], examples, spec, 3)
    order = np.argsort(table, axis=1, kind="stable")[:, :3]
    np.testing.assert_array_equal(found.indices, order)


@pytest.mark.parametrize(("dtype", "unit"), [(np.float32, 1e-25), (np.float64, 1e-170)])
def test_a_unit_whose_squares_vanish_is_refused(dtype: type, unit: float) -> None:
    rng = np.random.default_rng(4)
    series = [(unit * rng.normal(size=9)).astype(dtype) for _ in range(3)]
    for spec in (DtwSpec(cost="squared"), DtwSpec(mode="dependent", cost="euclidean")):
        with pytest.raises(InputError, match=r"E_MAGNITUDE .* a larger unit"):
            warping_distances(series, series, spec)
    assert warping_distances(series, series)[0, 1] > 0
    assert warping_distances([np.zeros(4, dtype)], [np.zeros(3, dtype)], DtwSpec(cost="squared")) == 0


def test_what_rounding_leaves_of_a_part_that_keeps_still_is_no_unit() -> None:
    rng = np.random.default_rng(4)
    still = [Signals(1e-17 * rng.normal(size=(n, 2)), np.arange(n) / 20, ("a_x", "a_y")) for n in (9, 7)]
    assert warping_distances(still[:1], still[1:], DtwSpec(mode="dependent", cost="squared")) < 1e-30
