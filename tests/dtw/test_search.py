"""Exact search finds what brute force finds, with fewer cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesture_core.dtw import DtwSpec, ExampleIndex, nearest, search, warping_distances
from gesture_core.errors import ConfigError, InputError, PluginError
from gesture_core.types import Neighbors, SignalBatch, Signals


@pytest.fixture(autouse=True)
def _bounds_however_few_series_share_a_length(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_PAIRS_PER_SHAPE", 0)


def walks(rng: np.random.Generator, count: int, width: int, longest: int = 40) -> list[np.ndarray]:
    lengths = rng.integers(longest * 3 // 4, longest + 1, count)
    return [np.cumsum(rng.integers(-2, 3, (n, width)), axis=0).astype(np.float32) for n in lengths]


def assert_brute_force(  # type: ignore[no-untyped-def]
    found: Neighbors, queries, examples, spec: DtwSpec, k: int, among: np.ndarray | None = None
) -> None:
    """The neighbours are those of the whole table, to the last bit."""
    table = warping_distances(queries, examples, spec)
    table = table if among is None else np.where(among, table, np.inf)
    order = np.argsort(table, axis=1, kind="stable")[:, :k]
    np.testing.assert_array_equal(found.indices, order)
    np.testing.assert_array_equal(found.distances, np.take_along_axis(table, order, axis=1))


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
    assert_brute_force(nearest(queries, examples, k, spec), queries, examples, spec, k)


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
    assert_brute_force(nearest(queries, examples, 3, spec), queries, examples, spec, 3)
    # More neighbours than there are examples at a finite distance.
    assert_brute_force(nearest(queries, examples, 80, spec), queries, examples, spec, 80)


def test_search_in_parts_under_masks_and_by_a_kernel_that_only_knows_tables(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(search, "_PAIRS_AT_ONCE", 90)
    rng = np.random.default_rng(3)
    queries, examples = walks(rng, 7, 1, 24), walks(rng, 40, 1, 24)
    inner = np.abs(np.subtract.outer(np.arange(9), np.arange(9)))
    holes = (inner < 5) & ~((inner == 0) & (np.arange(9) == 4))
    for spec in (DtwSpec(mask=inner < 3), DtwSpec(mask=holes, root=True), DtwSpec(gamma=0.5)):  # type: ignore[arg-type]  # an array becomes a mask
        for kernel in ("auto", "numpy"):
            assert_brute_force(nearest(queries, examples, 2, spec, kernel), queries, examples, spec, 2)


@pytest.mark.parametrize("spec", [DtwSpec(window=0.2), DtwSpec(gamma=0.5)], ids=["hard", "soft"])
def test_examples_are_prepared_once_and_searched_among_some(spec: DtwSpec) -> None:
    rng = np.random.default_rng(5)
    examples = walks(rng, 50, 2)
    index = ExampleIndex(examples, spec)
    for dtype in (np.float32, np.float64, np.float32):
        queries = [walk.astype(dtype) for walk in walks(rng, 4, 2)]
        assert_brute_force(index.nearest(queries, 3), queries, examples, spec, 3)
        among = rng.random((4, 50)) < 0.1
        among[0] = False
        among[1, 7] = True
        found = index.nearest(queries, 6, among)
        assert_brute_force(found, queries, examples, spec, 6, among)
        assert np.isinf(found.distances[0]).all() and found.indices[0].tolist() == [0, 1, 2, 3, 4, 5]
    with pytest.raises(InputError, match=r"among has shape \(4, 3\), expected \(4, 50\)"):
        index.nearest(queries, 1, np.ones((4, 3), bool))


def test_a_query_is_refused_as_it_is_by_distances() -> None:
    index = ExampleIndex([np.zeros((5, 2)), np.zeros((30, 2))], DtwSpec(window=0))
    with pytest.raises(InputError, match="queries have 3 dimensions, examples 2"):
        index.nearest([np.zeros((4, 3))])
    with pytest.raises(InputError, match=r"query 0 \(5 frames\) and example 1 \(30 frames\)"):
        index.nearest([np.zeros((5, 2))])
    with pytest.raises(InputError, match=r"one array of shape \(4, 2\)"):
        index.nearest(np.zeros((4, 2)))  # type: ignore[arg-type]


class CountingIndex(ExampleIndex):
    """Counts the pairs that are warped."""

    warped = 0

    def _within(self, queries, examples, qi, ei, limits):  # type: ignore[no-untyped-def]
        self.warped += len(qi)
        return super()._within(queries, examples, qi, ei, limits)


@pytest.mark.parametrize("kernel", ["auto", "numpy"])
def test_bounds_save_warpings_under_a_band(kernel: str) -> None:
    rng = np.random.default_rng(2)
    queries, examples = walks(rng, 20, 1, 80), walks(rng, 400, 1, 80)
    index = CountingIndex(examples, DtwSpec(window=0.1), kernel)
    assert_brute_force(index.nearest(queries), queries, examples, index.spec, 1)
    assert index.warped < 0.3 * 20 * 400


@pytest.mark.parametrize(("frames", "share"), [((60,), 0.3), (range(50, 70), 0.0)], ids=["equal", "mixed"])
def test_bounds_are_taken_where_series_share_their_lengths(
    monkeypatch: pytest.MonkeyPatch, frames: Sequence[int], share: float
) -> None:
    monkeypatch.undo()
    rng = np.random.default_rng(6)
    queries, examples = (
        [np.cumsum(rng.normal(size=rng.choice(frames))) for _ in range(count)] for count in (20, 200)
    )
    index = CountingIndex(examples, DtwSpec(window=0.1, cost="squared"))
    assert_brute_force(index.nearest(queries), queries, examples, index.spec, 1)
    assert 0 <= index.warped <= share * 20 * 200 and (index.warped > 0) == (share > 0)


class Broken:
    """A kernel of which one distance is NaN."""

    def supports(self, spec: DtwSpec) -> bool:
        return True

    def prepare(self, examples: SignalBatch, spec: DtwSpec) -> SignalBatch:
        return examples

    def distances(self, state: SignalBatch, queries: SignalBatch) -> np.ndarray:
        values = np.ones((len(queries), len(state)))
        values[0, -1] = np.nan
        return values


@pytest.mark.parametrize("spec", [DtwSpec(), DtwSpec(gamma=1.0)], ids=["hard", "soft"])
def test_a_kernel_is_held_to_its_contract(monkeypatch: pytest.MonkeyPatch, spec: DtwSpec) -> None:
    monkeypatch.setattr(search, "choose_kernel", lambda *_: ("broken", Broken()))
    with pytest.raises(PluginError, match="E_PLUGIN_CONTRACT distance kernel 'broken' returned"):
        nearest([np.zeros(3)] * 2, [np.zeros(3)] * 4, spec=spec)


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
    assert_brute_force(nearest(examples[:5], examples, 3, spec), examples[:5], examples, spec, 3)


@pytest.mark.parametrize(("dtype", "unit"), [(np.float32, 1e-25), (np.float64, 1e-170)])
def test_a_unit_whose_squares_vanish_is_refused(dtype: type, unit: float) -> None:
    rng = np.random.default_rng(4)
    series: list[np.ndarray] = [(unit * rng.normal(size=9)).astype(dtype) for _ in range(3)]
    for spec in (DtwSpec(cost="squared"), DtwSpec(mode="dependent", cost="euclidean")):
        with pytest.raises(InputError, match=r"E_MAGNITUDE .* a larger unit"):
            warping_distances(series, series, spec)
    assert warping_distances(series, series)[0, 1] > 0
    assert warping_distances([np.zeros(4, dtype)], [np.zeros(3, dtype)], DtwSpec(cost="squared")) == 0


def test_what_rounding_leaves_of_a_part_that_keeps_still_is_no_unit() -> None:
    rng = np.random.default_rng(4)
    still = [Signals(1e-17 * rng.normal(size=(n, 2)), np.arange(n) / 20, ("a_x", "a_y")) for n in (9, 7)]
    assert warping_distances(still[:1], still[1:], DtwSpec(mode="dependent", cost="squared")) < 1e-30
