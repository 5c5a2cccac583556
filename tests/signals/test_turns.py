"""Orientations that are written in two ways are one."""

from __future__ import annotations

import numpy as np
import pytest

from gesture_core.signals.turns import without_jumps

T = np.linspace(0, 2, 60)


@pytest.mark.parametrize("names", ["wxyz", "0123", "1234"])
def test_a_quaternion_keeps_its_sign(names: str) -> None:
    whole = np.stack([np.cos(T / 2), np.sin(T / 2), 0 * T, 0 * T], axis=1)
    flipped = whole * np.where((T > 0.5) & (T < 1.2), -1, 1)[:, None]
    flipped[7] = np.nan
    channels = [f"q/{name}" for name in names]
    for given in (flipped, -flipped):
        np.testing.assert_allclose(np.delete(without_jumps(given, channels), 7, 0), np.delete(whole, 7, 0))
    np.testing.assert_array_equal(without_jumps(3 * flipped, channels), 3 * flipped)  # four forces


@pytest.mark.parametrize(
    ("name", "turn"),
    [("yaw[deg]", 360), ("knee[°]", 360), ("heading", 360), ("Euler/z", 360), ("motionYaw", 2 * np.pi)],
)
def test_an_angle_goes_on_past_a_whole_turn(name: str, turn: float) -> None:
    way = turn * (0.8 + 0.3 * T)
    jumps = (way % turn)[:, None]
    np.testing.assert_allclose(without_jumps(jumps, [name])[:, 0], way, rtol=1e-9)
    np.testing.assert_array_equal(without_jumps(way[:, None], [name])[:, 0], way)


def test_a_few_degrees_are_no_turn_in_radians_and_a_stream_says_its_angles() -> None:
    nods = np.where(np.arange(60) % 9 < 4, -2.0, 2.0)[:, None]
    np.testing.assert_array_equal(without_jumps(nods, ["pitch"]), nods)
    way = 360 * (0.8 + 0.3 * T)
    for name in ("yaw@imu", "yaw@imu[deg]", "euler@imu/z"):
        np.testing.assert_allclose(without_jumps((way % 360)[:, None], [name])[:, 0], way, rtol=1e-9)
    both = without_jumps(np.stack([nods[:, 0], way % 360], axis=1), ["acc[0] of the hand", "yaw"])
    np.testing.assert_allclose(both, np.stack([nods[:, 0], way], axis=1), rtol=1e-9)


@pytest.mark.parametrize("name", ["force", "gyro/x[deg/s]", "scroll", "intercourse/x[m]"])
def test_what_is_no_angle_stays(name: str) -> None:
    jumps = (360 * (0.8 + 0.3 * T) % 360)[:, None]
    np.testing.assert_array_equal(without_jumps(jumps, [name]), jumps)
