"""A limit of the probability: what is refused below it, and what evaluation says of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gesture_core import GestureClassifier
from gesture_core.classify.classifiers import learn
from gesture_core.classify.decision import probabilities, temperature_of, votes_of
from gesture_core.classify.evaluation import Compared, Labelled, answer
from gesture_core.classify.scores import Answer, Evaluation
from gesture_core.errors import InputError
from gesture_core.report.evaluation import summary
from gesture_core.settings import Settings, load_settings

MODERN = load_settings("modern", environment={})


def clouds(seed: int, each: int, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of four classes, as series of three frames, and their labels."""
    random = np.random.default_rng(seed)
    codes = np.repeat(np.arange(4), each)
    return codes + random.normal(0, spread, len(codes)), codes


def limited(confidence: float | None, neighbors: int = 0) -> Settings:
    name = "auto" if neighbors else "weighed"
    changed = replace(
        MODERN.classify, confidence=confidence, classifier=name, neighbors=neighbors, reject=None
    )
    return replace(MODERN, classify=changed)


def compared(settings: Settings, seed: int = 0, spread: float = 0.5) -> Compared:
    """Those numbers of six subjects, compared by their difference."""
    places, codes = clouds(seed, 24, spread)
    names = [str(i) for i in range(len(codes))]
    subjects = [f"s{i % 6}" for i in range(len(codes))]
    data = Labelled([], list("abcd"[c] for c in codes), subjects, names)
    within = np.abs(places[:, None] - places[None])
    return Compared(data, settings, np.arange(len(codes)), within, {})


@pytest.mark.parametrize("neighbors", [0, 1, 3])
def test_what_is_less_likely_than_the_limit_gets_no_label(neighbors: int, tmp_path: Path) -> None:
    places, codes = clouds(0, 15, 0.4)
    arrays, labels = [np.full((3, 1), place) for place in places], codes.tolist()
    asked = [np.full((3, 1), place) for place in clouds(1, 5, 0.6)[0]]
    model = GestureClassifier("paper", "numpy", n_neighbors=neighbors, settings={"classify.confidence": 0.8})
    model.fit(arrays, labels)
    plain = GestureClassifier("paper", "numpy", n_neighbors=neighbors).fit(arrays, labels)
    chances = plain.predict_proba(asked).max(axis=1)
    np.testing.assert_array_equal(chances, model.predict_proba(asked).max(axis=1))
    assert 0 < (chances < 0.8).sum() < len(asked)
    found = model.predictions(asked)
    assert [one.confidence for one in found] == pytest.approx(chances.tolist(), abs=1e-6)
    assert all(one.confidence is None for one in plain.predictions(asked)), "none that was not calibrated"
    assert [one.label is None for one in found] == (chances < 0.8).tolist()
    assert (model.predict(asked) == -1).tolist() == (chances < 0.8).tolist()
    for one in found:
        assert (one.code, one.status) == (("", "ok") if one.label else ("E_UNSURE", "rejected"))
    (refused, *_) = [one for one in found if one.label is None]
    assert "with a probability of 0." in refused.message and "below 0.8; try" in refused.message
    model.save(tmp_path / "model")
    assert GestureClassifier.load(tmp_path / "model").predictions(asked) == found


def test_a_limit_needs_two_examples_of_some_class() -> None:
    arrays = [np.zeros((3, 1)), np.ones((3, 1))]
    model = GestureClassifier("paper", "numpy", settings={"classify.confidence": 0.8})
    with pytest.raises(InputError, match=r"no class has two examples.*classify\.margin"):
        model.fit(arrays, ["a", "b"])


def test_evaluation_calibrates_on_the_examples_of_each_fold_alone() -> None:
    data = compared(limited(None))
    found = answer(data, "leave-one-subject-out", calibrate=True)
    codes = np.unique(data.data.labels, return_inverse=True)[1]
    who = np.array(data.data.subjects)
    for one in found.answers[::7]:
        train = np.flatnonzero(who != one.subject)
        among = data.within[np.ix_(train, train)]
        fitted = learn(data.settings, (), codes[train], 4, among)[2]
        heat = temperature_of(fitted, among)
        row = data.within[int(one.name)][train][None]
        votes = votes_of(fitted, row)
        assert one.confidence == probabilities(votes.scores, heat).max()
    assert all(np.isnan(a.confidence) for a in answer(data, "leave-one-subject-out").answers)
    assert found.calibration_error is not None and found.calibration_error < 0.1


def test_the_curve_is_what_the_limit_does() -> None:
    for protocol in ("leave-one-subject-out", "leave-one-out"):
        found = answer(compared(limited(None), 0, 0.42), protocol, calibrate=True)
        point = found.confidence_for(0.9)
        assert point is not None and found.accuracy < 0.9 <= point[2]
        strict = answer(compared(limited(point[0]), 0, 0.42), protocol)
        kept = [a for a in strict.answers if a.predicted is not None]
        assert len(kept) / len(strict.answers) == point[1]
        assert np.mean([a.right for a in kept]) == point[2]
        assert {a.code for a in strict.answers if a.predicted is None} == {"E_UNSURE"}
        assert found.confidence_for(1.01) is None


def test_without_probabilities_nothing_is_said_of_them_unless_they_are_asked_for() -> None:
    found = answer(compared(limited(None)), "donor", calibrate=True)
    assert (found.confidence_curve(), found.calibration_error) == ([], None)
    with pytest.raises(InputError, match="no class has two examples"):
        answer(compared(limited(0.5)), "donor")


def test_the_calibration_error_is_the_gap_between_what_is_promised_and_what_is_right() -> None:
    def of(confidence: float, right: bool) -> Answer:
        return Answer("x", "a", "s", "f", "a" if right else "b", 1.0, 1.0, confidence=confidence)

    promised = [of(0.75, i < 6) for i in range(10)] + [of(1.0, True)] * 10
    assert Evaluation(promised, "split", MODERN).calibration_error == pytest.approx(0.15 / 2)


def test_of_few_labels_exact_probabilities_are_off_too() -> None:
    random, means = np.random.default_rng(1), []
    for count in (100, 1000):
        sure = random.uniform(0.3, 1.0, count)
        answers = [
            Answer("x", "a", "s", "f", "a" if drawn < one else "b", 1.0, 1.0, confidence=one)
            for one, drawn in zip(sure.tolist(), random.uniform(size=count), strict=True)
        ]
        found = Evaluation(answers, "split", MODERN)
        assert found.exact_error is not None and found.calibration_error is not None
        mean, most = found.exact_error
        assert mean < most and found.calibration_error < 1.2 * most
        means.append(mean)
        assert summary(found)["expected_calibration_error_if_exact"] == {"mean": mean, "quantile_95": most}
    assert 0.07 < means[0] < 0.1 and 0.02 < means[1] < 0.04
    nothing = Evaluation([Answer("x", "a", "s", "f", None, 1.0, 1.0)], "split", MODERN)
    assert nothing.exact_error is None and summary(nothing)["expected_calibration_error_if_exact"] is None


def test_an_evaluation_says_what_a_smallest_score_costs() -> None:
    plain = answer(compared(limited(None)), "leave-one-subject-out")
    curve = plain.score_curve()
    assert curve[0][1:] == (1.0, plain.accuracy)
    limit, coverage, accuracy = curve[len(curve) // 2]
    asked = limited(None).with_values([("classify.min_score", limit)])
    strict = answer(compared(asked), "leave-one-subject-out")
    labelled = [one for one in strict.answers if one.predicted is not None]
    assert len(labelled) / len(strict.answers) == coverage < 1
    assert np.mean([one.right for one in labelled]) == accuracy > plain.accuracy
    assert {one.code for one in strict.answers} == {"", "E_REJECTED"}
    assert answer(compared(limited(None, 1)), "leave-one-subject-out").score_curve() == [], (
        "of votes there is none"
    )
