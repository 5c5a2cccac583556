"""What the suites of normalizers, filters and selectors say of a plugin that is wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from test_suites import faults

from gesture_core.errors import PoseError, SignalError
from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence, Signals

NECK, HIPS = COCO18.index("neck"), [COCO18.index("right_hip"), COCO18.index("left_hip")]


@dataclass
class Torso:
    """A right normalizer; ``spoil`` makes it a wrong one."""

    spoil: Callable[[PoseSequence, np.ndarray], Any] = lambda pose, points: points

    def normalize(self, pose: PoseSequence) -> Any:
        points = pose.keypoints.astype(np.float64)
        length = np.linalg.norm(points[:, NECK] - points[:, HIPS].mean(axis=1), axis=1)
        if not np.nan_to_num(length).any():
            raise PoseError("no torso")
        return self.spoil(pose, (points - points[:, [NECK]]) / np.nanmedian(length))


def _remembers(_: PoseSequence, points: np.ndarray, calls: list[int] = []) -> np.ndarray:  # noqa: B006
    calls.append(0)
    return points * len(calls)


def _writes(pose: PoseSequence, points: np.ndarray) -> np.ndarray:
    pose.keypoints.flags.writeable = True
    pose.keypoints[0] = 0
    return points


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda pose, points: points[:, :17], r"shape \(40, 17, 2\), expected \(T, J, 2\)"),
        (lambda pose, points: points.astype(int), "array of int64, expected floats"),
        (lambda pose, points: points * np.nan, "finds no place"),
        (lambda pose, points: np.nan_to_num(points), "NaN stays NaN"),
        (lambda pose, points: np.nan_to_num(points, nan=np.inf), "infinity"),
        (lambda pose, points: pose.keypoints, "body's units"),
        (lambda pose, points: points - points[:, [COCO18.index("left_hip")]], "middle line"),
        (lambda pose, points: points * (1, 1, 2)[len(pose) % 3] / 0, "infinit"),
        (lambda pose, points: points[[5]], r"shape \(1, 18, 2\)"),
        (lambda pose, points: 1 / 0, "raises ZeroDivisionError"),
        (lambda pose, points: points if len(pose) > 1 else 1 / 0, "one frame raises ZeroDivisionError"),
        (_remembers, "must not remember"),
        (_writes, "changes what it was given"),
    ],
)
def test_a_wrong_normalizer(spoil: Callable[[PoseSequence, np.ndarray], Any], message: str) -> None:
    assert not faults("normalizer", Torso())
    with np.errstate(all="ignore"), pytest.raises(AssertionError, match=message):
        raise AssertionError("\n".join(faults("normalizer", Torso(spoil))))


@dataclass
class Same:
    """A filter that leaves the signals as they are; ``spoil`` makes it a wrong one."""

    spoil: Callable[[Signals], Any] = lambda signals: signals

    def apply(self, signals: Signals) -> Any:
        return self.spoil(signals)


def _salient(signals: Signals, **flags: bool) -> Signals:
    width = len(signals.channels)
    return replace(signals, **{name: np.full(width, flag) for name, flag in flags.items()})  # type: ignore[arg-type]


def _only_right(signals: Signals) -> Signals:
    kept = [i for i, name in enumerate(signals.channels) if name.startswith("right_")]
    assert signals.mask is not None and signals.present is not None
    return replace(
        signals,
        values=signals.values[:, kept],
        channels=tuple(signals.channels[i] for i in kept),
        mask=signals.mask[kept],
        present=signals.present[kept],
    )


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda signals: signals.values, "ndarray, expected Signals"),
        (lambda signals: replace(signals, source=""), "loses the source"),
        (lambda signals: replace(signals, times=signals.times + 9), "times outside"),
        (lambda s: replace(s, channels=("nose_x", *s.channels[:-1])), "the name 'nose_x'"),
        (lambda signals: _salient(signals, mask=True), "mask of nose_x is True where it is False"),
        (lambda signals: _salient(signals, present=False), "present of nose_x is False where it is True"),
        (lambda s: replace(s, channels=s.channels[::-1], values=s.values[:, ::-1]), "takes both along"),
        (lambda signals: replace(signals, values=np.abs(signals.values)), "is not the mirror image"),
        (lambda s: replace(s, values=s.values / s.values[1, 0] * s.times[1]), "IndexError"),
        (lambda s: replace(s, values=s.values * int(1 / np.ptp(s.times))), "one frame raises OverflowError"),
        (lambda s: s if "nose_x" in s.channels else s.channels.index("nose_x"), "other channels raises"),
    ],
)
def test_a_wrong_filter(spoil: Callable[[Signals], Any], message: str) -> None:
    assert not faults("filter", Same()) and not faults("filter", Same(_only_right))
    with np.errstate(all="ignore"), pytest.raises(AssertionError, match=message):
        raise AssertionError("\n".join(faults("filter", Same(spoil))))


@dataclass
class Range:
    """A right selector; ``spoil`` makes it a wrong one."""

    spoil: Callable[[Signals, np.ndarray], Any] = lambda signals, mask: mask

    def select(self, signals: Signals) -> Any:
        return self.spoil(signals, np.ptp(signals.values, axis=0) > 0.1)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda signals, mask: mask.astype(float), "no array of bool, but float64"),
        (lambda signals, mask: mask.tolist(), "no array of bool, but list"),
        (lambda signals, mask: mask[:3], r"shape \(3,\), expected \(D,\)"),
        (lambda signals, mask: mask & False, "chooses nothing"),
        (lambda signals, mask: mask if len(signals) > 1 else mask[5], "IndexError|shape"),
        (lambda signals, mask: mask & (np.random.default_rng().random(36) < 0.5), "must not remember"),
    ],
)
def test_a_wrong_selector(spoil: Callable[[Signals, np.ndarray], Any], message: str) -> None:
    assert not faults("selector", Range())
    with pytest.raises(AssertionError, match=message):
        raise AssertionError("\n".join(faults("selector", Range(spoil))))


def test_a_refusal_is_an_answer() -> None:
    """A filter that refuses what it cannot use keeps the contract."""

    def refuse(signals: Signals) -> Signals:
        if len(signals) < 5 or np.ptp(signals.times) == 0 or "nose_x" not in signals.channels:
            raise SignalError("too short")
        return signals

    assert not faults("filter", Same(refuse))
