"""One bad frame must not decide a clip: what jumps and comes back goes, confused sides are exchanged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bodies import J, pose, standing, waving
from hypothesis import given, settings
from hypothesis import strategies as st

from gesture_core.classify.estimator import GestureClassifier
from gesture_core.settings import load_settings
from gesture_core.signals import repair
from gesture_core.signals.chain import Chain
from gesture_core.signals.repair import readings_apart, repaired
from gesture_core.skeletons import COCO18
from gesture_core.types import PoseSequence

TORSO = 110.0
MIRROR = list(COCO18.mirror)
Damage = Callable[[np.ndarray, list[int]], None]


def jump(points: np.ndarray, frames: list[int]) -> None:
    """The right wrist three torso lengths off, each time elsewhere."""
    for count, frame in enumerate(frames):
        angle = 2.4 * count
        points[frame, J["right_wrist"]] += 3 * TORSO * np.array([np.cos(angle), np.sin(angle)])


def same_jump(points: np.ndarray, frames: list[int]) -> None:
    """The left wrist one torso length off, each time in the same place."""
    points[frames, J["left_wrist"]] = points[0, J["left_wrist"]] + (0.0, TORSO)


def swap(*names: str) -> Damage:
    def damage(points: np.ndarray, frames: list[int]) -> None:
        for name in names:
            pair = [J[f"right_{name}"], J[f"left_{name}"]]
            points[np.ix_(frames, pair)] = points[np.ix_(frames, pair[::-1])]

    return damage


def swap_all(points: np.ndarray, frames: list[int]) -> None:
    points[frames] = points[frames][:, MIRROR]


def to_zero(points: np.ndarray, frames: list[int]) -> None:
    points[frames, J["left_elbow"]] = 0


def elsewhere(points: np.ndarray, frames: list[int]) -> None:
    """Somebody else for a moment."""
    points[frames] += (4 * TORSO, 0.3 * TORSO)


KINDS: list[Damage] = [
    jump, same_jump, swap("wrist"), swap("elbow", "wrist"), swap("shoulder", "elbow", "wrist"),
    swap("hip", "knee", "ankle"), swap_all, to_zero, elsewhere,
]  # fmt: skip
NAMES = ["jump", "same jump", "wrists", "forearms", "arms", "legs", "all", "zero", "elsewhere"]


def moving(frames: int = 40) -> np.ndarray:
    """A body that raises its right wrist and sways a little."""
    points = waving(frames=frames, size=150.0)
    points[:, :, 0] += 6 * np.sin(np.linspace(0, 5, frames))[:, None]
    points[:, J["left_wrist"], 0] += 30 * np.sin(np.linspace(0, 4, frames))
    return points


@pytest.mark.parametrize("fps", [10.0, 15.0, 25.0, 60.0])
@pytest.mark.parametrize("frames", [[0], [39], [17], [3, 20, 33], [18, 19, 20], [0, 1], [38, 39]], ids=str)
@pytest.mark.parametrize("damage", KINDS, ids=NAMES)
def test_bad_frames_leave_the_signals_nearly_as_they_were(
    damage: Damage, frames: list[int], fps: float
) -> None:
    whole = Chain.from_settings(load_settings("modern", environment={}))
    points = moving()
    clean = whole(pose(points, fps))
    damage(points, frames)
    found = whole(pose(points, fps))
    if len(found) != len(clean):  # a first or last frame without a person is cut off
        assert damage is elsewhere and len(clean) - len(found) <= 1 + 20 * len(frames) / fps
        return
    assert np.abs(found.values - clean.values).max() < 0.15 * np.abs(clean.values).max()


def nearer(points: np.ndarray, frames: list[int]) -> None:
    """The right wrist right in the picture, and two torso lengths before it."""
    points[frames, J["right_wrist"], 2] -= 2 * TORSO


@pytest.mark.parametrize("frames", [[0], [39], [3, 20, 33], [18, 19, 20]], ids=str)
@pytest.mark.parametrize("damage", [nearer, swap("wrist"), swap_all, to_zero])
def test_the_same_holds_in_three_dimensions(damage: Damage, frames: list[int]) -> None:
    whole = Chain.from_settings(load_settings("depth", environment={}))
    plane = moving()
    depth = 40 * np.sin(np.linspace(0, 3, 40)[:, None] + np.arange(18)) + 900
    points = np.concatenate([plane, depth[..., None]], axis=2)
    clean = whole(PoseSequence(points, np.ones((40, 18)), np.arange(40) / 25))
    assert clean.repaired == 0
    damage(points, frames)
    found = whole(PoseSequence(points, np.ones((40, 18)), np.arange(40) / 25))
    assert np.abs(found.values - clean.values).max() < 0.15 * np.abs(clean.values).max()


@pytest.mark.parametrize("frames", [[0], [0, 1, 2], [39], [4, 15, 27]], ids=str)
def test_a_file_that_trembles_shows_a_jump_as_well(frames: list[int]) -> None:
    """Each frame is measured by its own shoulders, as some files are: all lengths tremble by a fifth."""
    sizes = np.random.default_rng(3).normal(1, 0.2, (40, 1, 1))
    points = (moving() - moving()[:, [J["neck"]]]) * sizes
    untouched = repaired(pose(points, 15.0)).pose.seen
    jump(points, frames)
    seen = repaired(pose(points, 15.0)).pose.seen
    assert not seen[frames, J["right_wrist"]].any()
    assert (untouched & ~seen).sum() <= len(frames) + 2


@pytest.mark.parametrize("frames", [[7], [12, 13, 14, 15, 16, 17, 18, 19], [0, 1, 2], [37, 38, 39]], ids=str)
@pytest.mark.parametrize("damage", [swap("wrist"), swap("shoulder", "elbow", "wrist"), swap_all])
def test_an_exchange_is_undone_exactly_however_long(damage: Damage, frames: list[int]) -> None:
    points = moving()
    clean = pose(points)
    scores = np.linspace(0.5, 1, 18)[None].repeat(40, axis=0)
    damage(points, frames)
    damage(scores, frames)
    found = repaired(PoseSequence(points, scores, clean.times))
    np.testing.assert_array_equal(found.pose.keypoints, clean.keypoints)
    np.testing.assert_array_equal(found.pose.scores, np.float32(np.linspace(0.5, 1, 18)[None].repeat(40, 0)))
    assert found.frames == len(frames)


@given(
    st.integers(8, 60),
    st.sampled_from([10.0, 20.0, 30.0, 60.0]),
    st.floats(0, 2.5),
    st.floats(0, 0.7),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=60, deadline=None)
def test_smooth_movement_passes_bit_by_bit(
    frames: int, fps: float, frequency: float, size: float, seed: int
) -> None:
    size = min(size, 1.2 / max(frequency, 0.1))  # at most 4 m/s
    if frequency:  # and not out and back by a third of the trunk between three frames
        size = min(size, 0.3 / (2**0.5 * (1 - np.cos(2 * np.pi * frequency / fps)) + 1e-9))
    random = np.random.default_rng(seed)
    phase = 2 * np.pi * (frequency * np.arange(frames)[:, None, None] / fps + random.random((18, 2)))
    points = standing(frames)
    points[:, J["right_elbow"] : J["right_wrist"] + 1] += (size * TORSO * np.sin(phase))[:, :2]
    points[:, J["left_wrist"]] += (size * TORSO * np.sin(phase))[:, 2]
    source = pose(points, fps)
    assert repaired(source).pose is source


@pytest.mark.parametrize("fps", [10.0, 15.0, 30.0])
def test_hands_that_cross_are_not_exchanged(fps: float) -> None:
    frames = round(3 * fps)
    points = standing(frames)
    swing = np.cos(2 * np.pi * 1.0 * np.arange(frames) / fps)  # once to and fro in a second
    points[:, J["right_wrist"]] = 300 + np.stack([-60 * swing, 40 + 0 * swing], axis=1)
    points[:, J["left_wrist"]] = 300 + np.stack([60 * swing, 40 + 0 * swing], axis=1)
    source = pose(points, fps)
    assert repaired(source).pose is source


def test_a_body_that_turns_round_keeps_its_sides() -> None:
    points = standing(60)
    turn = np.cos(np.clip(np.arange(60) - 15, 0, 30) / 30 * np.pi)  # half a turn in 1.2 seconds
    points[:, :, 0] = 300 + (points[:, :, 0] - 300) * turn[:, None]
    source = pose(points)
    assert repaired(source).pose is source


@given(st.integers(0, 8), st.lists(st.integers(0, 39), min_size=1, max_size=4, unique=True))
@settings(max_examples=40, deadline=None)
def test_a_mirrored_input_is_repaired_to_the_mirrored_output(kind: int, frames: list[int]) -> None:
    points = moving()
    KINDS[kind](points, sorted(frames))
    flipped = points[:, MIRROR] * (-1, 1)
    found, other = repaired(pose(points)), repaired(pose(flipped))
    np.testing.assert_array_equal(
        other.pose.keypoints, found.pose.keypoints[:, MIRROR] * np.array((-1, 1), np.float32)
    )
    assert other.frames == found.frames


@pytest.mark.parametrize("frame", range(5))
@pytest.mark.parametrize("damage", [jump, swap("wrist"), swap_all])
def test_five_frames_are_enough(damage: Damage, frame: int) -> None:
    points = standing(5)
    points[:, J["left_wrist"], 1] -= np.linspace(0, 40, 5)
    clean = points.copy()
    damage(points, [frame])
    found = repaired(pose(points)).pose
    kept = found.seen
    assert kept.sum() >= 5 * 18 - 1
    np.testing.assert_array_equal(found.keypoints[kept], clean.astype(np.float32)[kept])


def test_a_jump_that_stays_is_a_movement() -> None:
    points = standing()
    points[20:, J["right_wrist"], 1] -= 0.8 * TORSO
    source = pose(points)
    assert repaired(source).pose is source


def test_what_the_network_doubts_needs_to_jump_less_far() -> None:
    points = standing()
    points[20, J["right_wrist"], 1] -= 0.25 * TORSO
    source = pose(points)
    assert repaired(source).pose is source
    scores = source.scores.copy()
    scores[20, J["right_wrist"]] = 0.02
    assert not repaired(replace(source, scores=scores)).pose.seen[20, J["right_wrist"]]


def test_what_trembles_is_not_taken_for_faults() -> None:
    points = standing(60)
    points += np.random.default_rng(0).normal(0, 0.12 * TORSO, points.shape)
    assert repaired(pose(points, 30.0)).frames < 12


def test_zeros_are_missing_unless_the_body_is_centred_on_a_joint() -> None:
    points = standing()
    points[5:25, J["right_ankle"]] = 0
    points[:, J["left_ankle"]] = 0
    found = repaired(pose(points)).pose
    assert not found.seen[5:25, J["right_ankle"]].any() and not found.seen[:, J["left_ankle"]].any()
    points[0, J["nose"], 0] = -1
    points[:, J["left_ankle"]] = np.nan
    assert not repaired(pose(points)).pose.seen[5:25, J["right_ankle"]].any()
    centred = standing() - 300
    source = pose(centred)
    assert (centred[:, J["neck"]] == 0).all() and repaired(source).pose is source


def test_a_zero_that_changes_sides_with_its_hand_is_missing_there() -> None:
    points = moving()
    swap("wrist")(points, list(range(12, 20)))
    points[15, J["left_wrist"]] = 0  # which is the right one by then
    found = repaired(pose(points)).pose
    assert not found.seen[15, J["right_wrist"]] and found.seen[15, J["left_wrist"]]
    np.testing.assert_allclose(found.keypoints[15, J["left_wrist"]], moving()[15, J["left_wrist"]], rtol=1e-6)


def test_joint_by_joint_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """As recordings of hours are repaired, so that memory does not grow with the joints."""
    points = np.concatenate([moving(), moving()[::-1], moving()])
    for number, damage in enumerate(KINDS):
        damage(points, [12 * number + 7, 12 * number + 8])
    source = pose(points)
    at_once = repaired(source)
    monkeypatch.setattr(repair, "_CELLS", 1)
    found = repaired(source)
    assert found.frames == at_once.frames > len(KINDS)
    np.testing.assert_array_equal(found.pose.keypoints, at_once.pose.keypoints)
    np.testing.assert_array_equal(found.pose.scores, at_once.pose.scores)


def test_frozen_and_doubled_frames_and_a_clock_that_stands_still_change_little() -> None:
    whole = Chain.from_settings(load_settings("modern", environment={}))
    clean = whole(pose(moving()))
    frozen = moving()
    frozen[[7, 20, 21]] = frozen[[6, 19, 19]]
    found = whole(pose(frozen))
    assert np.abs(found.values - clean.values).max() < 0.2 * np.abs(clean.values).max()
    order = np.sort([*range(40), 12, 30])
    twice = pose(moving()[order])
    again = whole(replace(twice, times=np.arange(40)[order] / 25))
    assert len(again) == len(clean)
    assert np.abs(again.values - clean.values).max() < 0.2 * np.abs(clean.values).max()


def test_it_can_be_switched_off_and_the_paper_has_none() -> None:
    points = moving()
    jump(points, [20])
    modern = load_settings("modern", environment={})
    off = modern.with_values([("signals.repair", "false")])
    assert Chain.from_settings(modern)(pose(points)).repaired == pytest.approx(1 / 40)
    assert Chain.from_settings(off)(pose(points)).repaired == 0
    assert not load_settings("paper", environment={}).signals.repair


def test_a_body_without_scale_or_frames_passes() -> None:
    points = np.full((10, 18, 2), np.nan)
    points[:, J["nose"]] = 5
    for source in (pose(points), pose(standing(2)), pose(standing(0))):
        assert repaired(source).pose is source


def test_missing_joints_hide_no_jump() -> None:
    points = standing()
    points[[18, 20], J["right_wrist"]] = np.nan
    points[19, J["right_wrist"]] += 2 * TORSO
    points[::3, J["left_wrist"]] = np.nan
    found = repaired(pose(points))
    assert not found.pose.seen[18:21, J["right_wrist"]].any()
    assert found.frames == 1


def test_a_prediction_says_where_many_frames_were_repaired() -> None:
    points = {label: moving() for label in ("up", "few", "many")}
    swap("wrist")(points["few"], [20])
    swap("wrist")(points["many"], [5, 6, 7, 20, 21, 30])
    classifier = GestureClassifier("modern", kernel="numpy").fit(
        [pose(points["up"]), pose(waving("left_elbow"))], ["a", "b"]
    )
    few, many = classifier.predictions([pose(points["few"]), pose(points["many"])])
    assert (few.label, few.note) == ("a", "")
    assert many.label == "a" and "repaired in 15% of the frames" in many.note


def test_a_reading_far_from_all_others_is_left_out_and_a_movement_is_not() -> None:
    clock = np.arange(150) / 50
    quiet = np.random.default_rng(3).normal(0, 0.02, 150)
    whole = np.stack(
        [np.sin(9 * clock), quiet + 9.8, np.zeros(150), quiet + np.exp(-((clock - 1) ** 2) * 900)], 1
    )
    assert not readings_apart(whole).any(), "a swing, gravity, a channel that stands still, a tap"
    for value in (100.0, -1e9, 32767.0):
        for places in ([0], [149], [30, 31], [20, 75, 110]):
            wrong = whole.copy()
            wrong[places, :2] = value
            expected = np.zeros(whole.shape, bool)
            expected[places, :2] = True
            np.testing.assert_array_equal(readings_apart(wrong), expected)
    wrong = whole.copy()
    wrong[40:43, 0] = 500.0
    assert not readings_apart(wrong)[:, 0].any(), "three in a row are a movement"
    wrong[:, 1] = np.nan
    assert not readings_apart(wrong)[:, 1].any() and not readings_apart(wrong[:1]).any()


@pytest.mark.parametrize(("rate", "seconds"), [(25, 10), (50, 5), (200, 2)])
def test_a_tap_that_rings_is_no_failed_reading(rate: int, seconds: int) -> None:
    values = np.random.default_rng(1).normal(0, 0.01, (rate * seconds, 3))
    values[50:58] += 3 * np.array([1, -0.5, 0.2, -0.1, 0.06, -0.04, 0.03, 0.02])[:, None]
    assert not readings_apart(values).any()


def test_a_tap_of_one_sample_is_felt_by_several_channels_and_a_failed_packet_says_one_number() -> None:
    still = np.random.default_rng(1).normal([0, 0, 9.8, 0, 0, 0], 0.01, (150, 6))
    two = [[9, 4, -2, 30, 5, 0], [-3, -1, 1, 9, -2, 0]]
    for tap in ([[3, -5, 2, 0, 0, 0]], [[1, 16, -16, 8, 2, 0]], two):
        felt = still.copy()
        felt[60 : 60 + len(tap)] += tap
        assert not readings_apart(felt).any()
    for failed in (32767.0, [32767, -32768, 32767, 250, 250, 250], [0, 500, 0, 0, 0, 0]):
        wrong = still.copy()
        wrong[60] = np.where(np.asarray(failed) == 0, wrong[60], failed)
        assert readings_apart(wrong)[60].sum() in (1, 6) and readings_apart(wrong).sum() in (1, 6)


def test_one_failed_reading_does_not_decide_a_recording() -> None:
    clock = np.arange(100) / 50
    series = [np.stack([np.sin(f * clock), np.cos(f * clock)], 1) for f in (6, 6.2, 13, 13.4)]
    classifier = GestureClassifier("sensors", "numpy").fit(series, ["slow", "slow", "fast", "fast"])
    wrong = [item.copy() for item in series]
    for item in wrong:
        item[50] = 32767
    assert classifier.predict(wrong).tolist() == ["slow", "slow", "fast", "fast"]
    note = classifier.predictions(wrong)[0].note
    assert note == "readings far from all others of their channel, left out: 2 (signals.repair)"
    assert classifier.fit(wrong, ["slow", "slow", "fast", "fast"]).predict(series).tolist()[::3] == [
        "slow",
        "fast",
    ]
