"""Of many examples a part is compared with everything else; what it counts for is learned from all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from swings import pose, swing

from gesture_core import GestureClassifier
from gesture_core.classify import comparison
from gesture_core.classify.classifiers import content_order, landmarks, learn, teaching
from gesture_core.classify.evaluation import Compared, Labelled, answer
from gesture_core.classify.learning import learn_weights
from gesture_core.records import Job, encoded
from gesture_core.run.store import write_keypoints
from gesture_core.run.workers.decision import Decider
from gesture_core.run.workers.worker import Worker
from gesture_core.settings import ClassifySettings, Settings, load_settings
from gesture_core.types import Signals

EVERY = ClassifySettings(classifier="weighed")


def clouds(seed: int, each: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers around 0, 1 and 2, and their classes."""
    random = np.random.default_rng(seed)
    codes = np.repeat([0, 1, 2], each)
    return codes + random.normal(0, 0.25, len(codes)), codes


def under(count: int) -> Settings:
    paper = load_settings("paper", environment={})
    return replace(paper, classify=replace(EVERY, landmarks=count, kernel="numpy"))


def test_few_examples_are_all_compared() -> None:
    places, codes = clouds(0, 10)
    within = np.abs(places[:, None] - places[None])
    assert landmarks((), codes, EVERY).tolist() == list(range(30))
    kept, _, fitted = learn(under(512), (), codes, 3, within)
    assert len(kept) == 30
    plain = learn_weights(within, codes, 3, EVERY.sharpness, EVERY.shrinkage)
    np.testing.assert_array_equal(fitted.state["weights"], plain.weights)
    np.testing.assert_array_equal(fitted.state["scales"], plain.scales)


def test_each_class_keeps_its_share_and_one_at_least() -> None:
    codes = np.array([1] * 90 + [0] * 9 + [2])
    marks = landmarks((), codes, replace(EVERY, landmarks=20))
    assert np.bincount(codes[marks]).tolist() == [1, 18, 1]
    assert marks.tolist() == sorted(set(marks.tolist()))
    assert {0, 89} <= set(marks.tolist())
    for other in (
        replace(EVERY, landmarks=20, classifier="auto"),
        replace(EVERY, landmarks=20, representative=True),
    ):
        assert len(landmarks((), codes, other)) == 100


def test_all_examples_teach_what_the_landmarks_count_for() -> None:
    places, codes = clouds(1, 100)
    asked, truth = clouds(2, 100)
    marks = landmarks((), codes, replace(EVERY, landmarks=12))
    within = np.abs(places[:, None] - places[marks])
    far = np.abs(asked[:, None] - places[marks])
    taught = learn_weights(within, codes, 3, 3.0, 0.1, marks).scores(far)[0].argmax(axis=1)
    alone = learn_weights(within[marks], codes[marks], 3, 3.0, 0.1).scores(far)[0].argmax(axis=1)
    whole = learn_weights(np.abs(places[:, None] - places), codes, 3, 3.0, 0.1)
    every = whole.scores(np.abs(asked[:, None] - places))[0].argmax(axis=1)
    assert (taught == truth).mean() > (alone == truth).mean()
    assert abs((taught == truth).mean() - (every == truth).mean()) < 0.02


def test_a_fitted_classifier_keeps_the_landmarks(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    places, codes = clouds(3, 40)
    arrays = [np.full((4, 1), place) for place in places]
    compared: list[tuple[int, int]] = []
    distances = comparison.Comparison.distances

    def counting(self: comparison.Comparison, queries: list[Signals | np.ndarray]) -> np.ndarray:
        found = distances(self, queries)
        compared.append(found.shape)
        return found

    monkeypatch.setattr(comparison.Comparison, "distances", counting)
    settings = replace(under(21), classify=replace(under(21).classify, confidence=0.3, reject_sd=5.0))
    model = GestureClassifier(settings).fit(arrays, codes.tolist())
    assert sum(rows * columns for rows, columns in compared) == 120 * 21
    assert len(model.library_) == 21 and model.weights_ is not None
    assert "of 120 examples, inputs are compared with 21, some of each" in model._recognizer.note
    assert model.weights_.weights.shape == (21, 3)
    assert [codes[i] for i in model.example_indices_] == model.library_.codes.tolist()
    asked, truth = clouds(4, 20)
    queries = [np.full((4, 1), place) for place in asked]
    found = model.predictions(queries)
    assert np.mean([one.label == str(own) for one, own in zip(found, truth, strict=True)]) > 0.9
    model.save(tmp_path / "model")
    assert GestureClassifier.load(tmp_path / "model").predictions(queries) == found
    assert model.predict_proba(queries).shape == (60, 3)


def test_so_many_teach_that_a_fit_takes_no_longer_for_more(monkeypatch: pytest.MonkeyPatch) -> None:
    places, codes = clouds(3, 200)
    arrays = [np.full((4, 1), place) for place in places]
    settings = under(15)
    taught = teaching(arrays, codes, settings)
    assert np.bincount(codes[taught]).tolist() == [30, 30, 30]
    ends = {int(f(places[:200])) for f in (np.argmin, np.argmax)}
    assert ends <= set(taught.tolist()), "those at both ends of a class are among them"
    assert len(teaching((), codes[:90], settings)) == 90
    nearest = replace(settings, classify=replace(settings.classify, classifier="nearest"))
    rocket = replace(settings, classify=replace(settings.classify, classifier="rocket"))
    assert len(teaching((), codes, nearest)) == len(teaching((), codes, rocket)) == 600
    seen: list[int] = []
    distances = comparison.Comparison.distances

    def counting(self: comparison.Comparison, queries: list[Signals | np.ndarray]) -> np.ndarray:
        seen.append(len(queries))
        return distances(self, queries)

    monkeypatch.setattr(comparison.Comparison, "distances", counting)
    model = GestureClassifier(settings).fit(arrays, codes.tolist())
    assert sum(seen) == 90
    assert set(model.example_indices_) <= set(taught.tolist())
    for index, item in zip(model.example_indices_, model.library_.series, strict=True):
        np.testing.assert_array_equal(np.asarray(item), arrays[index])
    asked, truth = clouds(4, 20)
    assert (model.predict([np.full((4, 1), place) for place in asked]) == truth).mean() > 0.9


def test_evaluation_decides_as_the_classifier_does() -> None:
    places, codes = clouds(5, 30)
    subjects = [f"s{i % 3}" for i in range(90)]
    within = np.abs(places[:, None] - places[None])
    names = [str(i) for i in range(90)]
    arrays = [np.array([[place]]) for place in places]
    every = Labelled([], list(map(str, codes)), subjects, names)
    data = Compared(every, under(9), np.arange(90), within, {}, series=arrays)  # type: ignore[arg-type]
    found = answer(data, "leave-one-subject-out")
    for subject in ("s0", "s2"):
        train = [i for i in range(90) if subjects[i] != subject]
        model = GestureClassifier(under(9)).fit([arrays[i] for i in train], [str(codes[i]) for i in train])
        own = [a for a in found.answers if a.subject == subject]
        predicted = model.predict([arrays[int(a.name)] for a in own]).tolist()
        assert predicted == [a.predicted for a in own]


def test_a_run_opens_its_landmarks_again(tmp_path: Path) -> None:
    poses, labels = [], []
    for label, (axis, cycles) in {"up": (1, 1.0), "twice": (1, 2.0), "side": (0, 1.0)}.items():
        for frames in (25, 30, 36, 42):
            poses.append(pose(swing("right_wrist", axis, cycles, frames, 100.0)))
            labels.append(label)
    names = [f"{label}/{i}.mp4" for i, label in enumerate(labels)]
    changes = ["classify.landmarks=6", "classify.confidence=0.1", "classify.kernel=numpy"]
    settings = load_settings("modern", changes, environment={})
    job = Job(settings.as_dict(), str(tmp_path))
    fitted, opened = (Decider(Worker(job, lambda message: None)) for _ in range(2))
    stored = [f"{number}.parquet" for number in range(len(poses))]
    for name, label, one, file in zip(names, labels, poses, stored, strict=True):
        write_keypoints(tmp_path / file, [one], {})
        fitted.add_example(name, label, file)
    run = encoded(tmp_path)
    assert fitted.fit(run, "fingerprint").endswith("is learned from 12"), "the run says so"
    assert not opened.open_fitted(run, "other", names)
    assert not opened.open_fitted(run, "fingerprint", names[:-1])
    assert opened.open_fitted(run, "fingerprint", names)
    inputs = [{"name": name, "stored": file, "people": 1} for name, file in zip(names, stored, strict=True)]
    found = [one for (one,) in opened.decide(inputs)]
    assert found == [one for (one,) in fitted.decide(inputs)]
    assert [one["label"] for one in found] == labels
    assert len({name for one in found for name, _, _ in one["neighbors"]}) == 6


@pytest.mark.parametrize("name", ["weighed", "rocket", "blend"])
@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_the_examples_moves_no_score(
    name: str, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    random = np.random.default_rng(seed)
    codes = np.repeat([0, 1, 2], (9, 14, 5))
    waves = [np.sin(np.linspace(0, (3, 5, 9)[code], 20 + i))[:, None] for i, code in enumerate(codes)]
    arrays = [wave * [1, 0.5] + random.normal(0, 0.4, (len(wave), 2)) for wave in waves]
    monkeypatch.setattr("gesture_core.classify.classifiers._MOST", 7)
    monkeypatch.setattr("gesture_core.classify.classifiers._TEACHING", 2)
    chosen = replace(under(8).classify, classifier=name, confidence=0.0)
    settings, found = replace(under(8), classify=chosen), []
    for order in (np.arange(28), random.permutation(28), random.permutation(28)):
        model = GestureClassifier(settings).fit([arrays[i] for i in order], codes[order].tolist())
        kept = sorted(order[model.example_indices_].tolist())
        found.append((kept, model.decision_function(arrays), model.predict_proba(arrays)))
    for kept, scores, shares in found[1:]:
        assert kept == found[0][0] and len(kept) < 28
        np.testing.assert_allclose(scores, found[0][1], atol=1e-9)
        np.testing.assert_allclose(shares, found[0][2], atol=1e-9)


def test_an_order_of_their_own_survives_what_is_added_and_the_last_digits() -> None:
    random = np.random.default_rng(0)
    arrays = [random.normal(size=(int(random.integers(5, 40)), 3)) for _ in range(30)]
    order = content_order(arrays).tolist()
    assert sorted(order) == list(range(30)) != order
    assert content_order(arrays[::-1]).tolist() == [29 - i for i in order]
    assert [i for i in content_order([*arrays, random.normal(size=(9, 3))]).tolist() if i < 30] == order
    assert content_order([item * (1 + 1e-12) for item in arrays]).tolist() == order
