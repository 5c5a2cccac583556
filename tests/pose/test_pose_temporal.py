"""Limbs are chosen for all frames together: swaps, false peaks, gaps; what is right stays as it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_networks import FIGURE

from gesture_core.plugin.interfaces import Person
from gesture_core.pose.extract import extract_poses
from gesture_core.pose.follow import Window
from gesture_core.pose.temporal import JointChoice
from gesture_core.skeletons import COCO17, COCO18, MPI15, SKELETONS, Skeleton

RIGHT, LEFT = [2, 3, 4, 8, 9, 10], [5, 6, 7, 11, 12, 13]


def waving(frames: int = 30, size: float = 300, jitter: float = 0.0, seed: int = 0) -> np.ndarray:
    """(T, 18, 2) a standing figure that waves its right arm."""
    points = np.repeat(FIGURE[None] * size, frames, axis=0)
    angle = 0.8 * np.sin(np.arange(frames) / 4)
    points[:, 4, 0] -= size * 0.1 * np.sin(angle)
    points[:, 4, 1] -= size * 0.28 * np.cos(angle)
    return points + np.random.default_rng(seed).normal(0, jitter, points.shape)


def peaks_of(choice: JointChoice, points: np.ndarray, score: float = 0.7) -> np.ndarray:
    people = [Person(one, np.where(np.isnan(one[:, 0]), 0, score)) for one in points]
    return np.stack([choice.peaks_of(person) for person in people])


def chosen(
    points: np.ndarray,
    peaks: np.ndarray | None = None,
    *,
    scores: np.ndarray | None = None,
    step: float = 0.05,
) -> tuple[np.ndarray, np.ndarray]:
    choice = JointChoice(COCO18)
    peaks = peaks_of(choice, points) if peaks is None else peaks
    scores = np.where(np.isnan(points[..., 0]), 0, 0.7) if scores is None else scores
    return choice.choose(points, scores, peaks, np.arange(len(points)) * step)


@given(st.integers(0, 2**32 - 1), st.floats(40, 900), st.sampled_from([0.02, 0.04, 0.1]), st.integers(1, 40))
def test_what_is_right_stays_as_it_is(seed: int, size: float, step: float, frames: int) -> None:
    points = waving(frames, size, 0.01 * size, seed).astype(np.float32)
    found, scores = chosen(points, step=step)
    np.testing.assert_array_equal(found, points)
    assert (scores == np.float32(0.7)).all()


@pytest.mark.parametrize("frames", [[10], [10, 11, 12, 13], [0, 1], [28, 29], [3, 9, 10, 20]])
@pytest.mark.parametrize(
    "joints", [(RIGHT, LEFT), ([2, 3, 4], [5, 6, 7]), ([3], [6]), ([8, 9, 10], [11, 12, 13]), ([9], [12])]
)
def test_left_and_right_that_change_places_are_put_back(
    frames: list[int], joints: tuple[list[int], list[int]]
) -> None:
    truth = waving().astype(np.float32)
    seen = truth.copy()
    for frame in frames:
        seen[frame, joints[0]], seen[frame, joints[1]] = truth[frame, joints[1]], truth[frame, joints[0]]
    found, _ = chosen(seen)
    np.testing.assert_array_equal(found, truth)


def test_scores_go_with_their_joints() -> None:
    truth = waving().astype(np.float32)
    seen, scores = truth.copy(), np.full((30, 18), 0.5, np.float32)
    scores[:, RIGHT] = 0.9
    seen[10, RIGHT], seen[10, LEFT] = truth[10, LEFT], truth[10, RIGHT]
    scores[10, RIGHT], scores[10, LEFT] = 0.5, 0.9
    choice = JointChoice(COCO18)
    people = [Person(one, score) for one, score in zip(seen, scores, strict=True)]
    peaks = np.stack([choice.peaks_of(person) for person in people])
    _, put_back = choice.choose(seen, scores, peaks, np.arange(30) / 20)
    assert (put_back[:, RIGHT] == np.float32(0.9)).all() and (put_back[:, LEFT] == 0.5).all()


def test_a_person_who_turns_round_is_left_alone() -> None:
    """The shoulders pass behind each other, which takes time; then the left one is on the left."""
    truth = waving(40)
    turn = np.cos(np.linspace(0, np.pi, 40))[:, None]
    middle = truth[:, :, 0].mean(axis=1, keepdims=True)
    truth[:, :, 0] = middle + (truth[:, :, 0] - middle) * turn
    truth = truth.astype(np.float32)
    scores = np.full((40, 18), 0.7, np.float32)
    scores[turn[:, 0] < 0, 0] = 0.0  # no nose is seen from behind
    found, _ = chosen(truth, scores=scores)
    np.testing.assert_array_equal(found, truth)


def test_most_of_a_clip_swapped_is_put_right_by_the_face() -> None:
    truth = waving().astype(np.float32)
    seen = truth.copy()
    seen[3:27, RIGHT], seen[3:27, LEFT] = truth[3:27, LEFT], truth[3:27, RIGHT]
    found, _ = chosen(seen)
    np.testing.assert_array_equal(found, truth)


def test_maps_that_show_both_sides_are_put_right_too() -> None:
    """A network in doubt has a peak at both wrists in both maps, the wrong one a little higher."""
    truth = waving().astype(np.float32)
    choice = JointChoice(COCO18)
    seen, scores = truth.copy(), np.full((30, 18), 0.5, np.float32)
    scores[:20, 0] = 0.0  # and no face in the frames that are wrong
    frames = np.flatnonzero(np.arange(30) < 20)[:, None]  # which are wrong
    seen[frames, RIGHT + LEFT] = truth[frames, LEFT + RIGHT]
    peaks = peaks_of(choice, seen, 0.5)
    across = {4: 7, 7: 4, 3: 6, 6: 3, 9: 12, 12: 9, 10: 13, 13: 10}
    for i, joint in enumerate(choice.joints):
        peaks[:, i, 1, :2], peaks[:, i, 1, 2] = seen[:, across[joint]], 0.3
    found, _ = chosen(seen, peaks, scores=scores)
    np.testing.assert_array_equal(found, truth)


def test_the_second_peak_is_taken_where_the_first_leaves_the_body() -> None:
    truth = waving().astype(np.float32)
    choice = JointChoice(COCO18)
    peaks = peaks_of(choice, truth, 0.5)
    wrist = choice.joints.index(4)
    seen = truth.copy()
    for frame in (5, 6, 15, 16, 17):
        far = truth[frame, 4] + (250, -200)
        peaks[frame, wrist, 1] = peaks[frame, wrist, 0]
        peaks[frame, wrist, 0] = (*far, 0.6)
        seen[frame, 4] = far
    found, scores = chosen(seen, peaks)
    np.testing.assert_array_equal(found, truth)
    assert scores[5, 4] == 0.5


def test_a_low_peak_stands_in_for_a_joint_that_was_missing() -> None:
    truth = waving().astype(np.float32)
    choice = JointChoice(COCO18)
    peaks = peaks_of(choice, truth)
    peaks[7, choice.joints.index(7), 0, 2] = 0.06
    seen = truth.copy()
    seen[7, 7] = np.nan
    found, scores = chosen(seen, peaks)
    np.testing.assert_array_equal(found, truth)
    assert scores[7, 7] == np.float32(0.06)


def test_missing_joints_stay_missing_and_nobody_stays_nobody() -> None:
    points = waving().astype(np.float32)
    points[5:8] = np.nan
    points[:, [10, 13]] = np.nan
    points[12, 4] = np.nan
    found, scores = chosen(points)
    np.testing.assert_array_equal(found, points)
    assert (scores[np.isnan(found[..., 0])] == 0).all()
    empty = np.full((4, 18, 2), np.nan, np.float32)
    np.testing.assert_array_equal(chosen(empty)[0], empty)
    none = np.zeros((0, 8, 3, 3), np.float32)
    assert chosen(empty[:0], none)[0].shape == (0, 18, 2)


def test_equal_times_and_one_frame_are_survived() -> None:
    points = waving(6).astype(np.float32)
    np.testing.assert_array_equal(chosen(points, step=0.0)[0], points)
    np.testing.assert_array_equal(chosen(points[:1])[0], points[:1])


def test_blocks_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(3)
    points = waving(50, jitter=3.0).astype(np.float32)
    swapped = np.flatnonzero(random.random(50) < 0.3)[:, None]
    points[swapped, RIGHT + LEFT] = points[swapped, LEFT + RIGHT]
    whole = chosen(points)
    monkeypatch.setattr("gesture_core.pose.temporal._BLOCK", 7)
    for one, two in zip(whole, chosen(points), strict=True):
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize(
    "body", [s for s in SKELETONS.values() if s.group("body")], ids=lambda body: body.name
)
def test_every_skeleton_has_its_limbs(body: Skeleton) -> None:
    joints = {body.joints[j] for j in JointChoice(body).joints}
    assert joints == {
        f"{side}_{part}" for side in ("left", "right") for part in ("elbow", "wrist", "knee", "ankle")
    }


def test_the_peaks_of_a_person_are_kept_or_made() -> None:
    choice = JointChoice(COCO17)
    points, scores = np.arange(34.0).reshape(17, 2), np.linspace(0.1, 0.9, 17)
    plain = choice.peaks_of(Person(points, scores))
    assert plain.shape == (8, 3, 3) and np.isnan(plain[:, 1:, :2]).all() and (plain[:, 1:, 2] == 0).all()
    np.testing.assert_allclose(plain[:, 0, :2], points[choice.joints])
    peaks = np.random.default_rng(0).random((17, 4, 3)).astype(np.float32)
    seen = Person(points, scores, peaks)
    np.testing.assert_array_equal(choice.peaks_of(seen), peaks[choice.joints, :3])
    aside = Window(10, 20, 30, 40).back(seen)
    assert aside.peaks is not None
    np.testing.assert_allclose(aside.peaks - peaks, np.broadcast_to((10, 20, 0), peaks.shape), atol=1e-5)
    assert np.isnan(choice.peaks_of(None)[..., :2]).all()


class Swapping:
    """A backend that confuses left and right in every fourth frame."""

    skeleton = MPI15.name
    batch_size = 3

    def __init__(self, truth: np.ndarray) -> None:
        self.truth = truth
        self.frame = 0

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        found = []
        for _ in frames:
            points = self.truth[self.frame]
            if self.frame % 4 == 3:
                points = points[list(MPI15.mirror)]
            found.append([Person(points, np.full(15, 0.8))])
            self.frame += 1
        return found


def test_extraction_puts_swaps_back_unless_told_not_to() -> None:
    truth = waving()[:, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 1]].astype(np.float32)
    frames = [(t / 20, np.zeros((320, 320, 3), np.uint8)) for t in range(30)]
    (pose,) = extract_poses(frames, Swapping(truth))
    np.testing.assert_array_equal(pose.keypoints, truth)
    assert pose.provenance["steady"] == "True"
    (raw,) = extract_poses(frames, Swapping(truth), steady=False)
    assert raw.provenance["steady"] == "False"
    np.testing.assert_array_equal(raw.keypoints[3], truth[3][list(MPI15.mirror)])
