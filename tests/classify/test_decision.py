"""Votes, ties, margins, medoids and thresholds, against scikit-learn and against plain loops."""

from __future__ import annotations

import numpy as np
import pytest
from fits import by_votes
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sklearn.neighbors import KNeighborsClassifier

from gesture_core.classify.decision import decide, k_nearest, votes_of
from gesture_core.classify.examples import ExampleLibrary
from gesture_core.classify.learning import calibrated_thresholds, medoids
from gesture_core.errors import ConfigError, InputError

QUERY = [np.zeros((3, 1))]


def matrix(queries: int, examples: int) -> st.SearchStrategy[np.ndarray]:
    """Distances with many ties, infinities and NaN."""
    values = st.sampled_from([0.0, 1.0, 1.0, 2.0, 3.0, np.inf, np.nan])
    return arrays(np.float64, (queries, examples), elements=values)


@given(matrix(4, 6), st.integers(1, 6))
def test_neighbours_are_sorted_ties_go_to_the_lower_index_and_nan_never_wins(
    distances: np.ndarray, k: int
) -> None:
    near = k_nearest(distances, k)
    for row, values, indices in zip(distances, near.distances, near.indices, strict=True):
        keys = [(np.inf if np.isnan(d) else d, i) for i, d in enumerate(row)]
        assert list(zip(values, indices, strict=True)) == sorted(keys)[:k]


@given(st.integers(0, 10_000), st.sampled_from([1, 3, 5]))
def test_votes_agree_with_scikit_learn_where_nothing_ties(seed: int, k: int) -> None:
    random = np.random.default_rng(seed)
    within, distances = np.zeros((12, 12)), random.permutation(84).reshape(7, 12) + 1.0
    codes = random.permutation(np.repeat([0, 1], 6))  # two classes and odd k: no tied count
    judge = KNeighborsClassifier(k, metric="precomputed").fit(within, codes)
    np.testing.assert_array_equal(
        votes_of(by_votes(codes, 2, k), distances).winners, judge.predict(distances)
    )


def test_a_tied_vote_goes_to_the_class_of_the_nearer_example() -> None:
    distances = np.array([[3.0, 1.0, 2.0, 4.0]])
    assert votes_of(by_votes(np.array([0, 1, 0, 1]), 2, 4), distances).winners.tolist() == [1]


def test_equal_distances_go_to_the_first_example() -> None:
    distances = np.ones((1, 3))
    assert votes_of(by_votes(np.array([2, 0, 1]), 3, 3), distances).winners.tolist() == [2]


def test_examples_that_cannot_be_compared_have_no_vote() -> None:
    distances = np.array([[np.inf, np.inf, 5.0], [np.nan, np.inf, np.nan]])
    votes = votes_of(by_votes(np.array([0, 0, 1]), 2, 3), distances)
    assert votes.winners.tolist() == [1, -1]
    assert votes.distances.tolist() == [5.0, np.inf]


@given(matrix(3, 6), st.integers(1, 6))
def test_margin_is_the_distance_of_the_other_classes_minus_that_of_the_winner(
    distances: np.ndarray, k: int
) -> None:
    codes = np.array([0, 1, 2, 0, 1, 2])
    votes = votes_of(by_votes(codes, 3, k), distances)
    clean = np.where(np.isnan(distances), np.inf, distances)
    for row, winner, distance, margin in zip(
        clean, votes.winners, votes.distances, votes.margins, strict=True
    ):
        assert not np.isnan(margin)
        if winner >= 0:
            assert distance == row[codes == winner].min()
            assert margin == row[codes != winner].min() - distance
            assert k > 1 or margin >= 0


@pytest.mark.parametrize("k", [0, 7, -1, 1.5, "3"])
def test_impossible_numbers_of_neighbours(k: object) -> None:
    with pytest.raises(ConfigError, match="E_NEIGHBORS"):
        k_nearest(np.ones((1, 6)), k)  # type: ignore[arg-type]


@given(arrays(np.float64, (6, 6), elements=st.sampled_from([0.0, 1.0, 2.0, 5.0, np.inf])))
def test_medoid_has_the_smallest_total_distance_in_its_class(raw: np.ndarray) -> None:
    distances = np.minimum(raw, raw.T)
    np.fill_diagonal(distances, 0)
    codes = np.array([0, 1, 0, 1, 0, 1])
    chosen = medoids(distances, codes)
    assert sorted(codes[chosen]) == [0, 1]
    for index in chosen:
        members = np.flatnonzero(codes == codes[index])
        totals = [distances[m, members].sum() for m in members]
        if np.isfinite(min(totals)):
            assert index == members[int(np.argmin(totals))]


def test_medoid_of_a_class_that_shares_nothing_is_its_first_example() -> None:
    assert medoids(np.full((2, 2), np.inf), np.array([0, 0])).tolist() == [0]


def test_thresholds_are_mean_and_deviation_of_the_nearest_classmate() -> None:
    within = np.array([[0, 1, 4, 9], [1, 0, 2, 9], [4, 2, 0, 9], [9, 9, 9, 0]], float)
    codes = np.array([0, 0, 0, 1])
    nearest = np.array([1, 1, 2])
    found = calibrated_thresholds(within, codes, 2, 2.0, np.arange(4))
    np.testing.assert_allclose(found, nearest.mean() + 2 * nearest.std())


def test_thresholds_of_representatives_are_those_of_the_distances_to_them() -> None:
    random = np.random.default_rng(0)
    points = random.normal(size=(40, 6))
    points[20:] += 10
    codes = np.repeat([0, 1], 20)
    within = np.linalg.norm(points[:, None] - points[None], axis=2)
    kept = medoids(within, codes)
    found = calibrated_thresholds(within[:, kept], codes, 2, 1.0, kept)
    for code, medoid in enumerate(kept):
        others = np.flatnonzero((codes == code) & (np.arange(40) != medoid))
        own = within[others, medoid]
        assert found[code] == pytest.approx(own.mean() + own.std())
    assert (
        found > 1.2 * calibrated_thresholds(within, codes, 2, 1.0, np.arange(40))
    ).all()  # of the nearest of all


def test_thresholds_need_two_examples_of_some_class() -> None:
    with pytest.raises(ConfigError) as caught:
        calibrated_thresholds(np.zeros((2, 2)), np.array([0, 1]), 2, 3.0, np.arange(2))
    assert caught.value.code == "E_REJECT"


def test_rejected_and_incomparable_queries_have_a_reason_and_no_label() -> None:
    library = ExampleLibrary.of([*QUERY, *QUERY], ["a", "b"], ["one", "two"])
    distances, fitted = np.array([[5.0, 7.0], [np.inf, np.nan]]), by_votes(library.codes, 2, 2)
    far, none = decide(distances, QUERY * 2, library, fitted, np.array([4.0, 9.0]))
    assert (far.label, far.status, far.code, far.margin) == (None, "rejected", "E_REJECTED", 2.0)
    assert far.neighbors == (("one", "a", 5.0), ("two", "b", 7.0))
    assert "4" in far.message
    assert (none.label, none.status, none.code) == (None, "error", "E_NO_COMMON")
    assert none.neighbors == ()


def test_a_single_class_has_no_margin() -> None:
    library = ExampleLibrary.of(QUERY, ["a"], ["one"])
    (found,) = decide(np.array([[1.0]]), QUERY, library, by_votes(library.codes, 1))
    assert (found.label, found.margin) == ("a", None)


def test_an_empty_or_uneven_library_is_refused() -> None:
    with pytest.raises(InputError, match="E_EXAMPLES"):
        ExampleLibrary.of([], [])
    with pytest.raises(InputError, match="E_EXAMPLES"):
        ExampleLibrary.of(QUERY, ["a", "b"], ["one"])
