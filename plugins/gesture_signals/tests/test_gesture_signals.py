"""Every step keeps the contract of its kind, with the options that the presets give it, too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from gesture_signals.filters import Center, Gaussian, Median, Resample
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
