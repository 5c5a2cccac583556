"""Files that were read wrongly, or in part, without a word: each is read rightly now, or refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from gesture_pose_files.arrays import ArrayReader
from gesture_pose_files.csv_table import CsvReader
from gesture_pose_files.openpose_json import OpenPoseJsonReader
from tables import COCO17, COCO18, FRAMES, flat, named, person, read, refused, same, save

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.pose.plausible import check_plausible
from gesture_core.skeletons import BLAZEPOSE33


def lines(points: np.ndarray, *before: str) -> str:
    return "\n".join([*before, *(",".join(map(str, row)) for row in flat(points))]) + "\n"


# ------------------------------------------------------------------------------------ what is no coordinate


def test_a_frame_and_a_time_before_17_joints_are_not_18_joints(tmp_path: Path) -> None:
    points = person(COCO17.joints)
    rows = [f"{number},{number / 25}," + ",".join(map(str, row)) for number, row in enumerate(flat(points))]
    (tmp_path / "k.csv").write_text("\n".join(rows))
    (pose,) = read(tmp_path / "k.csv")
    assert pose.skeleton == "coco17"
    same(pose, points, COCO17.joints)
    np.testing.assert_allclose(pose.times, np.arange(FRAMES) / 25)


def test_a_frame_and_a_person_before_17_joints_are_refused(tmp_path: Path) -> None:
    rows = [
        f"{number},4," + ",".join(map(str, row)) for number, row in enumerate(flat(person(COCO17.joints)))
    ]
    (tmp_path / "k.csv").write_text("\n".join(rows))
    assert refused(tmp_path / "k.csv").code == "E_KEYPOINTS_FORMAT"


@pytest.mark.parametrize("form", ["3,1,{}", "{},3,1"])
def test_labels_beside_17_joints_are_not_18_joints(tmp_path: Path, form: str) -> None:
    rows = [form.format(",".join(map(str, row))) for row in flat(person(COCO17.joints))]
    (tmp_path / "k.csv").write_text("\n".join(rows))
    assert "two columns are 3, 1 in every row" in refused(tmp_path / "k.csv").cause


def test_names_that_python_takes_for_numbers_are_no_frame(tmp_path: Path) -> None:
    header = [f"{joint}_{axis}" for joint in range(17) for axis in (0, 1)]
    path = save(tmp_path / "k.csv", header, flat(person(COCO17.joints)))
    assert refused(path).code == "E_KEYPOINTS_FORMAT" and not CsvReader().accepts(path)


@pytest.mark.parametrize("nowhere", [-1.0, -9999.0])
def test_a_negative_number_in_the_place_of_x_and_y_is_a_missing_joint(tmp_path: Path, nowhere: float) -> None:
    wrist = COCO17.joints.index("left_wrist")
    points = person(COCO17.joints)
    points[2:9, wrist] = nowhere
    save(tmp_path / "k.csv", named(COCO17.joints), flat(points))
    np.save(tmp_path / "k.npy", points)
    np.save(tmp_path / "s.npy", np.dstack([points, np.where(points[..., 0] == nowhere, -1, 1)]))
    for (pose,) in (
        read(tmp_path / "k.csv"),
        ArrayReader().read(tmp_path / "k.npy"),
        ArrayReader().read(tmp_path / "s.npy"),
    ):
        assert not pose.seen[2:9, wrist].any() and pose.seen[9:, wrist].all()
    points[2, 0, 0] = -3  # a person who leaves the picture has negative coordinates of every size
    np.save(tmp_path / "k.npy", points)
    assert ArrayReader().read(tmp_path / "k.npy")[0].seen[2:9, wrist].all()


def test_percent(tmp_path: Path) -> None:
    points = person(COCO17.joints)
    np.save(tmp_path / "k.npy", points / (640, 480) * 100)
    (pose,) = ArrayReader().read(tmp_path / "k.npy")
    assert "--set keypoints.unit=shares where they are percent" in pose.provenance["notes"]
    (pose,) = ArrayReader(ReadOptions(unit="shares")).read(tmp_path / "k.npy")
    same(pose, points, COCO17.joints)


def test_columns_of_x_and_y_do_not_say_that_y_points_down(tmp_path: Path) -> None:
    points = person(COCO17.joints)
    save(tmp_path / "k.csv", named(COCO17.joints), flat(points * (1, -1) + (0, 480)))
    with pytest.raises(KeypointError, match=r"stands on its head.*keypoints\.axes=x-y"):
        check_plausible(read(tmp_path / "k.csv")[0])
    assert check_plausible(read(tmp_path / "k.csv", axes="xy")[0], axes_stated=True)
    (pose,) = read(tmp_path / "k.csv", axes="x-y")
    same(pose, points * (1, 1) - (0, 480), COCO17.joints)
    assert check_plausible(pose, axes_stated=True) == []


# --------------------------------------------------------------------------------------------- several clips


@pytest.mark.parametrize("column", ["video", "Clip ID", "sequence"])
@pytest.mark.parametrize("frame", ["frame,", ""])
def test_a_table_of_several_clips_is_refused(tmp_path: Path, column: str, frame: str) -> None:
    head = f"{column},{frame}{','.join(named(COCO17.joints))}"
    rows = [
        f"{clip}," + (f"{number}," if frame else "") + ",".join(map(str, row))
        for clip in ("a.mp4", "b.mp4")
        for number, row in enumerate(flat(person(COCO17.joints, at=len(clip))))
    ]
    (tmp_path / "k.csv").write_text("\n".join([head, *rows]))
    assert f"holds 2 clips, as its column {column!r} says" in refused(tmp_path / "k.csv").cause
    (tmp_path / "k.csv").write_text("\n".join([head, *rows[:FRAMES]]))
    assert len(read(tmp_path / "k.csv")[0]) == FRAMES


# ------------------------------------------------------------------------------------- what an archive says


def test_an_archive_says_times_joints_and_the_picture(tmp_path: Path) -> None:
    points, order = person(COCO17.joints), COCO17.joints[::-1]
    np.savez(
        tmp_path / "k.npz",
        keypoints=points[:, ::-1] / (1920, 1080),
        timestamps=np.arange(FRAMES) / 25,
        joint_names=np.array(order),
        img_shape=np.array([1080, 1920]),
    )
    (pose,) = ArrayReader().read(tmp_path / "k.npz")
    same(pose, points, COCO17.joints)
    np.testing.assert_allclose(pose.times, np.arange(FRAMES) / 25)
    assert "notes" not in pose.provenance


def test_timestamps_in_milliseconds_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "k.npz", keypoints=person(COCO17.joints), timestamps=np.arange(FRAMES) * 40)
    with pytest.raises(KeypointError) as caught:
        ArrayReader().read(tmp_path / "k.npz")
    assert caught.value.code == "E_KEYPOINTS_TIMES"


# -------------------------------------------------------------------------------------- tables as people have


FORMS: dict[str, Callable[[str], bytes]] = {
    "bars": lambda text: text.replace(",", "|").encode(),
    "spaces": lambda text: text.replace(",", "  ").encode(),
    "tabs": lambda text: text.replace(",", "\t").encode(),
    "the separator in the first line": lambda text: ("sep=;\n" + text.replace(",", ";")).encode(),
    "a title": lambda text: ("Keypoints of clip 3\n" + text).encode(),
    "a comment": lambda text: ("# made by a tool, 2024; v1\n" + text).encode(),
    "a separator at the end": lambda text: text.replace("\n", ",\n").encode(),
    "marked UTF-8, lines of Windows": lambda text: b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode(),
    "empty rows first": lambda text: ("\n" + "," * text.partition("\n")[0].count(",") + "\n" + text).encode(),
    "a code page": lambda text: text.replace("\n", ",größe\n", 1).replace(".0\n", ".0,1\n").encode("latin-1"),
}


OF_HEADERS = ("a code page", "a title", "a comment", "empty rows first")


@pytest.mark.parametrize(
    ("form", "header"),
    [*((form, True) for form in FORMS), *((form, False) for form in FORMS if form not in OF_HEADERS)],
)
def test_forms_of_a_table(tmp_path: Path, form: str, header: bool) -> None:
    points = person(COCO17.joints)
    text = lines(points, *([",".join(named(COCO17.joints))] if header else []))
    (tmp_path / "k.csv").write_bytes(FORMS[form](text))
    (pose,) = read(tmp_path / "k.csv")
    assert len(pose) == FRAMES
    same(pose, points, COCO17.joints)


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_empty_rows_at_the_start_are_frames(tmp_path: Path, mark: str) -> None:
    empty = [mark * 35] * 3
    rows = [mark.join(map(str, row)) for row in flat(person())]
    (tmp_path / "k.csv").write_text("\n".join([*empty, *rows, *empty]))
    (pose,) = read(tmp_path / "k.csv")
    assert len(pose) == FRAMES + 6 and not pose.seen[:3].any() and pose.seen[3].all()


def test_a_header_of_a_whole_body(tmp_path: Path) -> None:
    parts = ("x", "y", "z", "visibility")
    header = [f"face_landmark_{n}_{part}" for n in range(468) for part in parts]
    header += [f"pose_landmark_{joint}_{part}" for joint in BLAZEPOSE33.joints for part in parts]
    points = np.full((FRAMES, 33, 4), 0.5)
    for joint in COCO18.joints:
        if joint in BLAZEPOSE33.joints:
            where = points[:, BLAZEPOSE33.joints.index(joint), :2]
            where[:] = person([joint])[:, 0] / (640, 480)
    face = [repr(0.1234567890123456)] * 468 * 4
    rows = [",".join([*face, *map(repr, row)]) for row in points.reshape(FRAMES, -1).tolist()]
    (tmp_path / "k.csv").write_text("\n".join([",".join(header), *rows]))
    (pose,) = read(tmp_path / "k.csv")
    joints = [joint for joint in COCO18.joints if joint in BLAZEPOSE33.joints]
    same(pose, person(joints), joints)


# -------------------------------------------------------------------------------------------- names of frames


@pytest.mark.parametrize(
    "form",
    [
        "CLIP_{:012d}_KEYPOINTS.JSON",
        "clip ({}).json",
        "{}_wave_keypoints.json",
        "{:04d}.wave.json",
        "cam2_{:05d}_1.json",
        "f{}_of_90_keypoints.json",
    ],
)
def test_frames_by_their_numbers(tmp_path: Path, form: str) -> None:
    points = person()
    for number, frame in enumerate(points):
        joints = np.column_stack([frame, np.ones(18)]).reshape(-1).tolist()
        (tmp_path / form.format(number)).write_text(json.dumps({"people": [{"pose_keypoints_2d": joints}]}))
    reader = OpenPoseJsonReader()
    assert reader.accepts(tmp_path) and reader.members(tmp_path) == [""]
    same(reader.read(tmp_path)[0], points)


def test_numbers_that_count_behind_a_point_are_those_of_frames(tmp_path: Path) -> None:
    for shot in ("shot_010", "shot_020"):
        for number in range(1, 12):
            (tmp_path / f"{shot}.{number:04d}.json").write_text(json.dumps({"people": []}))
    assert OpenPoseJsonReader().members(tmp_path) == ["shot_010", "shot_020"]


def test_decimal_numbers_in_names_are_seconds_and_refused(tmp_path: Path) -> None:
    for number in range(30):
        (tmp_path / f"{number / 20:.2f}.json").write_text(json.dumps({"people": []}))
    with pytest.raises(KeypointError, match="decimal numbers, as") as caught:
        OpenPoseJsonReader().members(tmp_path)
    assert "whole numbers" in str(caught.value.remedy)
