"""How much each example counts: against scikit-learn's ridge, and what must hold for any distances."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fits import by_votes, by_weights
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.linear_model import Ridge
from swings import pose, swing

from gesture_core import GestureClassifier, classify_archive
from gesture_core.classify import recognizer
from gesture_core.classify.decision import decide, votes_of
from gesture_core.classify.evaluation import Labelled, answer, compare_all
from gesture_core.classify.examples import ExampleLibrary
from gesture_core.classify.explanation import explain
from gesture_core.classify.learning import ExampleWeights, learn_weights
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import ConfigError
from gesture_core.run.pipeline import RunSummary
from gesture_core.settings import ClassifySettings, load_settings
from gesture_core.types import Signals

pytestmark = pytest.mark.usefixtures("in_this_process")

ALL = load_settings("modern", ["classifier=weighed"], environment={})
SEEDS = st.integers(0, 2**32 - 1)


def plane(seed: int, count: int, classes: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances among points and from queries to them, and a class of each point, of every class one."""
    random = np.random.default_rng(seed)
    points, queries = random.normal(size=(count, 3)), random.normal(size=(4, 3))
    codes = np.concatenate([np.arange(classes), random.integers(0, classes, count - classes)])
    far = [np.linalg.norm(some[:, None] - points[None], axis=2) for some in (points, queries)]
    return far[0], far[1], codes


def learned(within: np.ndarray, codes: np.ndarray) -> ExampleWeights:
    return learn_weights(within, codes, int(codes.max()) + 1, 3.0, 0.1)


def scores_of(weights: ExampleWeights, distances: np.ndarray) -> np.ndarray:
    scores, factors = weights.scores(distances)
    summed: np.ndarray = scores * factors[:, None]
    return summed


@given(SEEDS, st.integers(3, 12), st.sampled_from([0.5, 3.0]), st.sampled_from([0.01, 0.1, 1.0]))
@settings(max_examples=40, deadline=None)
def test_weights_are_those_of_ridge_regression(
    seed: int, count: int, sharpness: float, shrinkage: float
) -> None:
    within, _, codes = plane(seed, count)
    scales = [np.median([within[i, j] for i in range(count) if codes[i] != codes[j]]) for j in range(count)]
    similarity = np.empty((count, count))
    for i in range(count):
        for j in range(count):
            similarity[i, j] = np.exp(-sharpness * within[i, j] / np.sqrt(scales[i] * scales[j]))
    members = np.bincount(codes)
    scarcity = members.mean() / members[codes]
    targets = np.eye(3)[codes] * scarcity[:, None] ** 0.25 - 1 / 3
    judge = Ridge(alpha=shrinkage, fit_intercept=False, solver="svd")
    judge.fit(similarity, targets, sample_weight=scarcity)
    found = learn_weights(within, codes, 3, sharpness, shrinkage)
    np.testing.assert_allclose(found.weights, judge.coef_.T, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.scales, np.sqrt(np.array(scales) * np.median(scales)))


@given(SEEDS, st.integers(2, 6))
@settings(max_examples=40, deadline=None)
def test_with_one_example_a_class_all_alike_the_nearest_decides(seed: int, classes: int) -> None:
    distances = np.random.default_rng(seed).uniform(0.1, 2.0, (20, classes))
    codes = np.arange(classes)
    votes = votes_of(by_weights(1.0 - np.eye(classes), codes), distances)
    np.testing.assert_array_equal(votes.winners, distances.argmin(axis=1))
    np.testing.assert_array_equal(votes.distances, distances.min(axis=1))


@given(SEEDS, st.integers(4, 12))
@settings(max_examples=40, deadline=None)
def test_a_row_depends_on_no_other_row_on_no_order_and_on_no_unit(seed: int, count: int) -> None:
    within, distances, codes = plane(seed, count)
    weights = learned(within, codes)
    scores = scores_of(weights, distances)
    for row, score in zip(distances, scores, strict=True):
        np.testing.assert_array_equal(scores_of(weights, row[None])[0], score)
    np.testing.assert_allclose(scores_of(learned(7 * within, codes), 7 * distances), scores, atol=1e-9)
    order = np.random.default_rng(seed).permutation(count)
    other = learned(within[np.ix_(order, order)], codes[order])
    np.testing.assert_allclose(scores_of(other, distances[:, order]), scores, atol=1e-9)
    np.testing.assert_allclose(weights.contributions(distances).sum(axis=1), scores, atol=1e-12)


def test_examples_that_agree_outvote_one_that_is_near_to_everything() -> None:
    # Three examples of class 0, three of class 1, of which the last lies among those of class 0.
    codes = np.array([0, 0, 0, 1, 1, 1])
    within = np.full((6, 6), 1.0)
    within[:3, :3] = within[3:5, 3:5] = 0.2
    within[5, :3] = within[:3, 5] = 0.2
    np.fill_diagonal(within, 0)
    query = np.array([[0.2, 0.2, 0.2, 1.0, 1.0, 0.19]])
    assert votes_of(by_votes(codes, 2), query).winners.tolist() == [1]
    assert votes_of(by_weights(within, codes), query).winners.tolist() == [0]


def test_a_class_of_one_example_is_met_beside_a_class_of_many() -> None:
    random = np.random.default_rng(4)
    points = np.concatenate([random.normal(size=(30, 2)), [[2.5, 0.0]]])
    codes = np.array([0] * 30 + [1])
    within = np.linalg.norm(points[:, None] - points[None], axis=2)
    query = np.linalg.norm(np.array([[2.6, 0.1]])[:, None] - points[None], axis=2)
    assert votes_of(by_weights(within, codes), query).winners.tolist() == [1]


def test_a_class_of_one_example_takes_little_from_a_class_of_many() -> None:
    random = np.random.default_rng(4)
    points = np.concatenate([random.normal(size=(30, 2)), [[2.5, 0.0]]])
    codes = np.array([0] * 30 + [1])
    within = np.linalg.norm(points[:, None] - points[None], axis=2)
    fresh = random.normal(size=(1000, 2))
    votes = votes_of(by_weights(within, codes), np.linalg.norm(fresh[:, None] - points[None], axis=2))
    assert (votes.winners == 1).sum() < 40  # the nearest example takes 6, the coding of Ye (2007) 269
    assert np.median(votes.margins[votes.winners == 0]) > 0.5


@pytest.mark.parametrize("unit", [1e-90, 1e80, 1e150])
def test_scores_have_no_unit_however_extreme(unit: float) -> None:
    within, distances, codes = plane(3, 9)
    plain = scores_of(learned(within, codes), distances)
    np.testing.assert_allclose(scores_of(learned(within * unit, codes), distances * unit), plain, atol=1e-9)


def test_what_cannot_be_compared_counts_for_nothing() -> None:
    within, distances, codes = plane(1, 9)
    within[0, 1] = within[1, 0] = np.inf
    weights = learned(within, codes)
    assert np.isfinite(weights.weights).all()
    distances = distances.copy()
    distances[0] = np.nan
    distances[1, codes == 2] = np.inf
    assert not weights.similarities(distances[:1]).any()
    votes = votes_of(by_weights(within, codes), distances)
    assert votes.winners[0] == -1
    assert (votes.distances[0], votes.margins[0]) == (np.inf, np.inf)
    assert votes.winners[1] in (0, 1)
    assert not np.isnan(votes.margins).any()


def test_far_from_everything_the_order_stands_and_the_lead_is_gone() -> None:
    within, distances, codes = plane(2, 9)
    fitted = by_weights(within, codes)
    far, near = votes_of(fitted, distances + 1e6), votes_of(fitted, distances)
    assert far.margins.tolist() == [0.0] * 4
    assert np.isfinite(far.distances).all()
    assert (near.margins > 0).all()
    # The same amount more to examples of equal scales multiplies all scores alike.
    alike = replace(fitted, state={**fitted.state, "scales": np.ones(9)})
    moved, still = (votes_of(alike, distances + more) for more in (1e3, 0.0))
    assert moved.winners.tolist() == still.winners.tolist()


@pytest.mark.parametrize("within", [np.full((3, 3), value) for value in (0.0, 1e-310, np.inf, np.nan)])
def test_degenerate_libraries_still_answer(within: np.ndarray) -> None:
    codes = np.array([0, 1, 1])
    fitted = by_weights(within, codes)
    votes = votes_of(fitted, np.array([[0.0, 1.0, 2.0], [3.0, 0.5, np.inf]]))
    assert set(votes.winners.tolist()) <= {0, 1}
    assert np.isfinite(fitted.state["weights"]).all()


def test_equal_scores_go_to_the_nearer_class_then_to_that_of_the_first_example() -> None:
    within = np.array([[0.0, 1.0], [1.0, 0.0]])
    votes = votes_of(by_weights(within, np.array([1, 0])), np.array([[0.4, 0.4]]))
    assert votes.winners.tolist() == [1]
    assert votes.margins.tolist() == [0.0]


def test_one_class_always_leads() -> None:
    votes = votes_of(by_weights(np.ones((2, 2)), np.zeros(2, int)), np.array([[0.4, 0.4]]))
    assert (votes.winners.tolist(), votes.margins.tolist()) == ([0], [np.inf])


def gestures(seed: int, per_class: int) -> tuple[list, list[str], list[str]]:  # type: ignore[type-arg]
    """Noisy gestures of three classes by as many subjects as there are of each class."""
    random = np.random.default_rng(seed)
    poses, labels, subjects = [], [], []
    for label, (axis, cycles) in {"up": (1, 1.0), "twice": (1, 2.0), "side": (0, 1.0)}.items():
        for trial in range(per_class):
            frames, size = int(random.integers(25, 45)), random.uniform(90, 130)
            points = swing("right_wrist", axis, cycles, frames, size)
            poses.append(pose(points + random.normal(0, 2, points.shape)))
            labels.append(label)
            subjects.append(f"s{trial}")
    return poses, labels, subjects


def test_the_classifier_lets_all_examples_decide() -> None:
    poses, labels, _ = gestures(0, 3)
    queries, truth, _ = gestures(1, 2)
    model = GestureClassifier(ALL).fit(poses, labels)
    assert model.weights_ is not None
    assert model.predict(queries).tolist() == truth
    assert model.kneighbors(queries)[0].shape == (6, 1)
    for row, label in zip(model.predictions(queries), truth, strict=True):
        assert (row.label, row.status, row.code) == (label, "ok", "")
        # The nearest example of each class, the winner's first.
        assert sorted(each for _, each, _ in row.neighbors) == ["side", "twice", "up"]
        assert row.neighbors[0][1:] == (label, row.distance)
        assert row.margin is not None and 0 < row.margin < 2
    assert GestureClassifier("modern", n_neighbors=1).fit(poses, labels).weights_ is None


def test_a_large_library_shows_that_it_is_alive(monkeypatch: pytest.MonkeyPatch) -> None:
    poses, labels, _ = gestures(0, 3)
    signs: list[int] = []
    monkeypatch.setattr(recognizer, "_MOST_ROWS", 4)
    model = GestureClassifier(ALL).fit(poses, labels, alive=lambda: signs.append(1))
    assert len(signs) >= 3
    monkeypatch.setattr(recognizer, "_MOST_ROWS", 100)
    whole = GestureClassifier(ALL).fit(poses, labels)
    assert model.weights_ is not None and whole.weights_ is not None
    np.testing.assert_array_equal(model.weights_.weights, whole.weights_.weights)


@pytest.mark.parametrize("kernel", ["numba", "numpy"])
def test_the_bits_of_a_row_depend_on_no_other_row(kernel: str) -> None:
    poses, labels, _ = gestures(0, 3)
    queries, _, _ = gestures(1, 2)
    model = GestureClassifier(ALL, kernel=kernel).fit(poses, labels)
    together = model.distances(queries)
    for row, query in zip(together, queries, strict=True):
        np.testing.assert_array_equal(model.distances([query])[0], row)
    assert model.predictions(queries) == [model.predictions([query])[0] for query in queries]


def test_a_small_margin_gives_no_label() -> None:
    poses, labels, _ = gestures(0, 3)
    queries, _, _ = gestures(1, 2)
    strict = ALL.with_values([("classify.margin", 5.0)])
    model = GestureClassifier(strict).fit(poses, labels)
    assert model.predict(queries).tolist() == ["(none)"] * 6
    row = model.predictions(queries)[0]
    assert (row.label, row.status, row.code) == (None, "rejected", "E_UNSURE")
    assert row.margin is not None and f"margin of {row.margin:.4g}, below 5; try: " in row.message
    nearest = strict.with_values([("classify.neighbors", 1), ("classify.margin", 1e9)])
    assert [r.code for r in GestureClassifier(nearest).fit(poses, labels).predictions(queries)] == (
        ["E_UNSURE"] * 6
    )


def test_what_is_like_no_example_gets_no_label_by_its_score() -> None:
    poses, labels, _ = gestures(0, 3)
    queries, truth, _ = gestures(1, 2)
    strangers = [pose(swing("left_ankle", 0, 4.0, 40, 60.0))]
    strict = ALL.with_values([("classify.min_score", 0.2), ("classify.reject", None)])
    model = GestureClassifier(strict).fit(poses, labels)
    scores = model.decision_function([*queries, *strangers]).max(axis=1)
    assert scores[:-1].min() > 0.2 > scores[-1]
    assert model.predict([*queries, *strangers]).tolist() == [*truth, "(none)"]
    assert GestureClassifier(ALL).fit(poses, labels).predictions(queries)[0].score is None
    row = model.predictions(strangers)[0]
    assert (row.label, row.status, row.code) == (None, "rejected", "E_REJECTED")
    assert f"at best, with a score of {scores[-1]:.4g}, below 0.2; try: " in row.message
    assert [one.score for one in model.predictions([*queries, *strangers])] == pytest.approx(scores)
    far = strict.with_values([("classify.reject", 1e-9)])
    refused = GestureClassifier(far).fit(poses, labels).predictions(strangers)[0]
    assert refused.message.endswith("above 1e-09"), "the distance is the first reason"
    assert refused.score == pytest.approx(scores[-1]), "the row tells of both"
    with pytest.raises(ConfigError, match="vote by their distances"):
        GestureClassifier(strict.with_values([("classify.classifier", "nearest")])).fit(poses, labels)


def test_with_one_class_no_margin_is_asked_for() -> None:
    library = ExampleLibrary((np.zeros((3, 1)),), ("a",), ("one",))
    asked, votes = ClassifySettings(margin=0.5), by_votes(library.codes, 1)
    (row,) = decide(np.array([[1.0]]), [np.zeros((3, 1))], library, votes, None, asked)
    assert (row.label, row.margin) == ("a", None)


def test_evaluation_answers_what_the_classifier_would() -> None:
    poses, labels, subjects = gestures(3, 3)
    names = [f"{label}{who}" for label, who in zip(labels, subjects, strict=True)]
    chosen = ALL.with_values([("classify.margin", 0.2)])
    found = answer(compare_all(Labelled(poses, labels, subjects, names), chosen), "leave-one-subject-out")
    for tested in found.answers:
        kept = [i for i, who in enumerate(subjects) if who != tested.subject]
        model = GestureClassifier(chosen).fit([poses[i] for i in kept], [labels[i] for i in kept])
        (row,) = model.predictions([poses[names.index(tested.name)]])
        assert (row.label, row.code, row.margin) == (tested.predicted, tested.code, tested.margin)
        assert row.distance == pytest.approx(tested.distance, rel=1e-6)


def test_an_explanation_is_what_the_examples_add() -> None:
    poses, labels, _ = gestures(0, 3)
    model = GestureClassifier(ALL).fit(poses, labels)
    (query,) = model.signals(gestures(1, 1)[0][:1])
    assert isinstance(query, Signals)
    row = model.distances([query])[0]
    found = explain(query, model.library_, row, ALL, model._recognizer.fitted)
    (answer,) = model.predictions([query])
    assert found.runner_up is not None
    assert [found.nearest.label, found.runner_up.label] == [label for _, label, _ in answer.neighbors[:2]]
    assert found.lead == pytest.approx(answer.margin, abs=1e-6)
    assert sum(each.added for each in found.contributions) == pytest.approx(found.lead)
    assert sorted(each.example for each in found.contributions) == sorted(model.library_.names)
    sizes = [abs(each.added) for each in found.contributions]
    assert sizes == sorted(sizes, reverse=True)
    alone = GestureClassifier(ALL).fit(poses[:2], labels[:2])
    found = explain(query, alone.library_, alone.distances([query])[0], ALL, alone._recognizer.fitted)
    assert (found.runner_up, found.contributions, found.lead) == (None, (), 0.0)


@pytest.mark.parametrize("text", ["neighbors=-1", "sharpness=0", "shrinkage=0", "classify.margin=-1"])
def test_wrong_values_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"classify\."):
        load_settings("modern", [text], environment={})


def test_a_run_keeps_its_weights_and_explains_it(
    drawn: DemoArchive, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from gesture_core.cli.explain import explain as explain_command

    def run(**changes: object) -> RunSummary:
        chosen = {"settings": "modern", "classify__kernel": "numpy", "classify__neighbors": 0, **changes}
        return classify_archive(drawn.video_keypoints, drawn.example_keypoints, tmp_path / "run", **chosen)  # type: ignore[arg-type]

    first = run()
    row = next(row for row in first.rows() if row.status == "ok")
    with pytest.raises(ConfigError, match="sharpness"):
        run(classify__sharpness=2.0)
    with pytest.raises(ConfigError, match="margin"):
        run(classify__margin=0.1)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert explain_command(tmp_path / "run", row.input, out=tmp_path / "plot.png") == 0
    text = capsys.readouterr().out
    assert row.margin is not None
    assert f"their contributions add up to the margin, {row.margin:.3g}" in text
    for name, label, distance in row.neighbors[:2]:
        line = next(line for line in text.splitlines() if name in line)
        assert label in line and f"{distance:.4g}" in line
