"""Folders of OpenPose JSON: versions, skeletons, several sequences, several people, refusals."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from frames import frame_name, frame_text, person, write_frame
from gesture_pose_files.json_text import MAX_DEPTH
from gesture_pose_files.openpose_json import OpenPoseJsonReader

from gesture_core.errors import ConfigError, KeypointError
from gesture_core.plugin import registry
from gesture_core.plugin.reading import ReadOptions

NAMES = {15: "mpi15", 18: "coco18", 25: "body25"}


def code_of(folder: Path, member: str = "") -> str:
    with pytest.raises(KeypointError) as caught:
        OpenPoseJsonReader().read(folder, member)
    assert caught.value.subject and caught.value.code.startswith("E_KEYPOINTS_")
    return caught.value.code


@pytest.mark.parametrize("joints", NAMES)
@pytest.mark.parametrize(
    ("version", "key"),
    [
        (0.1, "pose_keypoints"),
        (1.0, "pose_keypoints"),
        (1.2, "pose_keypoints_2d"),
        (1.3, "pose_keypoints_2d"),
    ],
)
def test_every_version_and_skeleton(tmp_path: Path, joints: int, version: float, key: str) -> None:
    body = person(joints, (50, 60))
    body[2] = 0  # not found
    for number in range(6):
        write_frame(tmp_path, "clip", number, [body + [number, 0, 0] * (body != 0)], key=key, version=version)
    (sequence,) = OpenPoseJsonReader().read(tmp_path)
    assert sequence.skeleton == NAMES[joints] and len(sequence) == 6
    assert not sequence.seen[:, 2].any() and sequence.seen.sum() == 6 * (joints - 1)
    np.testing.assert_allclose(sequence.keypoints[4, 0], body[0, :2] + [4, 0], atol=1e-3)
    np.testing.assert_allclose(sequence.scores[:, 3], body[3, 2], atol=1e-4)
    np.testing.assert_allclose(sequence.times, np.arange(6) / 30)


def test_numbers_are_times_and_gaps_stay_gaps(tmp_path: Path) -> None:
    for number in (10, 11, 15, 30):
        write_frame(tmp_path, "clip", number, [person(18, (0, 0))])
    (sequence,) = OpenPoseJsonReader(ReadOptions(fps=10)).read(tmp_path)
    np.testing.assert_allclose(sequence.times, [1.0, 1.1, 1.5, 3.0])


def test_empty_frames_stay_as_frames(tmp_path: Path) -> None:
    for number in range(5):
        write_frame(tmp_path, "clip", number, [person(25, (0, 0))] if number % 2 else [])
    (sequence,) = OpenPoseJsonReader().read(tmp_path)
    assert len(sequence) == 5 and sequence.frames_with_pose == 2


def test_a_folder_where_nobody_is_ever_seen_is_a_sequence(tmp_path: Path) -> None:
    for number in range(3):
        write_frame(tmp_path, "clip", number, [])
    for people in ("single", "multi"):
        (sequence,) = OpenPoseJsonReader(people=people).read(tmp_path)
        assert len(sequence) == 3 and sequence.frames_with_pose == 0


def test_sequences_of_one_folder_are_told_apart_by_name(tmp_path: Path) -> None:
    for name, count in (("b_clip", 2), ("a", 3), ("caf\udce9", 1)):
        for number in range(count):
            write_frame(tmp_path, name, number, [person(18, (0, 0))])
    (tmp_path / "notes.txt").write_text("not a frame")
    (tmp_path / "a_keypoints.json").write_text("{}")
    reader = OpenPoseJsonReader()
    assert reader.accepts(tmp_path)
    assert reader.members(tmp_path) == ["a", "b_clip", "caf\udce9"]
    assert [len(reader.read(tmp_path, name)[0]) for name in reader.members(tmp_path)] == [3, 2, 1]
    assert code_of(tmp_path) == "E_KEYPOINTS_MEMBER"
    assert code_of(tmp_path, "c") == "E_KEYPOINTS_MEMBER"


def test_only_folders_with_frames_are_accepted(tmp_path: Path) -> None:
    reader = OpenPoseJsonReader()
    assert not reader.accepts(tmp_path)
    assert not reader.accepts(tmp_path / "absent")
    path = write_frame(tmp_path, "x", 0, [])
    assert not reader.accepts(path)
    assert reader.accepts(tmp_path) and reader.members(tmp_path) == [""]
    assert code_of(path) == "E_KEYPOINTS_UNREADABLE"
    (tmp_path / "sub").mkdir()
    assert code_of(tmp_path / "sub") == "E_KEYPOINTS_EMPTY"


BAD_FRAMES = {
    "nothing": (b"", "E_KEYPOINTS_EMPTY"),
    "not json": (b"{people: 1}", "E_KEYPOINTS_JSON"),
    "cut off": (b'{"version":1.2,"people":[{"pose_keyp', "E_KEYPOINTS_JSON"),
    "not utf-8": (b'{"people": "\xff\xfe"}', "E_KEYPOINTS_JSON"),
    "deep": (b"[" * 100_000, "E_KEYPOINTS_JSON"),
    "deep object": (b'{"a":' * 5000 + b"1" + b"}" * 5000, "E_KEYPOINTS_JSON"),
    "another kind": (b'{"a": 1}', "E_KEYPOINTS_FORMAT"),
    "a list": (b"[1, 2]", "E_KEYPOINTS_FORMAT"),
    "people of no kind": (b'{"people": [1]}', "E_KEYPOINTS_FORMAT"),
    "no keypoints": (b'{"people": [{}]}', "E_KEYPOINTS_FORMAT"),
    "odd count": (b'{"people": [{"pose_keypoints_2d": [1, 2, 3, 4]}]}', "E_KEYPOINTS_FORMAT"),
    "infinity": (b'{"people": [{"pose_keypoints_2d": [' + b"Infinity," * 53 + b"1]}]}", "E_KEYPOINTS_JSON"),
    "infinite": (b'{"people": [{"pose_keypoints_2d": [' + b"1e999," * 53 + b"1]}]}", "E_KEYPOINTS_VALUE"),
    "too large": (b'{"people": [{"pose_keypoints_2d": [' + b"1e30," * 53 + b"1]}]}", "E_KEYPOINTS_VALUE"),
    "thousand digits": (
        b'{"people": [{"pose_keypoints_2d": [' + b"9" * 1000 + b"," + b"1," * 52 + b"1]}]}",
        "E_KEYPOINTS_VALUE",
    ),
    "million digits": (b'{"people": [' + b"9" * 1_000_000 + b"]}", "E_KEYPOINTS_JSON"),
    "text": (b'{"people": [{"pose_keypoints_2d": [' + b'"1",' * 53 + b'"1"]}]}', "E_KEYPOINTS_VALUE"),
    "truth": (b'{"people": [{"pose_keypoints_2d": [' + b"true," * 53 + b"true]}]}", "E_KEYPOINTS_VALUE"),
    "huge": (b" " * (5 << 20), "E_KEYPOINTS_LIMIT"),
}


@pytest.mark.parametrize("kind", BAD_FRAMES)
def test_a_bad_frame_costs_itself_and_names_its_file(tmp_path: Path, kind: str) -> None:
    data, code = BAD_FRAMES[kind]
    for number in range(6):
        write_frame(tmp_path, "clip", number, [person(18, (number, 0))])
    for number in (2, 5):
        (tmp_path / frame_name("clip", number)).write_bytes(data)
    (sequence,) = OpenPoseJsonReader().read(tmp_path)
    assert sequence.seen.any(axis=1).tolist() == [True, True, False, True, True, False]
    np.testing.assert_allclose(sequence.times, np.arange(6) / 30)
    lost = sequence.provenance["lost"]
    assert lost.startswith("2 of 6 frames cannot be read: ") and frame_name("clip", 2) in lost
    for number in range(6):
        (tmp_path / frame_name("clip", number)).write_bytes(data)
    with pytest.raises(KeypointError) as caught:
        OpenPoseJsonReader().read(tmp_path)
    assert caught.value.code == code and frame_name("clip", 0) in caught.value.subject


def test_skeletons_may_not_change(tmp_path: Path) -> None:
    for number in range(12):
        write_frame(tmp_path, "clip", number, [person(18 if number < 11 else 25, (0, 0))])
    (sequence,) = OpenPoseJsonReader().read(tmp_path)
    assert sequence.skeleton == "coco18" and sequence.frames_with_pose == 11
    assert "frame 11 has 25 joints, others have 18" in sequence.provenance["lost"]
    write_frame(tmp_path, "clip", 10, [person(25, (0, 0))])
    assert code_of(tmp_path) == "E_KEYPOINTS_FORMAT"


NAMES_OF_FRAMES = {
    "image_{:05d}_keypoints.json": "image",
    "{:04d}_keypoints.json": "",
    "frame{}_keypoints.json": "frame",
    "{:012d}_keypoints.json": "",
    "clip_{:012d}.json": "clip",
    "{}.json": "",
    "a.b-{:03d}.JSON": "a.b",
    "S01_20240301_{:06d}_pose.json": "S01_20240301",
}


@pytest.mark.parametrize("form", NAMES_OF_FRAMES)
def test_every_way_of_numbering(tmp_path: Path, form: str) -> None:
    """Frames 7 to 12 come in the order of their numbers, which is not that of their names."""
    for number in range(7, 13):
        text = frame_text([person(25, (number, 0))])
        (tmp_path / form.format(number)).write_text(text)
    reader = OpenPoseJsonReader(ReadOptions(fps=10))
    assert reader.accepts(tmp_path) and reader.members(tmp_path) == [""]
    (sequence,) = reader.read(tmp_path)
    np.testing.assert_allclose(sequence.times, np.arange(7, 13) / 10)
    np.testing.assert_allclose(np.diff(sequence.keypoints[:, 0, 0]), 1, atol=1e-3)
    (tmp_path / "other_000000000000_keypoints.json").write_text(frame_text([]))
    assert reader.members(tmp_path) == sorted([NAMES_OF_FRAMES[form], "other"])
    assert len(reader.read(tmp_path, NAMES_OF_FRAMES[form])[0]) == 6


def test_one_number_twice_is_two_clips(tmp_path: Path) -> None:
    for name in ("a_1_keypoints.json", "a_01_keypoints.json"):
        (tmp_path / name).write_text(frame_text([person(18, (0, 0))]))
    assert code_of(tmp_path) == "E_KEYPOINTS_FORMAT"


def test_numbers_that_are_time_stamps_are_refused(tmp_path: Path) -> None:
    for number in range(5):
        (tmp_path / f"{1_700_000_000_000 + 33 * number}.json").write_text(frame_text([person(18, (0, 0))]))
    assert code_of(tmp_path) == "E_KEYPOINTS_TIMES"
    assert len(OpenPoseJsonReader(ReadOptions(fps=1000)).read(tmp_path)[0]) == 5


@pytest.mark.parametrize(
    "text",
    [
        '[{"image_id": "0.jpg", "keypoints": [1, 2, 3]}]',
        '[{"frame_id": 0, "instances": [{"keypoints": [], "keypoint_scores": []}]}]',
        '{"images": [], "annotations": [{"keypoints": []}]}',
        '{"name": "a tool", "version": 1}',
        "[]",
    ],
)
def test_numbered_json_of_another_kind_is_no_frame(tmp_path: Path, text: str) -> None:
    for number in range(3):
        (tmp_path / f"wave_{number}.json").write_text(text)
    assert not OpenPoseJsonReader().accepts(tmp_path)


@pytest.mark.parametrize(
    ("joints", "used", "kind"),
    [(17, 17, "coco17"), (26, 26, "halpe26"), (133, 17, "coco17"), (136, 26, "halpe26"), (137, 25, "body25")],
)
def test_other_networks_in_openpose_frames(tmp_path: Path, joints: int, used: int, kind: str) -> None:
    body = person(joints, (50, 60))
    for number in range(3):
        write_frame(tmp_path, "clip", number, [body])
    (sequence,) = OpenPoseJsonReader().read(tmp_path)
    assert sequence.skeleton == kind
    assert (f"order={kind}" in sequence.provenance["assumed"]) == (kind != "body25"), "OpenPose's own order"
    np.testing.assert_allclose(sequence.keypoints[1], body[:used, :2], atol=1e-3)


def test_people_as_one_object_nan_and_null_are_missing_joints(tmp_path: Path) -> None:
    values: list[object] = [round(float(value), 3) for value in person(18, (5, 5)).reshape(-1)]
    values[3:6] = [math.nan, math.nan, 0.9]
    values[6:9] = [None, None, None]
    for number in range(3):
        (tmp_path / frame_name("c", number)).write_text(json.dumps({"people": {"pose_keypoints_2d": values}}))
    (sequence,) = OpenPoseJsonReader().read(tmp_path)
    assert sequence.seen.sum(axis=1).tolist() == [16, 16, 16] and "lost" not in sequence.provenance
    assert not sequence.seen[:, 1:3].any()


def ultralytics(body: np.ndarray) -> object:
    points = {"x": body[:, 0].tolist(), "y": body[:, 1].tolist(), "visible": body[:, 2].tolist()}
    return [{"name": "person", "class": 0, "box": {"x1": 1.0}, "track_id": 1, "keypoints": points}]


def mmpose(body: np.ndarray) -> object:
    scores = body[:, 2].tolist()
    return [{"keypoints": body[:, :2].tolist(), "keypoint_scores": scores, "bbox": [[0, 0, 1, 1]]}]


def alphapose(body: np.ndarray) -> object:
    return {"version": "AlphaPose v0.3", "bodies": [{"joints": body.reshape(-1).tolist()}]}


@pytest.mark.parametrize("draw", [ultralytics, mmpose, alphapose])
def test_frames_of_other_tools(tmp_path: Path, draw: Callable[[np.ndarray], object]) -> None:
    bodies = [person(17, (3 * number, 50)) for number in range(11)]
    for number, body in enumerate(bodies):
        (tmp_path / f"clip_{number}.json").write_text(json.dumps(draw(body)))
    assert OpenPoseJsonReader().accepts(tmp_path)
    (sequence,) = OpenPoseJsonReader().read(tmp_path)
    assert sequence.skeleton == "coco17"
    np.testing.assert_allclose(sequence.keypoints, np.array(bodies)[..., :2], rtol=1e-5)
    np.testing.assert_allclose(sequence.scores, np.array(bodies)[..., 2], rtol=1e-5)


def test_hands_are_noted_where_there_are_any(tmp_path: Path) -> None:
    for number, hand in enumerate(([], [0] * 63, [1, 2, 0.5] * 21)):
        one = {"pose_keypoints_2d": person(25, (0, 0)).reshape(-1).tolist(), "hand_left_keypoints_2d": hand}
        (tmp_path / frame_name("c", number)).write_text(json.dumps({"people": [one]}))
    assert (
        OpenPoseJsonReader().read(tmp_path)[0].provenance["notes"].startswith("hands and face are not used")
    )
    (tmp_path / frame_name("c", 2)).unlink()
    assert OpenPoseJsonReader().read(tmp_path)[0].provenance["notes"] == "feet: read and not compared"


def test_depth_within_the_limit_is_read(tmp_path: Path) -> None:
    extra: object = 1
    for _ in range(MAX_DEPTH - 2):
        extra = [extra]
    (tmp_path / frame_name("c", 0)).write_text(
        json.dumps({"people": [], "note": "[[[[" * 20, "extra": extra})
    )
    assert len(OpenPoseJsonReader().read(tmp_path)[0]) == 1


def test_links_are_followed_and_what_is_no_file_costs_its_frame(tmp_path: Path) -> None:
    """Archives that git-annex or DVC keep consist of links that lead out of the folder."""
    folder, outside = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    outside.mkdir()
    for number in range(3):
        kept = write_frame(outside, "clip", number, [person(18, (number, 0))])
        (folder / frame_name("clip", number)).symlink_to(kept)
    (sequence,) = OpenPoseJsonReader().read(folder)
    assert sequence.frames_with_pose == 3 and "lost" not in sequence.provenance
    (folder / frame_name("clip", 3)).symlink_to(outside / "gone.json")
    (folder / frame_name("clip", 4)).symlink_to(folder / frame_name("clip", 4))
    os.mkfifo(folder / frame_name("clip", 5))
    (sequence,) = OpenPoseJsonReader().read(folder)
    assert sequence.seen.any(axis=1).tolist() == [True] * 3 + [False] * 3
    assert sequence.provenance["lost"].startswith("3 of 6 frames cannot be read")


def test_options_are_checked() -> None:
    with pytest.raises(ConfigError):
        registry().make("reader", "openpose-json", people="all")


def test_the_real_folders(shared: Path) -> None:
    """2,409 frames of 14 sequences, 68 of them empty; compared with a plain reading."""
    reader = OpenPoseJsonReader()
    folders = sorted(path for path in (shared / "openpose_json").glob("*/*") if path.is_dir())
    frames = empty = 0
    for folder in folders:
        assert reader.accepts(folder) and reader.members(folder) == [""]
        (sequence,) = reader.read(folder)
        assert sequence.skeleton == "body25"
        frames, empty = frames + len(sequence), empty + len(sequence) - sequence.frames_with_pose
        for index, path in enumerate(sorted(folder.iterdir())):
            people = json.loads(path.read_bytes())["people"]
            if people and index % 7 == 0:
                raw = np.array(people[0]["pose_keypoints_2d"], np.float32).reshape(-1, 3)
                found = raw[:, 2] > 0
                np.testing.assert_array_equal(sequence.seen[index], found)
                np.testing.assert_array_equal(sequence.keypoints[index][found], raw[found, :2])
    assert (len(folders), frames, empty) == (14, 2409, 68)
