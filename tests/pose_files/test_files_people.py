"""People in folders of OpenPose JSON: told apart, carried on, of every scale."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from frames import frame_name, person, write_frame
from gesture_pose_files.openpose_json import OpenPoseJsonReader

from gesture_core.plugin.reading import ReadOptions


def _crossing(folder: Path, frames: int = 40) -> None:
    """Two people who walk towards and past each other, in random order in the file; one is away twice."""
    rng = np.random.default_rng(1)
    left, right = person(18, (0, 0), seed=1), person(18, (0, 0), seed=2)
    for number in range(frames):
        people = [left + np.array([number * 10, 0, 0]), right + np.array([600 - number * 10, 150, 0])]
        if number % 13 == 5:
            people = people[:1]
        write_frame(folder, "clip", number, [people[index] for index in rng.permutation(len(people))])


def test_people_keep_their_number(tmp_path: Path) -> None:
    _crossing(tmp_path)
    found = OpenPoseJsonReader(people="multi").read(tmp_path)
    assert [sequence.person for sequence in found] == [0, 1] and {len(s) for s in found} == {40}
    steps = [np.nanmedian(np.diff(sequence.keypoints[:, 0, 0])) for sequence in found]
    assert sorted(np.sign(steps)) == [-1, 1]
    for sequence in found:
        seen = sequence.keypoints[~np.isnan(sequence.keypoints[:, 0, 0]), 0, 1]
        assert np.ptp(seen) < 1  # nobody ever takes the other's place
    assert found[0].frames_with_pose == 40 and found[1].frames_with_pose == 37


def test_single_takes_the_most_persistent_person(tmp_path: Path) -> None:
    _crossing(tmp_path)
    (sequence,) = OpenPoseJsonReader().read(tmp_path)
    assert sequence.frames_with_pose == 40
    assert np.nanmedian(np.diff(sequence.keypoints[:, 0, 0])) > 0


def test_shares_of_the_picture_are_tracked_too(tmp_path: Path) -> None:
    """OpenPose can write coordinates in 0..1 (keypoint_scale 3)."""
    for number in range(20):
        people = [person(25, (0.1, 0.1), 0.2, 1), person(25, (0.7, 0.1), 0.2, 2)]
        write_frame(tmp_path, "clip", number, people[:: 1 if number % 2 else -1])
    found = OpenPoseJsonReader(people="multi").read(tmp_path)
    assert len(found) == 2
    assert all(np.ptp(sequence.keypoints[:, 0], axis=0).max() < 1e-3 for sequence in found)


@pytest.mark.parametrize(("scale", "factor", "offset"), [(3, 1, 0), (4, 2, -1)])
def test_every_scale_of_openpose_is_the_same_body(
    tmp_path: Path, scale: int, factor: float, offset: float
) -> None:
    """Shares of width and height become one unit again; scale 4 puts a missing joint at -1, -1, 0."""
    size = np.array([640, 480])
    pixels, shares = tmp_path / "pixels", tmp_path / "shares"
    pixels.mkdir()
    shares.mkdir()
    for number in range(6):
        body = person(18, (200 + number, 100), 150)
        body[number] = 0
        write_frame(pixels, "clip", number, [body])
        body[:, :2] = body[:, :2] / size * factor + offset
        write_frame(shares, "clip", number, [body])
    (wanted,), (found,) = (OpenPoseJsonReader().read(folder) for folder in (pixels, shares))
    np.testing.assert_array_equal(found.seen, wanted.seen)
    assert not found.seen.diagonal().any()
    expected = wanted.keypoints * factor + offset * size
    np.testing.assert_allclose(found.keypoints, expected, atol=0.1)  # four digits in the file
    assert found.provenance["assumed"] == "unit=shares, frame_size=640x480, fps=30"
    assert wanted.provenance["assumed"] == "unit=pixels, fps=30"
    (wide,) = OpenPoseJsonReader(ReadOptions(frame_size=(1920, 1080))).read(shares)
    np.testing.assert_allclose(wide.keypoints, found.keypoints * [3, 2.25], rtol=1e-5)


def test_a_person_who_comes_back_to_the_same_place_is_carried_on(tmp_path: Path) -> None:
    for number in range(80):
        here = [person(18, (100, 100), seed=1)] if not 30 <= number < 60 else []
        far = [person(18, (900, 100), seed=2)] if number < 8 else []
        write_frame(tmp_path, "clip", number, here + far)
    (sequence,) = OpenPoseJsonReader().read(tmp_path)
    assert sequence.frames_with_pose == 50
    assert np.nanmax(sequence.keypoints[..., 0]) < 300


def test_people_keep_the_number_that_the_file_gives_them(tmp_path: Path) -> None:
    """Two people change places in one frame; where both are numbered, nobody is taken for the other."""
    for number in range(6):
        people = []
        for identity in (4, 9):
            at = 500 if (identity == 4) == (number < 3) else 0
            joints = person(18, (at, 0), seed=identity).reshape(-1).tolist()
            people.append({"person_id": [identity], "pose_keypoints_2d": joints})
        (tmp_path / frame_name("c", number)).write_text(json.dumps({"people": people[:: (-1) ** number]}))
    one, two = OpenPoseJsonReader(people="multi").read(tmp_path)
    for sequence in (one, two):
        assert sequence.frames_with_pose == 6
        assert abs(sequence.keypoints[2, 0, 0] - sequence.keypoints[3, 0, 0]) == pytest.approx(500, abs=1e-2)


@pytest.mark.parametrize("count", [32, 33])
def test_a_crowd_that_is_not_read_whole_is_said(tmp_path: Path, count: int) -> None:
    one = person(18, (0, 0))
    for number in range(3):
        write_frame(tmp_path, "clip", number, [one + np.array([300 * at, 0, 0]) for at in range(count)])
    found = OpenPoseJsonReader(people="multi").read(tmp_path)
    note = found[0].provenance.get("notes", "")
    assert len(found) == 32 and (note == "of 33 people the 32 best seen are read") == (count > 32)
