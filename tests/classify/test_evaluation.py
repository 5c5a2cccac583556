"""Protocols, intervals and nested choices; the paper's own numbers where its data are at hand."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest
from swings import pose, swing

from gesture_core.classify.evaluation import Labelled, answer, choose_nested, compare_all, folds
from gesture_core.classify.scores import Evaluation, wilson
from gesture_core.errors import ConfigError, GestureError, InputError, PoseError
from gesture_core.settings import Settings, load_settings
from gesture_core.types import PoseSequence, Signals

PAPER = load_settings("paper", environment={})


def evaluate(data: Labelled, protocol: str, settings: Settings) -> Evaluation:
    return answer(compare_all(data, settings), protocol)


def archive(broken: bool = False) -> Labelled:
    """Two gestures, three subjects, two trials each."""
    poses: list[PoseSequence | Signals | GestureError] = []
    labels, subjects, names = [], [], []
    random = np.random.default_rng(0)
    for subject in "ABC":
        for label, axis in (("up", 1), ("side", 0)):
            for trial in range(2):
                points = swing(
                    "right_wrist", axis, 1.0, int(random.integers(25, 45)), random.uniform(80, 100)
                )
                poses.append(pose(points))
                labels.append(label)
                subjects.append(subject)
                names.append(f"{label}_{subject}_{trial}")
    if broken:
        poses[0] = PoseError("nobody", code="E_POSE_SPARSE")
    return Labelled(poses, labels, subjects, names)


def test_leave_one_subject_out_tests_everybody_once() -> None:
    found = evaluate(archive(), "leave-one-subject-out", PAPER)
    assert len(found.answers) == 12
    assert found.accuracy == 1.0
    assert set(found.by_fold) == {"A", "B", "C"}
    columns, counts = found.confusion()
    assert columns == ["side", "up"]
    assert counts.tolist() == [[6, 0], [0, 6]]


def test_the_lower_of_two_thresholds_counts_as_in_the_classifier() -> None:
    both = replace(PAPER, classify=replace(PAPER.classify, reject=1e9, reject_sd=0.0))
    found = evaluate(archive(), "leave-one-subject-out", both)
    assert max(answer.threshold for answer in found.answers) < 1e9
    assert any(answer.predicted is None for answer in found.answers)


def test_what_was_answered_but_never_tested_has_a_column() -> None:
    data = archive()
    train = [subject != "C" for subject in data.subjects]
    labels = ["wave" if s == "C" else label for s, label in zip(data.subjects, data.labels, strict=True)]
    found = evaluate(replace(data, labels=labels, train=train), "split", PAPER)
    columns, counts = found.confusion()
    assert columns == ["wave", "side", "up"]
    assert counts.tolist() == [[0, 2, 2]]


def test_a_class_called_none_is_not_what_was_not_recognised() -> None:
    data = archive(broken=True)
    labels = ["(none)" if label == "up" else label for label in data.labels]
    columns, counts = evaluate(replace(data, labels=labels), "leave-one-out", PAPER).confusion()
    assert columns == ["(none)", "side", "((none))"]
    assert counts.sum() == 12 and counts[:, -1].sum() == 1


def test_an_unusable_input_counts_as_not_recognised_in_every_protocol() -> None:
    for protocol, tested, missed in (
        ("leave-one-subject-out", 12, 1),
        ("leave-one-out", 12, 1),
        ("donor", 24, 2),
    ):
        found = evaluate(archive(broken=True), protocol, PAPER)
        assert len(found.answers) == tested
        assert sum(a.code == "E_POSE_SPARSE" for a in found.answers) == missed
        assert found.accuracy == pytest.approx(1 - missed / tested)
        assert found.confusion()[0][-1] == "(none)"


def test_a_fold_never_sees_the_subject_that_it_tests() -> None:
    random = np.random.default_rng(1)
    codes, who = np.repeat([0, 1], 6), np.array(list("AABBCC" * 2))
    within = random.random((12, 12))
    for protocol in ("leave-one-subject-out", "donor"):
        for fold in folds(protocol, codes, who.tolist(), within):
            assert not set(who[fold.train]) & set(who[fold.test])
            if protocol == "donor":
                assert sorted(codes[fold.train]) == [0, 1]


def test_the_split_is_as_asked_for() -> None:
    data = archive()
    train = [subject == "A" for subject in data.subjects]
    found = evaluate(replace(data, train=train), "split", PAPER)
    assert {a.subject for a in found.answers} == {"B", "C"}
    with pytest.raises(ConfigError, match="E_SPLIT"):
        evaluate(data, "split", PAPER)


def test_protocols_that_do_not_fit() -> None:
    data = archive()
    alone = replace(data, subjects=[""] * 12)
    with pytest.raises(ConfigError, match="E_SUBJECTS"):
        evaluate(alone, "leave-one-subject-out", PAPER)
    with pytest.raises(ConfigError, match="one of"):
        evaluate(data, "bootstrap", PAPER)
    with pytest.raises(InputError, match="E_EMPTY"):
        evaluate(Labelled([PoseError("nobody")], ["a"], ["A"], ["x"]), "leave-one-out", PAPER)


@pytest.mark.parametrize(("protocol", "each"), [("leave-one-subject-out", 1), ("donor", 3)])
def test_a_subject_of_whom_nothing_can_be_used_counts_as_not_recognised(protocol: str, each: int) -> None:
    data = archive()
    gone = [PoseError("nobody", code="E_POSE_SPARSE")] * 4
    data = Labelled(
        [*data.poses, *gone], [*data.labels, *["up"] * 4], [*data.subjects, *"DDDD"], [*data.names, *"wxyz"]
    )
    found = evaluate(data, protocol, PAPER)
    failed = [answer for answer in found.answers if answer.code == "E_POSE_SPARSE"]
    assert len(failed) == 4 * each and {answer.subject for answer in failed} == {"D"}
    assert found.accuracy == pytest.approx(12 / 16 if each == 1 else 24 / 36)


def test_rejection_trades_coverage_for_accuracy() -> None:
    found = evaluate(archive(), "leave-one-subject-out", PAPER)
    curve = found.rejection_curve()
    coverages = [coverage for _, coverage, _ in curve]
    assert coverages == sorted(coverages, reverse=True)
    assert coverages[0] == 1.0
    by_margin = found.margin_curve()
    assert [m for m, _, _ in by_margin] == sorted({a.margin for a in found.answers})
    assert (by_margin[0][1], by_margin[0][2]) == (1.0, found.accuracy)
    assert by_margin[-1][1] == pytest.approx(1 / 12)
    middle = float(np.median([a.distance for a in found.answers]))
    half = evaluate(archive(), "leave-one-subject-out", PAPER.with_values([("classify.reject", middle)]))
    kept = sum(a.predicted is not None for a in half.answers)
    assert 0 < kept < 12  # what is refused counts as not covered at any further limit
    for loosest in (half.rejection_curve()[0], half.margin_curve()[0]):
        assert loosest[1] == pytest.approx(kept / 12)
    assert half.rejection_curve()[0][0] <= middle
    strict = PAPER.with_values([("classify.reject", 1e-9)])
    none = evaluate(archive(), "leave-one-subject-out", strict)
    assert none.accuracy == 0
    assert {a.code for a in none.answers} == {"E_REJECTED"}
    assert none.rejection_curve() == []


def test_the_nested_choice_takes_what_is_best_among_the_others() -> None:
    data = archive()
    blind = compare_all(data, PAPER)
    blind = replace(blind, within=np.ones_like(blind.within))
    good = compare_all(data, PAPER)
    found, choices = choose_nested([blind, good])
    assert choices == {"A": 1, "B": 1, "C": 1}
    assert found.accuracy == 1.0
    assert len(good.without("A").usable) == 8
    assert answer(good.without("A"), "leave-one-subject-out").accuracy == 1.0


def test_a_sequence_in_which_nothing_moves_has_the_code_that_the_classifier_gives() -> None:
    data = archive()
    still = pose(swing(size=0.0, frames=30) + np.random.default_rng(0).normal(0, 0.5, (30, 18, 2)))
    found = evaluate(
        replace(data, poses=[still, *data.poses[1:]]),
        "leave-one-subject-out",
        load_settings("modern", environment={}),
    )
    assert [a.code for a in found.answers if a.name == data.names[0]] == ["E_NO_SALIENT"]


def test_a_nested_choice_needs_subjects_to_choose_on() -> None:
    data = archive()
    pairs = compare_all(replace(data, subjects=["A", "B"] * 6), PAPER)
    with pytest.raises(ConfigError, match="needs three subjects and there are 2"):
        choose_nested([pairs, pairs])


def test_more_neighbours_than_a_fold_has_examples_are_refused_as_in_the_classifier() -> None:
    with pytest.raises(ConfigError, match="E_NEIGHBORS 3 neighbours were asked for and there are 2 examples"):
        evaluate(archive(), "donor", PAPER.with_values([("classify.neighbors", 3)]))


@given(st.integers(1, 300), st.data())
def test_interval_is_wilsons(total: int, data: st.DataObject) -> None:
    right = data.draw(st.integers(0, total))
    expected = binomtest(right, total).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(wilson(right, total), (expected.low, expected.high), atol=1e-4)


def _benchmark(name: str) -> ModuleType:
    folder = Path(__file__).resolve().parents[2] / "benchmarks"
    sys.path.insert(0, str(folder))
    try:
        spec = importlib.util.spec_from_file_location(f"benchmark_{name}", folder / f"{name}.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[module.__name__] = module  # dataclasses look their module up
        spec.loader.exec_module(module)
        return module
    finally:
        sys.path.remove(str(folder))


def test_the_papers_table_at_its_own_threshold(shared: Path) -> None:
    paper = _benchmark("paper")
    items = {item.name: item for item in paper.utd_openpose(shared.parent)}
    examples = [items[name] for name in paper.PAPER_EXAMPLES]
    queries = [item for item in items.values() if item.subject != "s1"]
    script = paper.script_predictions(queries, examples, 0.10, "auto")
    choice = paper.authors_choice(shared.parent)
    assert [choice[q.name] for q in queries] == script
    assert paper.correct(queries, script) == 130
    text = paper.preset_predictions(queries, examples, paper.at(PAPER, 0.10, "auto"))
    assert paper.correct(queries, text) == 129


def test_modern_recognises_the_published_keypoints(shared: Path) -> None:
    data = _benchmark("evaluate")
    settings = load_settings("modern", environment={})
    items = data.utd_openpose(shared.parent)
    compared = compare_all(data.labelled(items, settings), settings)
    assert answer(compared, "leave-one-subject-out").accuracy >= 191 / 192
    assert answer(compared, "donor").accuracy >= 0.94
    assert int(data.authors_examples(compared).split("/")[0]) >= 162
