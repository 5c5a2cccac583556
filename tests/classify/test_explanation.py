"""Explanations add up to the distance that was decided on, for every kind of warping."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from swings import pose, swing

from gesture_core import GestureClassifier
from gesture_core.classify.explanation import channel_costs, contrast, explain
from gesture_core.dtw.reference import reference_distance
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import InputError
from gesture_core.report.channel_names import ChannelNames
from gesture_core.report.explanation import explanation_plot
from gesture_core.settings import load_settings
from gesture_core.types import PoseSequence, Signals

CHANNELS = ("right_wrist_x", "left_wrist_x", "nose_x")


def signals_of(model: GestureClassifier, query: PoseSequence) -> Signals:
    (found,) = model.signals([query])
    assert isinstance(found, Signals)
    return found


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["independent", "dependent"]),
    st.sampled_from(["absolute", "squared", "euclidean"]),
    st.sampled_from(["sum", "mean"]),
    st.booleans(),
    st.sampled_from([None, (1.0, 0.5, 2.0)]),
)
@settings(max_examples=80, deadline=None)
def test_costs_of_the_channels_add_up(
    seed: int, mode: str, cost: str, reduce: str, norm: bool, weights: tuple[float, ...] | None
) -> None:
    random = np.random.default_rng(seed)
    spec = DtwSpec(mode, cost, reduce=reduce, length_norm=norm, root=norm, weights=weights)  # type: ignore[arg-type]
    n, m = random.integers(1, 12, 2)
    masks = random.random((4, 3)) < 0.7
    x = Signals(random.normal(size=(n, 3)), np.arange(n), CHANNELS, masks[0], masks[1])
    y = Signals(random.normal(size=(m, 3)), np.arange(m), CHANNELS, masks[2], masks[3])
    paper = load_settings("paper", environment={})
    costs, used, paths, places = channel_costs(x, y, replace(paper, dtw=spec))
    np.testing.assert_array_equal(used, (masks[0] | masks[2]) & masks[1] & masks[3])
    assert not costs[~used].any()
    assert ((places >= 0) == used).all()
    if used.any():
        expected = reference_distance(x.values, y.values, spec, used)
        assert costs.sum() == pytest.approx(expected, rel=1e-9)
        assert len(paths) == (1 if mode == "dependent" else used.sum())
        for path in paths:
            assert path[0].tolist() == [0, 0]
            assert path[-1].tolist() == [n - 1, m - 1]
            assert {tuple(step) for step in np.diff(path, axis=0)} <= {(0, 1), (1, 0), (1, 1)}


@pytest.mark.parametrize("preset", ["paper", "modern"])
def test_a_decision_is_explained_by_the_distances_that_made_it(preset: str, tmp_path: Path) -> None:
    examples = [pose(swing("left_wrist", 1)), pose(swing("left_wrist", 0)), pose(swing("right_knee", 1))]
    model = GestureClassifier(preset).fit(examples, ["up", "side", "knee"], ["one", "two", "three"])
    query = signals_of(model, pose(swing("right_wrist" if preset == "modern" else "left_wrist", 1, 1.1)))
    row = model.distances([query])[0]
    found = explain(query, model.library_, row, model.settings_, model._recognizer.fitted)
    assert (found.nearest.label, found.nearest.example) == ("up", "one")
    assert found.nearest.mirrored == (preset == "modern")
    assert found.nearest.distance == pytest.approx(row.min(), rel=1e-3)
    assert found.runner_up is not None
    assert found.runner_up.distance == pytest.approx(np.sort(row)[1], rel=1e-3)
    gain = found.runner_up.costs - found.nearest.costs
    order = contrast(found)
    assert abs(gain[order[0]]) == np.abs(gain).max()
    path = explanation_plot(found, "a title", tmp_path / "plot.png", ChannelNames(model.settings_))
    _check_picture(path)


def test_what_several_neighbours_voted_for_is_explained_and_not_the_nearest_example() -> None:
    settings = load_settings("paper", ["neighbors=3"], environment={})
    sizes = {"one": 93, "two": 100, "three": 101}
    poses = [pose(swing(size=size)) for size in sizes.values()]
    model = GestureClassifier(settings).fit(poses, ["near", "many", "many"], list(sizes))
    query = signals_of(model, pose(swing(size=94)))
    (answer,) = model.predictions([query])
    found = explain(query, model.library_, model.distances([query])[0], settings, model._recognizer.fitted)
    assert found.runner_up is not None
    assert (found.nearest.label, found.nearest.example) == (answer.label, "two") == ("many", "two")
    assert (found.runner_up.label, found.runner_up.example) == ("near", "one")
    assert found.runner_up.distance - found.nearest.distance == pytest.approx(answer.margin, rel=1e-3)


def test_one_class_has_no_runner_up_and_still_a_plot(tmp_path: Path) -> None:
    model = GestureClassifier("paper").fit([pose(swing())], ["up"])
    query = signals_of(model, pose(swing(size=80)))
    found = explain(
        query, model.library_, model.distances([query])[0], model.settings_, model._recognizer.fitted
    )
    assert found.runner_up is None
    _check_picture(explanation_plot(found, "one class", tmp_path / "one.png", ChannelNames(model.settings_)))


def test_nothing_in_common_cannot_be_explained() -> None:
    model = GestureClassifier("paper").fit([pose(swing())], ["up"])
    query = signals_of(model, pose(swing()))
    with pytest.raises(InputError, match="E_NO_COMMON"):
        explain(
            query,
            model.library_,
            np.array([np.nan]),
            load_settings("paper", environment={}),
            model._recognizer.fitted,
        )


def _check_picture(path: Path) -> None:
    """A picture with something on it."""
    import cv2

    picture = np.asarray(cv2.imread(str(path)))
    assert picture.shape[0] > 300
    assert picture.shape[1] > 800
    assert 0.02 < (picture < 200).any(axis=2).mean() < 0.6
