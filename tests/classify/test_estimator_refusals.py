"""What the estimator refuses or warns of: parameters, arrays, labels and queries that cannot be meant."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError
from swings import data, pose, swing

from gesture_core import GestureClassifier, warping_distances
from gesture_core.errors import ConfigError, InputError, PluginError, PoseError
from gesture_core.settings import load_settings


def test_unknown_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="Invalid parameter 'neighbours'"):
        GestureClassifier().set_params(neighbours=3)
    with pytest.raises(ConfigError):
        GestureClassifier(reject="sometimes").fit(*data(2))


def test_a_bad_query_gets_its_own_row_and_predict_names_it() -> None:
    poses, labels = data()
    still = pose(swing("right_wrist", 1, 0.0, 30, 0))
    model = GestureClassifier("paper").fit(poses, labels)
    rows = model.predictions([poses[0], still, poses[4]])
    assert [row.label for row in rows] == ["up", None, "twice"]
    assert (rows[1].status, rows[1].code) == ("error", "E_NO_SALIENT")
    with pytest.raises(Exception, match="E_NO_SALIENT"):
        model.predict([still])


def test_before_fit_and_with_uneven_lists() -> None:
    with pytest.raises(InputError, match="fit"):
        GestureClassifier().predict([np.zeros((3, 1))])
    with pytest.raises(InputError, match="E_EXAMPLES"):
        GestureClassifier("paper").fit([np.zeros((3, 1))], [])


def test_bare_arrays_and_signals_do_not_mix() -> None:
    poses, labels = data()
    model = GestureClassifier("modern").fit(poses, labels)
    signals = model.signals(poses)
    array = signals[0].values  # type: ignore[union-attr]
    with pytest.raises(InputError, match="E_MIXED"):
        model.distances([signals[0], array])
    assert [row.code for row in model.predictions([array, signals[0]])] == ["E_MIXED", ""]
    with pytest.raises(InputError, match="E_MIXED"):
        GestureClassifier("modern").fit([signals[0], array], ["a", "b"])
    other = GestureClassifier("paper").fit(poses, labels).signals(poses)
    assert [row.code for row in model.predictions([other[0], signals[0]])] == ["E_DIMENSIONS", ""]


def test_bad_arrays_are_refused_where_they_are_given() -> None:
    good, hole, wide = np.zeros((5, 2)), np.array([[0.0, np.nan]] * 5), np.zeros((5, 3))
    model = GestureClassifier(kernel="numpy").fit([good, good + 1], ["a", "b"])
    assert [row.code for row in model.predictions([good, hole, wide])] == ["", "E_NOT_FINITE", "E_DIMENSIONS"]
    assert model.predict([]).tolist() == [] and model.predictions([]) == []
    for bad in (hole, wide):
        with pytest.raises(InputError):
            GestureClassifier(kernel="numpy").fit([good, bad], ["a", "b"])
    with pytest.raises(PluginError, match="numba"):
        GestureClassifier(kernel="nmuba").fit([good], ["a"])
    poses, labels = data()
    assert GestureClassifier("modern").fit(poses, labels).predict([]).tolist() == []


@pytest.mark.parametrize("wanted", [-1, 10_000])
def test_a_number_of_neighbours_that_cannot_be_is_refused_at_fit(wanted: int) -> None:
    poses, labels = data()
    with pytest.raises(ConfigError, match="E_NEIGHBORS"):
        GestureClassifier("paper", n_neighbors=wanted).fit(poses, labels)


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"n_neighbors": 1.5}, "E_NEIGHBORS"),
        ({"n_neighbors": "3"}, "E_NEIGHBORS"),
        ({"reject": float("nan")}, "E_REJECT"),
        ({"reject": True}, "E_REJECT"),
        ({"reject": [1.0]}, "E_REJECT"),
        ({"kernel": None}, "E_PLUGIN_UNKNOWN"),
    ],
)
def test_parameters_of_the_wrong_type_are_refused_at_fit(wrong: dict[str, object], code: str) -> None:
    model = GestureClassifier("paper", "numpy").set_params(**wrong)
    with pytest.raises((ConfigError, PluginError), match=code):
        model.fit([np.zeros((3, 1)), np.ones((3, 1))], ["a", "b"])


@pytest.mark.parametrize(
    "labels",
    [[1, "a"], ["a", None], [None, None], [1.0, float("nan")], ["a", b"a"], [("a", "b"), ("c", "d")],
     ["a", float("nan")], [["a"], ["b", "c"]], np.array([["a"], ["b"]])],
)  # fmt: skip
def test_labels_that_numpy_would_turn_into_others_are_refused(labels: list[object]) -> None:
    with pytest.raises(InputError, match="E_LABELS"):
        GestureClassifier("paper", "numpy").fit([np.zeros((3, 1)), np.ones((3, 1))], labels)


def test_equal_examples_with_different_labels_are_warned_of() -> None:
    one, other = np.arange(4), np.arange(4.0)[:, None]  # equal, though of another type and shape
    with pytest.warns(UserWarning, match=r"'0' \('a'\) and '2' \('b'\) are equal") as caught:
        GestureClassifier("paper", "numpy").fit([one, one + 1, other, one], ["a", "b", "b", "a"])
    assert len(caught) == 1 and caught[0].filename == __file__
    poses, labels = data()
    with pytest.warns(UserWarning, match=r"\(and 1 more\)"):
        GestureClassifier("paper").fit([*poses, poses[0], poses[1]], [*labels, "x", "y"])


def test_a_fit_that_fails_leaves_the_classifier_as_it_was() -> None:
    poses, labels = data()
    model = GestureClassifier("paper").fit(poses, labels)
    before = model.predictions(poses)
    with pytest.raises(InputError, match="E_LABELS"):
        model.set_params(preset="modern").fit(poses, [None] * len(poses))
    assert model.predictions(poses) == before


def test_a_query_that_cannot_be_compared_gets_its_own_row_with_its_own_number() -> None:
    settings = load_settings("paper", ["dtw.shape=itakura"], environment={})
    examples = [np.zeros((9, 1)), np.ones((9, 1))]
    model = GestureClassifier(settings, "numpy").fit(examples, ["a", "b"])
    bad = [np.full((9, 1), 1e200), np.zeros((9, 2)), np.full((9, 1), np.nan), np.zeros((90, 1))]
    rows = model.predictions([examples[0], *bad, examples[1]])
    assert [row.label for row in rows] == ["a", None, None, None, None, "b"]
    assert [row.code for row in rows[1:5]] == [
        "E_MAGNITUDE", "E_DIMENSIONS", "E_NOT_FINITE", "E_BAND_INFEASIBLE"
    ]  # fmt: skip
    assert "query 1 reaches" in rows[1].message
    assert "query 3 holds NaN" in rows[3].message
    assert "query 4 (90 frames)" in rows[4].message


def test_paths_and_tensors_get_a_sentence() -> None:
    import jax
    import jax.numpy as jnp
    import torch

    arrays = [np.zeros((3, 1)), np.ones((3, 1))]
    model = GestureClassifier("paper", "numpy").fit(arrays, ["a", "b"])
    for paths in (["clip.avi"], [Path("clip.avi")], "clips/", Path("clips")):
        with pytest.raises(InputError, match="load_poses"):
            model.predict(paths)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="load_poses"):
        GestureClassifier("paper").fit(["clip.avi"], ["a"])  # type: ignore[list-item]
    with pytest.raises(InputError, match=r"requires grad.*try: tensor.detach"):
        model.predict([torch.ones((3, 1), requires_grad=True)])  # type: ignore[list-item]
    with pytest.raises(InputError, match="outside of jit"):
        jax.jit(lambda x: model.predict([x]))(jnp.ones((3, 1)))
    for one in (np.zeros((60, 3)), torch.zeros(60, 3), jnp.zeros((60, 3))):
        with pytest.raises(InputError, match=r"one array of shape \(60, 3\)"):
            warping_distances(one, one, kernel="numpy")  # type: ignore[arg-type]


def test_keypoints_without_a_source_are_named_by_their_number() -> None:
    poses, labels = data()
    short = pose(swing(frames=2))
    with pytest.raises(PoseError, match="example 1: is only 2 frames long"):
        GestureClassifier("paper").fit([poses[0], short], ["a", "b"])
    model = GestureClassifier("paper").fit(poses, labels)
    assert model.predictions([*poses, short])[-1].message.startswith("query 9: is only 2 frames long")
    named = replace(short, source="clip")
    assert model.predictions([named])[0].message.startswith("clip: is only")


def test_one_sequence_is_not_a_list_of_them() -> None:
    poses, labels = data()
    with pytest.raises(InputError, match="one PoseSequence instead of a sequence"):
        GestureClassifier("paper").fit(poses, labels).predict(poses[0])


def test_columns_and_axes_in_another_order_are_no_silent_matter() -> None:
    class Frame:  # as far as one of pandas or polars is looked at
        columns = ("x", "y", "z")

    series = [np.outer(np.linspace(0, 1, 9), (1.0, k, -k)) for k in range(4)]
    classifier = GestureClassifier(kernel="numpy").fit(series, [0, 1] * 2)
    with pytest.raises(InputError, match=r"sequence 0: is a data frame.*preset='sensors'"):
        classifier.predict([Frame()])  # type: ignore[list-item]
    with pytest.warns(UserWarning, match=r"3 samples of 9 channels.*X\.transpose\(0, 2, 1\)") as caught:
        GestureClassifier(kernel="numpy").fit([item.T for item in series], [0, 1] * 2)
    assert len(caught) == 1 and caught[0].filename == __file__


def test_postures_are_no_turned_series() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        GestureClassifier(kernel="numpy").fit([np.eye(3)[[k]] for k in (0, 1)], ["up", "down"])


def test_what_has_no_order_or_no_elements_is_named() -> None:
    class Frame:
        columns = ("label",)

        def __iter__(self) -> Iterator[str]:
            return iter(self.columns)

    poses, labels = data()
    model = GestureClassifier("paper").fit(iter(poses), (label for label in labels))  # type: ignore[arg-type]
    assert model.predict(iter(poses)).tolist() == labels  # type: ignore[arg-type]
    for X in (None, 3, {"a": poses[0]}, set(labels), np.array(3.0)):
        kind = type(X).__name__
        for use in (model.predict, model.predictions, lambda X: GestureClassifier("paper").fit(X, labels)):
            with pytest.raises(InputError, match=f"X is a {kind}, and no sequence; try: a list of keypoints"):
                use(X)  # type: ignore[arg-type]
    for y in (None, 3, "abcabcabc", set(labels), Frame()):
        with pytest.raises(InputError, match=f"y is a {type(y).__name__}, and no sequence; try: a list with"):
            GestureClassifier("paper").fit(poses, y)  # type: ignore[arg-type]
    for one in (None, 3, "a", poses[0]):
        with pytest.raises(InputError, match=f"queries are a {type(one).__name__}, expected a sequence"):
            warping_distances(one, [np.zeros(3)], kernel="numpy")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"query 0 is a PoseSequence, expected \(T,\) or"):
        warping_distances(poses, poses, kernel="numpy")


def test_a_value_that_pandas_calls_missing_is_a_missing_label() -> None:
    missing = type("NAType", (), {})()
    with pytest.raises(InputError, match="label 1 is missing"):
        GestureClassifier("paper").fit(data()[0][:2], ["a", missing])


def test_a_classifier_without_examples_is_one_that_is_not_fitted(tmp_path: Path) -> None:
    for use in ("predict", "predict_proba", "decision_function", "kneighbors"):
        with pytest.raises(NotFittedError, match=r"no examples yet; try: fit\(X, y\) first"):
            getattr(GestureClassifier(), use)(data()[0])
    with pytest.raises(InputError, match="cannot be written: Is a directory; try: another path"):
        GestureClassifier("paper").fit(*data()).save(tmp_path)
