"""Data types refuse what they cannot mean, and never change afterwards."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gesture_core.errors import GestureError, InputError, KeypointError, MediaError, SignalError
from gesture_core.skeletons import BLAZEPOSE33, BODY25, COCO17, COCO18, MPI15, SKELETONS, mapped
from gesture_core.types import PoseSequence, SignalBatch, Signals


def pose(frames: int = 4, joints: int = 18, skeleton: str = "coco18") -> PoseSequence:
    rng = np.random.default_rng(frames)
    points = rng.normal(100, 20, (frames, joints, 2))
    return PoseSequence(points, rng.uniform(0.2, 1, (frames, joints)), np.arange(frames) / 25, skeleton)


def test_a_joint_with_one_coordinate_missing_is_missing() -> None:
    points = np.ones((2, 18, 2))
    points[1, 4, 0] = np.nan
    made = PoseSequence(points, np.ones((2, 18)), np.arange(2.0))
    assert np.isnan(made.keypoints[1, 4]).all()
    assert made.scores[1, 4] == 0
    assert made.seen.sum() == 35
    assert made.frames_with_pose == 2


def test_the_callers_array_stays_writable_and_apart() -> None:
    points = np.ones((2, 18, 2), np.float32)
    made = PoseSequence(points, np.ones((2, 18), np.float32), np.arange(2.0))
    points[0, 0] = 7
    assert made.keypoints[0, 0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        made.keypoints[0, 0] = 3


@pytest.mark.parametrize(
    ("points", "scores", "times", "code"),
    [
        (np.ones((2, 17, 2)), np.ones((2, 17)), [0, 1], "E_KEYPOINTS_SHAPE"),
        (np.ones((2, 18, 4)), np.ones((2, 18)), [0, 1], "E_KEYPOINTS_SHAPE"),
        (np.ones((2, 18, 2)), np.ones((3, 18)), [0, 1], "E_KEYPOINTS_SHAPE"),
        (np.ones((2, 18, 2)), np.ones((2, 18)), [0], "E_KEYPOINTS_SHAPE"),
        (np.full((2, 18, 2), np.inf), np.ones((2, 18)), [0, 1], "E_KEYPOINTS_VALUE"),
        (np.ones((2, 18, 2)), np.ones((2, 18)), [1, 0], "E_KEYPOINTS_TIMES"),
        (np.ones((2, 18, 2)), np.ones((2, 18)), [0, np.nan], "E_KEYPOINTS_TIMES"),
    ],
)
def test_malformed_keypoints_are_refused(points, scores, times, code) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(KeypointError) as caught:
        PoseSequence(points, scores, times, source="clip")
    assert caught.value.code == code
    assert "clip" in str(caught.value)


def test_depth_follows_its_joints() -> None:
    points = np.random.default_rng(0).uniform(0, 9, (4, 33, 2))
    points[1, 3] = np.nan
    depth = np.arange(4 * 33, dtype=float).reshape(4, 33)
    pose = PoseSequence(points, np.ones((4, 33)), np.arange(4.0), "blazepose33", depth=depth)
    assert pose.depth is not None and np.isnan(pose.depth[1, 3]) and pose.depth[2, 3] == 69
    part = pose.part(slice(2, 4))
    assert len(part) == 2 and part.depth is not None and part.depth[0, 3] == 69
    body = pose.onto("coco18")
    assert body.depth is not None
    wrist = BLAZEPOSE33.index("left_wrist")
    np.testing.assert_array_equal(body.depth[:, COCO18.index("left_wrist")], depth[:, wrist])
    shoulders = [BLAZEPOSE33.index(f"{side}_shoulder") for side in ("left", "right")]
    np.testing.assert_array_equal(body.depth[:, COCO18.index("neck")], depth[:, shoulders].mean(axis=1))
    solid = pose.solid
    assert solid.depth is None and solid.keypoints.shape == (4, 33, 3) and solid.keypoints[2, 3, 2] == 69
    np.testing.assert_array_equal(solid.flat.keypoints, pose.keypoints)
    with pytest.raises(KeypointError, match=r"E_KEYPOINTS_SHAPE.*depth"):
        PoseSequence(points, np.ones((4, 33)), np.arange(4.0), "blazepose33", depth=depth[:3])


def test_an_unknown_skeleton_lists_the_known_ones() -> None:
    with pytest.raises(KeypointError, match="coco18"):
        PoseSequence(np.ones((1, 18, 2)), np.ones((1, 18)), np.zeros(1), "coco99")


@pytest.mark.parametrize("skeleton", SKELETONS.values(), ids=lambda s: s.name)
def test_mirrors_and_limbs_name_joints(skeleton) -> None:  # type: ignore[no-untyped-def]
    assert len(set(skeleton.joints)) == len(skeleton.joints)
    assert [skeleton.mirror[i] for i in skeleton.mirror] == list(range(len(skeleton.joints)))
    for limb in skeleton.limbs:
        assert set(limb) <= set(skeleton.joints)


@pytest.mark.parametrize("source", [COCO17, BODY25, MPI15, BLAZEPOSE33], ids=lambda s: s.name)
def test_every_skeleton_maps_to_coco18_by_name(source) -> None:  # type: ignore[no-untyped-def]
    made = pose(3, len(source.joints), source.name)
    points, scores = mapped(made.keypoints, made.scores, source, COCO18)
    for joint in ("right_wrist", "left_hip", "right_ankle"):
        np.testing.assert_array_equal(points[:, COCO18.index(joint)], made.keypoints[:, source.index(joint)])
        np.testing.assert_array_equal(scores[:, COCO18.index(joint)], made.scores[:, source.index(joint)])
    neck = points[:, COCO18.index("neck")]
    shoulders = points[:, [COCO18.index("left_shoulder"), COCO18.index("right_shoulder")]]
    expected = made.keypoints[:, source.index("neck")] if "neck" in source.joints else shoulders.mean(axis=1)
    np.testing.assert_allclose(neck, expected, rtol=1e-6)
    missing = [j for j in COCO18.joints if j not in source.joints and j not in source.derived]
    for joint in missing:
        assert np.isnan(points[:, COCO18.index(joint)]).all()
        assert (scores[:, COCO18.index(joint)] == 0).all()


def test_signals_name_the_channel_that_is_not_finite() -> None:
    with pytest.raises(SignalError, match="b_y"):
        Signals(np.array([[1.0, np.nan]]), np.zeros(1), ("a_x", "b_y"))
    absent = Signals(np.array([[1.0, np.nan]]), np.zeros(1), ("a_x", "b_y"), present=np.array([True, False]))
    assert absent.values[0, 1] == 0
    assert absent.selected == ("a_x",)


def test_what_is_masked_is_missing() -> None:
    points = np.ma.masked_equal(np.full((2, 18, 2), 5.0), 5.0)
    points[0] = 1.0
    pose = PoseSequence(points, np.ma.masked_equal(np.ones((2, 18)), 0), np.arange(2.0))
    assert pose.seen[0].all() and not pose.seen[1].any()
    with pytest.raises(SignalError, match="E_SIGNAL_VALUE"):
        Signals(np.ma.masked_equal([[1.0], [2.0]], 2.0), np.arange(2), ("a_x",))
    with pytest.raises(InputError, match="query 0 has masked values"):
        SignalBatch.of([np.ma.masked_equal([1.0, 2.0], 2.0)], name="query")
    whole = np.ma.masked_equal([1.0, 2.0], 7.0)
    assert SignalBatch.of([whole]).values[0, :, 0].tolist() == [1, 2]


@pytest.mark.parametrize(
    "times", [[0, np.nan], [0, np.inf], [1, 0], np.ma.masked_equal([0.0, 1.0], 1.0)], ids=str
)
def test_signals_have_times_as_poses_have(times) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SignalError, match="E_SIGNAL_TIMES"):
        Signals(np.zeros((2, 1)), times, ("a_x",))


def test_batches_refuse_with_the_index() -> None:
    good = np.ones((3, 2))
    for bad, code in (
        (np.full((2, 2), np.nan), "E_NOT_FINITE"),
        (np.full((2, 2), np.inf), "E_NOT_FINITE"),
        (np.ones((0, 2)), "E_EMPTY"),
        (np.ones((2, 3)), "E_DIMENSIONS"),
        (np.array([["a", "b"]]), "E_DTYPE"),
    ):
        with pytest.raises(InputError, match="query 1") as caught:
            SignalBatch.of([good, bad], name="query")
        assert caught.value.code == code
    with pytest.raises(InputError, match="no query"):
        SignalBatch.of([], name="query")


@given(
    st.lists(
        hnp.arrays(np.float32, st.tuples(st.integers(1, 9), st.just(3)), elements=st.floats(-5, 5, width=32)),
        min_size=1,
        max_size=6,
    )
)
def test_batches_hold_every_series_and_zeros_beyond(series: list[np.ndarray]) -> None:
    batch = SignalBatch.of(series)
    for index, item in enumerate(series):
        np.testing.assert_array_equal(batch.values[index, : batch.lengths[index]], item)
        assert not batch.values[index, batch.lengths[index] :].any()


def test_errors_survive_pickling_and_print_their_parts() -> None:
    error = MediaError(
        "cut off", subject="a.mp4", kept="12 frames", remedy="repair it", code="E_MEDIA_BROKEN"
    )
    copy: GestureError = pickle.loads(pickle.dumps(error))
    assert str(copy) == str(error) == "E_MEDIA_BROKEN a.mp4: cut off; kept: 12 frames; try: repair it"
    assert type(copy) is MediaError
    assert MediaError("x").about("b.mp4").subject == "b.mp4"
