"""Every step keeps the contract of its kind, with the options that the presets give it, too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from gesture_signals.filters import Center, Gaussian, Median, Resample, Shape
from gesture_signals.normalizers import ShoulderNormalizer, TorsoNormalizer, UprightNormalizer
from gesture_signals.parts import Parts
from gesture_signals.selectors import AllChannels, Moving, VarianceThreshold

from gesture_core.plugin.interfaces import Filter, Normalizer, Selector
from gesture_core.skeletons import COCO18
from gesture_core.testing import (
    FILTER_CHECKS,
    NORMALIZER_CHECKS,
    SELECTOR_CHECKS,
    draw_pose,
    draw_signals,
)
from gesture_core.types import Signals

NORMALIZERS: list[Normalizer] = [
    ShoulderNormalizer(),
    TorsoNormalizer(),
    TorsoNormalizer(window=0.25, shoulders=1.45),
    UprightNormalizer(),
]
FILTERS: list[Filter] = [
    Center(),
    Center(share=0.5),
    Gaussian(),
    Gaussian(seconds=0.033),
    Median(),
    Parts(),
    Parts({"hands.energy": 1.0, "forearm.turning": 0.5, "arm.bend": 1.0, "nose.velocity@0.5": 2.0}),
    Resample(),
    Resample(rate=7.5),
    Shape(),
    Shape(seconds=0.1, steps=1),
]
SELECTORS: list[Selector] = [AllChannels(), Moving(), VarianceThreshold()]


@pytest.mark.parametrize("check", NORMALIZER_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("normalizer", NORMALIZERS, ids=repr)
def test_a_normalizer(normalizer: Normalizer, check: Callable[[Normalizer], None]) -> None:
    check(normalizer)


@pytest.mark.parametrize("check", FILTER_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("step", FILTERS, ids=repr)
def test_a_filter(step: Filter, check: Callable[[Filter], None]) -> None:
    check(step)


@pytest.mark.parametrize("check", SELECTOR_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("selector", SELECTORS, ids=repr)
def test_a_selector(selector: Selector, check: Callable[[Selector], None]) -> None:
    check(selector)


def test_normalizers_measure_in_their_own_length() -> None:
    pose = draw_pose()
    joint = {name: index for index, name in enumerate(COCO18.joints)}
    shoulders = ShoulderNormalizer().normalize(pose)
    width = np.linalg.norm(
        shoulders[:, joint["left_shoulder"]] - shoulders[:, joint["right_shoulder"]], axis=1
    )
    np.testing.assert_allclose(width, 1)
    torso = TorsoNormalizer().normalize(pose)
    hips = (torso[:, joint["left_hip"]] + torso[:, joint["right_hip"]]) / 2
    assert np.median(np.linalg.norm(hips - torso[:, joint["neck"]], axis=1)) == pytest.approx(1)


def test_resampling_gives_the_rate_that_was_asked_for() -> None:
    signals = draw_signals(frames=41)
    steps = np.diff(Resample(rate=40).apply(signals).times)
    np.testing.assert_allclose(steps, 1 / 40, rtol=0.02)


def test_a_frame_stands_beside_its_neighbours() -> None:
    times = np.arange(10) / 20
    signals = Signals(np.arange(10.0)[:, None], times, ("left_wrist_x",))
    found = Shape(seconds=0.2, steps=2).apply(signals)
    assert found.channels == ("left_wrist_x", *(f"left_wrist_x@{move:+d}" for move in (-1, 1, -2, 2)))
    np.testing.assert_allclose(found.values[5] * np.sqrt(5), [5, 3, 7, 1, 9], rtol=1e-6)
    np.testing.assert_allclose(found.values[0] * np.sqrt(5), [0, 0, 2, 0, 4], rtol=1e-6)


@pytest.mark.parametrize("options", [{"seconds": 0}, {"steps": 0}, {"steps": 1.5}])
def test_a_shape_without_neighbours_is_refused(options: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"above zero|one or more"):
        Shape(**options)  # type: ignore[arg-type]
