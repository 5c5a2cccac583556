"""Random convolutions: against plain loops, scikit-learn's ridge and fits without each example; the blend."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from sklearn.linear_model import Ridge
from swings import pose, swing

from gesture_core import GestureClassifier
from gesture_core.classify.classifiers import Weighed
from gesture_core.classify.explanation import explain
from gesture_core.classify.rocket import Blend, Rocket, dilations, ridge, standardised, usual_deviation
from gesture_core.settings import load_settings
from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals

SETTINGS = {"neighbors": 0, "reject": None}


def series(seed: int, count: int, channels: int = 2) -> list[np.ndarray]:
    random = np.random.default_rng(seed)
    return [random.normal(size=(int(random.integers(20, 40)), channels)).cumsum(axis=0) for _ in range(count)]


@pytest.mark.parametrize(("frames", "each"), [(9, 10), (16, 10), (64, 10), (64, 59), (500, 119)])
def test_dilations_grow_and_their_levels_add_up(frames: int, each: int) -> None:
    found = dilations(frames, each)
    steps = [step for step, _ in found]
    assert steps[0] == 1 and steps == sorted(set(steps))
    assert 8 * steps[-1] <= max(frames - 1, 8)
    assert sum(count for _, count in found) == each and all(count > 0 for _, count in found)


def test_shares_are_those_of_plain_loops() -> None:
    examples, rocket = series(0, 4), Rocket(features=168, frames=30)
    state = rocket.fit(examples, np.array([0, 0, 1, 1]), 2, None, np.arange(4))
    sequence = standardised(examples, state["usual"], 30)[2]
    found = rocket._shares(sequence[None], state)[0].tolist()
    steps = [int(name.partition(".")[2]) for name in state if name.startswith("levels.")]
    for number, step in enumerate(steps):
        kernels, levels = kernels_of(state[f"channels.{step}"], 2), state[f"levels.{step}"]
        for inside in (0, 1):
            for index in range((inside + number) % 2, 84, 2):
                values = []
                for moment in range(30):
                    places = [moment + step * (place - 4) for place in range(9)]
                    if inside and 8 * step < 30 and not (places[0] >= 0 and places[-1] < 30):
                        continue
                    values.append(
                        sum(
                            kernels[index, channel, place] * sequence[channel, at]
                            for channel in range(len(sequence))
                            for place, at in enumerate(places)
                            if 0 <= at < 30
                        )
                    )
                for level in levels[index]:
                    assert found.pop(0) == pytest.approx(
                        np.mean(np.array(values) > level), abs=1.01 / len(values)
                    )
    assert found == []


def kernels_of(seen: np.ndarray, channels: int) -> np.ndarray:
    """(84, D, 9) weights: three of 2 and six of -1 on the channels that a kernel looks at."""
    kernels = np.zeros((84, channels, 9))
    for index, three in enumerate(combinations(range(9), 3)):
        for channel in seen[index][seen[index] >= 0].tolist():
            kernels[index, channel] = [2 if place in three else -1 for place in range(9)]
    return kernels


def test_levels_lie_inside_and_no_bit_depends_on_the_batch() -> None:
    examples = series(1, 35)
    state = Rocket().fit(examples, np.repeat([0, 1], [17, 18]), 2, None, np.arange(35))
    for name, seen in state.items():
        if name.startswith("channels."):
            assert all(len(set(row)) == len(row) > 0 for row in (one[one >= 0].tolist() for one in seen))
    every = standardised(examples, state["usual"], 64)
    shares = Rocket()._shares(every, state)
    assert shares.shape == (35, 840) and shares.min() >= 0 and shares.max() <= 1
    assert 0.4 < shares.mean() < 0.6  # levels are quantiles
    alone = [Rocket()._shares(every[index : index + 1], state)[0] for index in range(35)]
    np.testing.assert_array_equal(shares, alone)
    np.testing.assert_array_equal(shares[5:], Rocket()._shares(every[5:], state))
    assert Rocket().scores(state, [], np.empty((0, 35))).shape == (0, 2)


def test_no_unit_and_no_offset_matters() -> None:
    examples = series(2, 5)
    plain = standardised(examples, usual_deviation(examples, 64), 64)
    other = [1e-6 * item + 1e-3 for item in examples]
    np.testing.assert_allclose(plain, standardised(other, usual_deviation(other, 64), 64), atol=1e-5)
    assert np.abs(plain).max() > 1
    still = [np.zeros((10, 2))] * 3
    assert not standardised(still, usual_deviation(still, 64), 64).any()


@pytest.mark.parametrize(
    ("forms", "sizes"), [(1, (5, 5, 5)), (2, (5, 5, 5)), (2, (1, 4, 10)), (3, (15, 15, 15))]
)
def test_the_ridge_is_that_of_scikit_learn_and_leaves_out_exactly(forms: int, sizes: tuple[int, ...]) -> None:
    random = np.random.default_rng(0)
    codes = np.repeat([0, 1, 2], sizes)
    count = len(codes)
    shares = [random.uniform(size=(count, 40)) + codes[:, None] * 0.1 for _ in range(forms)]
    learned, without = ridge(shares, codes, 3)
    every = np.concatenate(shares)
    scale = 1 / ((every.std(axis=0) + 1e-8) * np.sqrt(40))
    scarcity = np.tile((count / 3 / np.array(sizes))[codes], forms)  # classes weigh alike
    targets = np.eye(3)[np.tile(codes, forms)] * scarcity[:, None] ** 0.25 - 1 / 3
    mean = np.average(every, axis=0, weights=scarcity)

    def fitted(kept: np.ndarray, penalty: float) -> np.ndarray:
        judge = Ridge(alpha=penalty, fit_intercept=False, solver="svd")
        judge.fit(((every - mean) * scale)[kept], targets[kept], sample_weight=scarcity[kept])
        return np.asarray(judge.coef_.T * scale[:, None])

    whole = np.arange(count * forms)
    off = [np.abs(fitted(whole, p) - learned["weights"]).max() for p in np.logspace(-2, 4, 13)]
    assert min(off) < 1e-9
    penalty = float(np.logspace(-2, 4, 13)[int(np.argmin(off))])
    for index in range(0, count, 7):
        weights = fitted(whole[whole % count != index], penalty)
        alone = np.mean([(form[index] - mean) @ weights for form in shares], axis=0)
        np.testing.assert_allclose(without[index], alone, atol=1e-9)


def gestures(seed: int, each: int) -> tuple[list, list[str]]:  # type: ignore[type-arg]
    random = np.random.default_rng(seed)
    poses, labels = [], []
    for label, (axis, cycles) in {"up": (1, 1.0), "twice": (1, 2.0), "side": (0, 1.0)}.items():
        for _ in range(each):
            points = swing("right_wrist", axis, cycles, int(random.integers(25, 45)), random.uniform(90, 130))
            poses.append(pose(points + random.normal(0, 2, points.shape)))
            labels.append(label)
    return poses, labels


def model(name: str, **more: object) -> GestureClassifier:
    return GestureClassifier(
        "modern", settings={"classify.classifier": name, "classify.reject": None, **more}
    )


@pytest.mark.parametrize("name", ["rocket", "blend"])
def test_gestures_are_told_apart_saved_and_given_probabilities(name: str, tmp_path: Path) -> None:
    poses, labels = gestures(0, 8)
    queries, truth = gestures(1, 2)
    fitted = model(name, **{"classify.confidence": 0.1}).fit(poses, labels)
    assert fitted.predict(queries).tolist() == truth
    assert fitted.predict_proba(queries).max(axis=1).min() > 0.4
    found = fitted.predictions(queries)
    assert all(one.margin and 0 < one.margin < 2 for one in found)
    fitted.save(tmp_path / "model")
    assert GestureClassifier.load(tmp_path / "model").predictions(queries) == found


def test_no_row_depends_on_the_others_of_its_batch() -> None:
    fitted = model("auto").fit(*gestures(0, 4))
    queries, _ = gestures(1, 7)
    assert isinstance(fitted._recognizer.fitted.classifier, Blend)
    together = fitted.predictions(queries)
    assert [one for query in queries for one in fitted.predictions([query])] == together
    assert fitted.predictions(queries[::-1])[::-1] == together
    scores = fitted.decision_function(queries)
    np.testing.assert_array_equal(scores[2:], fitted.decision_function(queries[2:]))


def test_examples_stand_for_the_other_hand_where_the_preset_says_so() -> None:
    poses, labels = gestures(0, 4)
    fitted = model("rocket").fit(poses, labels)
    flipped = [mirrored(item) for item in fitted.signals(poses) if isinstance(item, Signals)]
    np.testing.assert_allclose(fitted.decision_function(flipped), fitted.decision_function(poses), atol=1e-5)
    assert fitted.predict(flipped).tolist() == labels


def test_with_one_example_a_class_the_blend_is_weighed() -> None:
    poses, labels = gestures(0, 1)
    queries, _ = gestures(1, 3)
    blend, weighed = (model(name).fit(poses, labels) for name in ("blend", "weighed"))
    assert blend.predictions(queries) == weighed.predictions(queries)
    np.testing.assert_array_equal(blend.decision_function(queries), weighed.decision_function(queries))
    state = blend._recognizer.fitted.state
    assert not any(key.startswith("rocket.") for key in state)


def test_a_posture_is_left_to_weighed() -> None:
    poses, labels = gestures(0, 2)
    still = [one.part(slice(0, 1)) for one in poses]
    settings = load_settings("pose", environment={})
    blend, weighed = (
        GestureClassifier(settings.with_values([("classify.classifier", name)])).fit(still, labels)
        for name in ("auto", "weighed")
    )
    np.testing.assert_array_equal(blend.decision_function(still), weighed.decision_function(still))


def test_the_members_of_the_blend_add_up_to_its_scores() -> None:
    poses, labels = gestures(0, 3)
    queries, _ = gestures(1, 1)
    fitted = model("blend").fit(poses, labels)
    inner, signals = fitted._recognizer.fitted, fitted.signals(queries)
    distances = fitted.distances(queries)
    assert isinstance(inner.classifier, Blend)
    said = inner.classifier.members(inner.state, signals, distances)
    assert list(said) == ["weighed", "rocket"]
    np.testing.assert_allclose(said["weighed"] + said["rocket"], inner.ordered(signals, distances)[0])
    np.testing.assert_allclose(said["weighed"] * 1.25, Weighed().scores(inner.state, signals, distances))
    assert isinstance(signals[0], Signals)
    found = explain(signals[0], fitted.library_, distances[0], fitted.settings_, inner)
    assert sum(added for _, added in found.members) == pytest.approx(found.lead)
    assert sum(one.added for one in found.contributions) == pytest.approx(found.members[0][1])


@pytest.mark.parametrize("options", [{"features": 10}, {"frames": 5}])
def test_impossible_options_of_rocket(options: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="at least"):
        Rocket(**options)


def test_an_impossible_weight_of_the_blend() -> None:
    with pytest.raises(ValueError, match="weight -1"):
        Blend(weight=-1)
