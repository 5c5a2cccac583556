"""The recurrent classifier: its contract, and that it learns the same every time and tells new movements."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("torch")

import torch
from gesture_dtw_torch.recurrent import Recurrent

from gesture_core import GestureClassifier
from gesture_core.errors import InputError
from gesture_core.plugin import registry
from gesture_core.plugin.abilities import LeavesOut
from gesture_core.plugin.interfaces import Classifier
from gesture_core.signals.mirror import mirrored
from gesture_core.testing import CLASSIFIER_CHECKS, draw_pose
from gesture_core.types import Signals

SMALL = {"hidden": 8, "frames": 8}
"""Options of a network that learns in a moment."""


def movements(seed: int, each: int = 8) -> tuple[list[Signals], np.ndarray]:
    """The right wrist goes up and comes down again, once or twice; the left one is at rest."""
    random = np.random.default_rng(seed)
    codes = np.repeat([0, 1], each)
    series = []
    for code in codes:
        frames = int(random.integers(20, 40))
        times = np.linspace(0, 1, frames)
        up = np.sin(np.pi * (1 + code) * times) ** 2
        values = np.stack([np.zeros(frames), np.zeros(frames), up, up], axis=1)
        values += random.normal(0, 0.05, values.shape)
        names = ("left_wrist_x", "left_wrist_y", "right_wrist_x", "right_wrist_y")
        series.append(Signals(values.astype(np.float32), times, names))
    return series, codes


@pytest.mark.parametrize("check", CLASSIFIER_CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_the_contract(check: Callable[[Classifier], None]) -> None:
    check(Recurrent(**SMALL))


def test_it_is_found_by_its_name_and_takes_the_setting_of_mirrors() -> None:
    assert registry().load("classifier", "recurrent") is Recurrent
    assert registry().takes("classifier", "recurrent", "mirror")
    assert isinstance(Recurrent(), LeavesOut)


def test_new_movements_and_those_of_the_other_hand() -> None:
    (series, codes), (new, truth) = movements(0), movements(1)
    classifier = Recurrent(1.2, **SMALL)
    state = classifier.fit(series, codes, 2, None, np.arange(16))
    scores = classifier.scores(state, new, np.empty((16, 0)))
    assert (scores.argmax(axis=1) == truth).all()
    np.testing.assert_allclose(scores.sum(axis=1), 1)
    other = classifier.scores(state, [mirrored(item) for item in new], np.empty((16, 0)))
    np.testing.assert_allclose(other, scores, atol=1e-6)
    assert classifier.scores(state, [], np.empty((0, 0))).shape == (0, 2)


def test_a_seed_says_all_and_nobody_else_notices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "manual_seed_all", lambda seed: pytest.fail("seeds devices"))
    series, codes = movements(0)
    threads = torch.get_num_threads()
    torch.default_generator.manual_seed(7)
    wanted = torch.rand(1)
    torch.default_generator.manual_seed(7)
    first, again, other = (
        Recurrent(seed=seed, hidden=2, frames=3).fit(series, codes, 2, None, np.arange(16))
        for seed in (0, 0, 1)
    )
    assert torch.rand(1) == wanted and torch.get_num_threads() == threads
    for name, array in first.items():
        np.testing.assert_array_equal(array, again[name])
    assert not np.array_equal(first["decide.weight"], other["decide.weight"])


def test_no_unit_matters() -> None:
    series, codes = movements(0)
    small = [Signals(1e-3 * item.values, item.times, item.channels) for item in series]
    said = []
    for some in (series, small):
        state = Recurrent(hidden=2, frames=3).fit(some, codes, 2, None, np.arange(16))
        said.append(Recurrent(hidden=2, frames=3).scores(state, some, np.empty((16, 0))))
    np.testing.assert_allclose(said[0], said[1], atol=1e-3)


def test_what_is_left_out_was_not_seen() -> None:
    series, codes = movements(0, 10)
    classifier = Recurrent(**SMALL)
    wrong = codes.copy()
    wrong[3] = 1
    scores = classifier.left_out(series, wrong, 2, np.empty((0, 0)))
    assert scores.shape == (20, 2)
    assert scores[3].argmax() == 0, "an example with the label of another class is known by the others"
    right = scores.argmax(axis=1) == codes
    assert right.mean() > 0.9


def test_few_examples_are_refused_with_a_remedy() -> None:
    poses = [draw_pose(seed, frames=12) for seed in range(4)]
    model = GestureClassifier("modern", settings={"classify.classifier": "recurrent"})
    with pytest.raises(InputError, match="needs 8 examples of each class, and one has 2") as caught:
        model.fit(poses, ["a", "a", "b", "b"])
    assert "classify.classifier=auto" in str(caught.value)


@pytest.mark.parametrize("options", [{"hidden": 0}, {"epochs": 0}, {"frames": 0}])
def test_impossible_options(options: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="1 at least"):
        Recurrent(**options)
