"""`GestureClassifier`: scikit-learn's interface, all three kinds of input, rejection, mirrored examples."""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sklearn.base import clone, is_classifier
from sklearn.exceptions import NotFittedError
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted
from swings import GESTURES, data, pose, swing

from gesture_core import GestureClassifier, warping_distances
from gesture_core.classify.comparison import Extents, common_share, compare
from gesture_core.classify.recognizer import Recognizer
from gesture_core.errors import ConfigError, InputError
from gesture_core.settings import Settings, load_settings
from gesture_core.types import Signals


@pytest.mark.parametrize("preset", ["paper", "modern"])
def test_fit_predict_score(preset: str) -> None:
    poses, labels = data()
    queries, truth = data(2, seed=1)
    model = GestureClassifier(preset).fit(poses, labels)
    assert model.classes_.tolist() == sorted(GESTURES)
    assert model.predict(queries).tolist() == truth
    assert model.score(queries, truth) == 1.0
    assert model.score(queries[:2], [truth[0], "?"], sample_weight=[3, 1]) == 0.75
    with pytest.raises(InputError, match="0 queries and 0 labels"):
        model.score([], [])


def test_kneighbors_index_into_what_was_given_to_fit() -> None:
    poses, labels = data()
    model = GestureClassifier("paper").fit(poses, labels)
    distances, indices = model.kneighbors(poses, 2)
    assert distances.shape == indices.shape == (9, 2)
    np.testing.assert_array_equal(indices[:, 0], np.arange(9))
    np.testing.assert_allclose(distances[:, 0], 0, atol=1e-6)
    signals = model.signals(poses)
    expected = warping_distances(signals, signals, model.settings_.dtw)
    np.testing.assert_allclose(model.distances(poses), expected)


def test_representatives_keep_one_example_of_each_class() -> None:
    poses, labels = data()
    settings = load_settings("paper", environment={}).with_values([("classify.representative", True)])
    model = GestureClassifier(settings).fit(poses, labels)
    assert len(model.library_) == 3
    assert [labels[i] for i in model.example_indices_] == list(model.library_.labels)
    _, indices = model.kneighbors(poses[:1], 1)
    assert indices[0, 0] in model.example_indices_


def test_scikit_learn_takes_it_for_a_classifier() -> None:
    poses, labels = data()
    model = GestureClassifier("paper", n_neighbors=3, reject=5.0)
    twin = clone(model)
    assert twin is not model
    assert twin.get_params() == model.get_params()
    assert is_classifier(model)
    tags = model.__sklearn_tags__()
    assert (tags.input_tags.two_d_array, tags.input_tags.allow_nan, tags.target_tags.required) == (
        False,
        True,
        True,
    )
    assert repr(model) == "GestureClassifier(n_neighbors=3, preset='paper', reject=5.0)"
    scores = cross_val_score(GestureClassifier("paper"), poses, labels, cv=3)
    assert scores.tolist() == [1, 1, 1]
    search = GridSearchCV(GestureClassifier("paper"), {"n_neighbors": [1, 2]}, cv=3).fit(poses, labels)
    assert search.best_score_ == 1.0


def test_a_recognizer_works_without_scikit_learn_and_predicts_the_same() -> None:
    code = (
        "import sys; sys.modules['sklearn'] = None\n"
        "import numpy as np; from gesture_core.classify.recognizer import Recognizer\n"
        "from gesture_core.settings import load_settings\n"
        "up, down = np.linspace(0, 1, 20)[:, None], np.linspace(1, 0, 25)[:, None]\n"
        "m = Recognizer.fit(load_settings('paper', ['kernel=numpy']), [up, down], ['up', 'down'])\n"
        "print([row.label for row in m.predictions([up[::2], down[::3]])])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("['up', 'down']")
    poses, labels = data()
    queries, _ = data(2, seed=1)
    model = GestureClassifier("modern").fit(poses, labels)
    assert Recognizer.fit(model.settings_, poses, labels).predictions(queries) == model.predictions(queries)


def test_arrays_are_compared_as_they_are_and_labels_keep_their_type() -> None:
    random = np.random.default_rng(3)
    series = [random.normal(size=(n, 2)) for n in (5, 9, 1, 7)]
    model = GestureClassifier(kernel="numpy").fit(series, [10, 20, 10, 30])
    assert model.predict(series).tolist() == [10, 20, 10, 30]
    assert model.predict(series).dtype.kind == "i"
    assert model.predictions(series)[1].label == "20"


def test_arrays_are_copied_and_a_row_depends_on_no_other_ones_precision() -> None:
    series = [np.random.default_rng(n).normal(size=(n, 2)).astype(np.float32) for n in (5, 6, 7)]
    model = GestureClassifier("paper", "numpy").fit(series, ["a", "b", "c"])
    query = series[0] + np.float32(0.1)
    (alone,) = model.predictions([query])
    assert model.predictions([query, series[1].astype(float)])[0] == alone
    series[0][:] = 99
    assert model.predictions([query]) == [alone]


def test_rejection_by_distance_and_by_calibration() -> None:
    poses, labels = data(4)
    strange = pose(swing("left_ankle", 0, 3.0, 40, 200))
    loose = GestureClassifier("modern").fit(poses, labels)
    assert loose.predictions([strange])[0].status == "ok"
    for reject in (1e-9, "calibrated"):
        model = GestureClassifier("modern", reject=reject).fit(poses, labels)
        (row,) = model.predictions([strange])
        assert (row.label, row.status, row.code) == (None, "rejected", "E_REJECTED")
        assert model.predict([strange]).tolist() == ["(none)"]
    queries, truth = data(2, seed=5)
    assert GestureClassifier("modern", reject="calibrated").fit(poses, labels).score(queries, truth) > 0.6


def with_classify(**values: object) -> Settings:
    settings = load_settings("modern", environment={})
    return replace(settings, classify=replace(settings.classify, **values))  # type: ignore[arg-type]


def test_mirrored_examples_cost_their_factor() -> None:
    right, left = pose(swing("right_wrist")), pose(swing("left_wrist"))
    off, on = with_classify(mirror=None), with_classify(mirror=1.5)
    a, b = GestureClassifier(off).signals([right, left])
    plain = compare([a], [b], off)[0, 0]
    assert plain > 0.01
    np.testing.assert_allclose(compare([a], [b], on), 0, atol=1e-6)
    bent = GestureClassifier(off).signals([pose(swing("left_wrist", size=60))])[0]
    mirrored_pair = GestureClassifier(off).signals([pose(swing("right_wrist", size=60))])[0]
    reached = compare([a], [mirrored_pair], off)[0, 0]
    np.testing.assert_allclose(compare([a], [bent], on)[0, 0], 1.5 * reached, rtol=1e-4)


def test_a_distance_on_half_of_the_channels_counts_double() -> None:
    whole = Signals(np.zeros((4, 2)), np.arange(4), ("right_wrist_x", "left_wrist_x"))
    half = Signals(np.ones((4, 2)), np.arange(4), whole.channels, present=np.array([True, False]))
    assert common_share(Extents.of([whole]), Extents.of([half])).tolist() == [[0.5]]
    plain = {"mirror": None, "relative": None}
    on, off = with_classify(coverage=True, **plain), with_classify(coverage=False, **plain)
    assert compare([whole], [half], on)[0, 0] == 2 * compare([whole], [half], off)[0, 0]
    other = replace(whole, present=np.array([False, True]))
    assert compare([other], [half], on)[0, 0] == np.inf


def test_a_person_who_stands_still_is_no_gesture_unless_an_example_stands_still_too() -> None:
    poses, labels = data()
    queries = [
        pose(swing(size=0.0, frames=n) + np.random.default_rng(n).normal(0, 0.5, (n, 18, 2)))
        for n in (30, 41)
    ]
    moving = GestureClassifier("modern").fit(poses, labels)
    (row,) = moving.predictions(queries[:1])
    assert (row.label, row.status, row.code) == (None, "rejected", "E_NO_SALIENT")
    assert moving.predict([poses[0], queries[0]]).tolist() == ["up", "(none)"]
    both = GestureClassifier("modern").fit([*poses, queries[0]], [*labels, "waiting"])
    assert both.predictions(queries[1:])[0].label == "waiting"
    truth = data(1, seed=9)
    assert both.predict(truth[0]).tolist() == truth[1]


def test_what_is_rejected_has_the_label_that_metrics_need() -> None:
    poses, labels = data()
    still = pose(swing(size=0.0, frames=30) + np.random.default_rng(0).normal(0, 0.5, (30, 18, 2)))
    model = GestureClassifier("modern").fit(poses, labels)
    assert model.predict([still, poses[8]]).tolist() == ["(none)", "side"]
    scores = cross_val_score(model, [*poses, still], [*labels, "side"], cv=3, scoring="accuracy")
    assert np.isfinite(scores).all() and scores.mean() < 1


def test_a_fitted_classifier_does_not_change_with_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    poses, labels = data()
    model = GestureClassifier("modern").fit(poses, labels)
    before = model.distances(poses)
    monkeypatch.setenv("GESTURE_SET_CLASSIFY__MIRROR", "none")
    monkeypatch.setenv("GESTURE_SET_RESAMPLE__RATE", "10")
    np.testing.assert_array_equal(model.distances(poses), before)
    assert model.settings_.classify.mirror is not None
    assert model.fit(poses, labels).settings_.classify.mirror is None


@pytest.mark.parametrize("change", [("dtw.cost", "absolute"), ("dtw.root", True)])
def test_sizes_of_squares_divide_no_other_costs(change: tuple[str, object]) -> None:
    poses, labels = data()
    settings = load_settings("modern", environment={}).with_values([change])
    with pytest.raises(ConfigError, match="relative=none"):
        GestureClassifier(settings).fit(poses, labels)
    plain = settings.with_values([("classify.relative", None), ("classify.reject", None)])
    assert GestureClassifier(plain).fit(poses, labels).predict(poses).tolist() == labels


def test_a_label_for_the_rejected_keeps_the_type_of_the_others() -> None:
    examples, far = [np.zeros((3, 1)), np.ones((3, 1))], np.full((3, 1), 9.0)
    cases: tuple[tuple[list[object], object, object], ...] = (
        ([0, 1], None, -1), ([0, 1], 7, 7), ([0.5, 1.5], None, -1.0), ([False, True], None, -1),
        (["a", "b"], None, "(none)"), (["a", "b"], "none at all", "none at all"),
        ([-1, 1], None, -2), ([np.int8(-1), np.int8(1)], None, -2), ([-1.0, 1.0], None, -2.0),
        ([np.uint8(0), np.uint8(255)], None, -1), ([b"a", b"b"], None, b"(none)"),
    )  # fmt: skip
    for labels, given, instead in cases:
        model = GestureClassifier("paper", "numpy", reject=0.5, rejected_label=given).fit(examples, labels)
        found = model.predict([far, examples[1]])
        assert found.tolist() == [instead, labels[1]] and model.rejected_label_ == instead
        assert found.dtype.kind in {np.array(labels).dtype.kind, "i"}  # -1 beside truth values, or unsigned
    wrong: tuple[tuple[list[object], object], ...] = (
        ([0, 1], (1, 2)), ([0, 1], "x"), ([0, 1], 1), ([-1, 1], -1), (["a", "b"], 3),
    )  # fmt: skip
    for labels, given in wrong:
        with pytest.raises(ConfigError, match="E_LABELS"):
            GestureClassifier("paper", "numpy", rejected_label=given).fit(examples, labels)


@pytest.mark.parametrize("neighbors", [0, 1, 3])
def test_scores_and_probabilities_agree_with_the_labels(neighbors: int) -> None:
    poses, labels = data(4)
    queries, truth = data(2, seed=5)
    model = GestureClassifier("modern", "numpy", n_neighbors=neighbors).fit(poses, labels)
    scores, shares = model.decision_function(queries), model.predict_proba(queries)
    assert scores.shape == shares.shape == (6, 3)
    np.testing.assert_allclose(shares.sum(axis=1), 1)
    found = model.predict(queries).tolist()
    assert model.classes_[scores.argmax(axis=1)].tolist() == found == truth
    assert model.classes_[shares.argmax(axis=1)].tolist() == found
    assert (shares.max(axis=1) < 1).all(), "few examples make no certainty"
    two = GestureClassifier("modern", "numpy", n_neighbors=neighbors).fit(poses[:8], labels[:8])
    assert two.decision_function(queries).shape == (6,)
    assert ((two.decision_function(poses[:8]) > 0) == (np.array(labels[:8]) == two.classes_[1])).all()
    assert roc_auc_score(np.array(labels[:8]) == "up", two.predict_proba(poses[:8])[:, 1]) == 1


def test_probabilities_are_those_of_examples_that_are_left_out() -> None:
    random = np.random.default_rng(0)
    codes = np.repeat([0, 1], 60)
    places = codes + random.normal(0, 0.8, 120)
    arrays = [np.full((3, 1), place) for place in places]
    model = GestureClassifier("paper", "numpy", n_neighbors=1).fit(arrays, codes.tolist())
    asked = np.repeat([0, 1], 300) + random.normal(0, 0.8, 600)
    truth = np.repeat([0, 1], 300)
    shares = model.predict_proba([np.full((3, 1), place) for place in asked])
    right = shares.argmax(axis=1) == truth
    assert abs(shares.max(axis=1).mean() - right.mean()) < 0.08
    with pytest.raises(InputError, match="no class has two examples"):
        GestureClassifier("paper", "numpy").fit(arrays[:1] + arrays[-1:], [0, 1]).predict_proba(arrays[:1])


def test_settings_are_parameters() -> None:
    poses, labels = data()
    model = GestureClassifier("modern", "numpy")
    assert model.get_params()["classify__sharpness"] == load_settings("modern").classify.sharpness
    assert set(model.get_params(deep=False)) == {
        "preset", "kernel", "n_neighbors", "reject", "rejected_label", "settings",
    }  # fmt: skip
    model.set_params(classify__mirror=1.7, gaussian__seconds=0.05, n_neighbors=1)
    twin = clone(model).fit(poses, labels)
    assert twin.settings_.classify.mirror == model.get_params()["classify__mirror"] == 1.7
    assert twin.settings_.options["gaussian"]["seconds"] == 0.05 and twin.n_neighbors_ == 1
    with pytest.raises(ConfigError, match=r"did you mean classify\.mirror"):
        model.set_params(classify__miror=1.7)
    search = GridSearchCV(GestureClassifier("modern", "numpy"), {"classify__mirror": [1.1, None]}, cv=3)
    assert set(search.fit(poses, labels).cv_results_["param_classify__mirror"].tolist()) == {1.1, None}


@pytest.mark.parametrize("kind", ["poses", "arrays"])
def test_a_classifier_is_saved_and_loaded_without_pickle(kind: str, tmp_path: Path) -> None:
    poses, labels = data()
    queries, answers = data(1, seed=5)[0], np.array([{"up": 3, "twice": 1, "side": 2}[x] for x in labels])
    model = GestureClassifier("modern", "numpy", reject="calibrated", settings={"classify.mirror": 1.4})
    if kind == "arrays":
        poses, queries = ([np.nan_to_num(p.keypoints[:, 4]) for p in some] for some in (poses, queries))
    model.fit(poses, list(answers) if kind == "arrays" else labels)
    model.save(tmp_path / "model")
    twin = GestureClassifier.load(tmp_path / "model")
    assert twin.predict(queries).tolist() == model.predict(queries).tolist()
    assert twin.predict(queries).dtype == model.predict(queries).dtype
    assert twin.get_params() == model.get_params()
    np.testing.assert_array_equal(twin.predict_proba(queries), model.predict_proba(queries))
    assert twin.predictions(queries) == model.predictions(queries)
    assert b"pickle" not in (tmp_path / "model").read_bytes()
    for wrong in (b"", b"PK\x03\x04", (tmp_path / "model").read_bytes()[:-900]):
        (tmp_path / "other").write_bytes(wrong)
        with pytest.raises(InputError, match="E_INPUT"):
            GestureClassifier.load(tmp_path / "other")
    with pytest.raises(InputError, match="E_NOT_FOUND"):
        GestureClassifier.load(tmp_path / "absent")


@pytest.mark.parametrize(
    "parameters",
    [
        {"reject": np.float32(0.5)},
        {"n_neighbors": np.int64(1), "rejected_label": np.int64(9)},
        {"settings": {"classify.mirror": np.float32(1.5), "signals.repair": np.bool_(True)}},
    ],
)
def test_parameters_of_numpy_are_saved(parameters: dict[str, object], tmp_path: Path) -> None:
    arrays = [np.zeros((3, 1)), np.ones((3, 1))]
    model = GestureClassifier("paper", "numpy", **parameters).fit(arrays, [1, 2])  # type: ignore[arg-type]
    model.save(tmp_path / "model")
    twin = GestureClassifier.load(tmp_path / "model")
    assert twin.get_params() == model.get_params()
    assert twin.predict(arrays).tolist() == model.predict(arrays).tolist()


def test_labels_of_bytes_are_saved(tmp_path: Path) -> None:
    arrays = [np.zeros((3, 1)), np.ones((3, 1)), np.full((3, 1), 9.0)]
    model = GestureClassifier("paper", "numpy", reject=0.5, rejected_label=b"?").fit(
        arrays[:2], [b"a", b"bc"]
    )
    model.save(tmp_path / "model")
    twin = GestureClassifier.load(tmp_path / "model")
    assert twin.predict(arrays).tolist() == [b"a", b"bc", b"?"]
    assert twin.rejected_label == b"?" and twin.classes_.tolist() == [b"a", b"bc"]
    assert [p.label for p in twin.predictions(arrays)] == [p.label for p in model.predictions(arrays)]


def test_it_works_in_a_pipeline_and_survives_pickling() -> None:
    poses, labels = data()
    line = Pipeline([("gesture", GestureClassifier("paper"))]).set_params(gesture__n_neighbors=2)
    twin = pickle.loads(pickle.dumps(line.fit(poses, labels)))
    assert twin.predict(poses).tolist() == line.predict(poses).tolist() == labels
    assert twin["gesture"].settings_.classify.neighbors == 2
    with pytest.raises(NotFittedError):
        check_is_fitted(clone(line["gesture"]))


def test_another_number_of_neighbours_waits_for_the_next_fit() -> None:
    poses, labels = data()
    model = GestureClassifier("paper", n_neighbors=0).fit(poses, labels)
    before = model.predictions(poses)
    assert model.set_params(n_neighbors=3).predictions(poses) == before
    assert model.fit(poses, labels).weights_ is None


def test_examples_are_taken_in_their_order_and_not_by_an_index() -> None:
    class Shuffled(list[np.ndarray]):  # as a Series, whose item 0 is what has that index
        def __getitem__(self, index: object) -> np.ndarray:  # type: ignore[override]
            raise KeyError(index)

    series = Shuffled([np.linspace(0, end, 9)[:, None] for end in (1, -1)])
    classifier = GestureClassifier(kernel="numpy", n_neighbors=1).fit(series, ["up", "down"])
    assert classifier.predict(series).tolist() == ["up", "down"]
