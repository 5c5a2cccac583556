"""Gaps are filled within limits, and a missing joint never becomes a coordinate."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import J, pose, standing, waving
from hypothesis import given
from hypothesis import strategies as st

from gesture_core.errors import PoseError
from gesture_core.signals.gaps import GapRule, fill_gaps, require_pose

TIMES = np.arange(10) / 10


def track(**seen: float) -> np.ndarray:
    """(10, 1, 2) track of one joint; ``f3=5`` puts it at (5, 5) in frame 3."""
    points = np.full((10, 1, 2), np.nan)
    for frame, value in seen.items():
        points[int(frame[1:])] = value
    return points


def test_short_gap_is_interpolated_over_time_and_long_gap_holds_the_nearest() -> None:
    points = track(f0=0, f1=1, f4=4, f9=9)
    filled, present = fill_gaps(points, TIMES, GapRule(max_gap=0.35, min_seen=0.3))
    assert present.tolist() == [True]
    np.testing.assert_allclose(filled[:, 0, 0], [0, 1, 2, 3, 4, 4, 4, 9, 9, 9])


def test_interpolation_follows_the_clock_and_not_the_frame_number() -> None:
    times = np.array([0.0, 0.1, 0.4])
    points = np.array([[[0.0, 0.0]], [[np.nan, np.nan]], [[8.0, 4.0]]])
    filled, _ = fill_gaps(points, times, GapRule(max_gap=1, min_seen=0))
    np.testing.assert_allclose(filled[1, 0], [2, 1])


def test_frames_that_share_a_time_stamp_do_not_divide_by_zero() -> None:
    points = np.array([[[0.0, 0.0]], [[np.nan, np.nan]], [[8.0, 4.0]]])
    filled, _ = fill_gaps(points, np.zeros(3), GapRule(min_seen=0))
    assert np.isfinite(filled).all()


def test_a_joint_seen_too_rarely_is_not_present_and_has_no_coordinates() -> None:
    filled, present = fill_gaps(track(f2=3, f5=4), TIMES, GapRule(min_seen=0.5))
    assert not present[0]
    assert np.isnan(filled).all()


@given(st.lists(st.booleans(), min_size=1, max_size=30), st.floats(0, 1), st.floats(0, 2))
def test_fill_changes_nothing_that_was_seen_and_stays_inside_its_range(
    seen: list[bool], min_seen: float, max_gap: float
) -> None:
    values = np.arange(len(seen), dtype=float) ** 2
    points = np.where(seen, values, np.nan)[:, None, None].repeat(2, axis=2)
    filled, present = fill_gaps(points, np.arange(len(seen)) / 10, GapRule(max_gap, min_seen))
    assert present[0] == (any(seen) and np.mean(seen) >= min_seen)
    if present[0]:
        known = values[seen]
        np.testing.assert_array_equal(filled[seen, 0, 0], known)
        assert np.isfinite(filled).all()
        assert filled.min() >= known.min() - 1e-9
        assert filled.max() <= known.max() + 1e-9


def test_frames_without_a_person_at_both_ends_are_cut_off() -> None:
    points = waving()
    points[:5] = np.nan
    points[-3:] = np.nan
    cut = require_pose(pose(points), GapRule())
    assert len(cut) == len(points) - 8
    assert cut.times[0] == pytest.approx(0.2)


@pytest.mark.parametrize("kept", [0, 4, 9])
def test_too_few_frames_with_a_pose(kept: int) -> None:
    points = standing(40)
    points[kept:] = np.nan
    with pytest.raises(PoseError) as caught:
        require_pose(pose(points), GapRule(min_frames=5, min_pose=0.25))
    assert caught.value.code == "E_POSE_SPARSE"
    assert f"{kept} of 40" in str(caught.value)
    assert caught.value.subject == "clip"


@pytest.mark.parametrize("frames", [0, 1, 4])
def test_a_clip_too_short_to_judge_is_no_matter_of_the_network(frames: int) -> None:
    with pytest.raises(PoseError) as caught:
        require_pose(pose(standing(frames)), GapRule(min_frames=5))
    assert caught.value.code == "E_POSE_SHORT" and "network" not in str(caught.value)
    assert "longer clip" in caught.value.remedy
    require_pose(pose(standing(5)), GapRule(min_frames=5))


def test_one_joint_is_a_pose() -> None:
    points = np.full((12, 18, 2), np.nan)
    points[:, J["nose"]] = 1.0
    assert len(require_pose(pose(points), GapRule())) == 12
