"""Tables that are not what they seem: counted headers, several people, frames out of order, odd cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tables import COCO17, COCO18, FRAMES, flat, named, person, read, refused, same, save


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("form", ["{}", "V{}", "col_{}", "{}.0"])
@pytest.mark.parametrize("joints", [COCO17.joints, COCO18.joints])
def test_a_first_row_that_counts_the_columns_is_a_header(
    tmp_path: Path, start: int, form: str, joints: tuple[str, ...]
) -> None:
    points = person(joints)
    header = [form.format(n) for n in range(start, start + 2 * len(joints))]
    (pose,) = read(save(tmp_path / "k.csv", header, flat(points)))
    same(pose, points, joints)
    assert len(pose) == FRAMES


def test_the_index_of_a_data_frame_is_no_coordinate(tmp_path: Path) -> None:
    points = person()
    rows = [[number, *row] for number, row in enumerate(flat(points))]
    for header in (["", *range(36)], None, ["Unnamed: 0", *named()], ["", *named()]):
        (pose,) = read(save(tmp_path / "k.csv", header, rows))
        same(pose, points)
        assert "notes" not in pose.provenance


def test_landmarks_of_a_data_frame_keep_their_frames(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(0.2, 0.8, (FRAMES, 66))
    lines = [",".join(map(str, range(66))), *(",".join(map(str, row)) for row in points)]
    (tmp_path / "k.csv").write_text("\n".join(lines))
    (pose,) = read(tmp_path / "k.csv")
    assert pose.skeleton == "blazepose33" and len(pose) == FRAMES


@pytest.mark.parametrize(
    "name", ["person", "person_id", "track_id", "trackId", "id", "object_id", "Player ID", "instance", "PID"]
)
@pytest.mark.parametrize("ids", [("1", "2"), ("anna", "ben"), ("7.0", "12.0"), ("1000001", "1000002")])
def test_a_column_tells_people_apart(tmp_path: Path, name: str, ids: tuple[str, str]) -> None:
    one, two = person(), person(at=300)
    two[:, 4] = 0  # one joint less
    rows = [[f, i, *r] for f in range(FRAMES) for i, r in zip(ids, (flat(one)[f], flat(two)[f]), strict=True)]
    path = save(tmp_path / "k.csv", ["frame", name, *named()], rows)
    found = read(path, "multi")
    assert [pose.person for pose in found] == [0, 1] and [len(pose) for pose in found] == [FRAMES] * 2
    same(found[0], one)
    (best,) = read(path)
    same(best, one)
    assert f"the best of 2 people or tracks, {ids[0].removesuffix('.0')}" in best.provenance["notes"]


def test_an_id_that_numbers_the_rows_tells_nobody_apart(tmp_path: Path) -> None:
    points = person()
    rows = [[100 + number, *row] for number, row in enumerate(flat(points))]
    (pose,) = read(save(tmp_path / "k.csv", ["id", *named()], rows), "multi")
    same(pose, points)
    assert "numbers the rows" in pose.provenance["notes"]


def test_rows_without_a_person_are_counted(tmp_path: Path) -> None:
    rows = [[f, "" if f == 3 else 1, *row] for f, row in enumerate(flat(person()))]
    (pose,) = read(save(tmp_path / "k.csv", ["frame", "track_id", *named()], rows))
    assert len(pose) == FRAMES - 1 and "1 rows of no person left out" in pose.provenance["notes"]


def test_people_without_an_id_are_told_apart_by_their_place(tmp_path: Path) -> None:
    rows = [
        [f, *r] for f in range(FRAMES) for r in (flat(person())[f], flat(person(at=400))[f])[:: (-1) ** f]
    ]
    path = save(tmp_path / "k.csv", ["frame", *named()], rows)
    found = read(path, "multi")
    assert len(found) == 2 and {len(pose) for pose in found} == {FRAMES}
    assert all(np.ptp(pose.keypoints[:, 1, 0]) < 20 for pose in found)
    (one,) = read(path)
    assert np.ptp(one.keypoints[:, 1, 0]) < 20
    assert "told apart by their place" in one.provenance["notes"]


def test_frames_that_begin_again_are_refused(tmp_path: Path) -> None:
    rows = [[f, *r] for points in (person(), person(at=400)) for f, r in enumerate(flat(points))]
    error = refused(save(tmp_path / "k.csv", ["frame", *named()], rows))
    assert (
        error.code == "E_KEYPOINTS_FORMAT"
        and "0 stands in 2 rows" in error.cause
        and "person" in error.remedy
    )


@pytest.mark.parametrize(("name", "what"), [("frame", "frame numbers"), ("time", "times")])
def test_rows_out_of_order_are_sorted_with_a_note(tmp_path: Path, name: str, what: str) -> None:
    points = person()
    rows = [[f if name == "frame" else f / 10, *r] for f, r in enumerate(flat(points))][::-1]
    text = ",".join([name, *named()]) + "\n" + "\n".join(",".join(map(str, row)) for row in rows)
    (tmp_path / "k.csv").write_text(text)
    (pose,) = read(tmp_path / "k.csv")
    same(pose, points)
    assert f"rows sorted by their {what}" in pose.provenance["notes"]
    np.testing.assert_allclose(pose.times, np.arange(FRAMES) / (30 if name == "frame" else 10))


def test_rows_that_are_there_twice_count_once(tmp_path: Path) -> None:
    points = person()
    rows = [[f, *r] for f, r in enumerate(flat(points)) for _ in range(2)]
    (pose,) = read(save(tmp_path / "k.csv", ["frame", *named()], rows))
    same(pose, points)
    assert f"{FRAMES} rows that are there twice left out" in pose.provenance["notes"]


def test_a_person_who_is_twice_in_a_frame_counts_once(tmp_path: Path) -> None:
    points = person()
    rows = [[f, 1, *r] for f, r in enumerate(flat(points)) for r in (r, [v + 3 for v in r])]
    (pose,) = read(save(tmp_path / "k.csv", ["frame", "person", *named()], rows))
    same(pose, points)
    assert f"{FRAMES} rows left out whose frame and person" in pose.provenance["notes"]


def test_a_coarse_clock_is_one_person(tmp_path: Path) -> None:
    points = person()
    rows = [[f"{f // 3 / 10:.1f}", *r] for f, r in enumerate(flat(points))]
    (pose,) = read(save(tmp_path / "k.csv", ["time", *named()], rows))
    same(pose, points)


def test_columns_of_another_kind_are_named_in_a_note(tmp_path: Path) -> None:
    points = person()
    rows = [["clip.mp4", f, "wave", *r, 0.5] for f, r in enumerate(flat(points))]
    path = save(tmp_path / "k.csv", ["video", "frame", "label", *named(), "bbox_area"], rows)
    (pose,) = read(path)
    same(pose, points)
    assert pose.provenance["notes"] == "columns not used: video, label, bbox_area"


@pytest.mark.parametrize("empty", ["", "nan", "NaN", "None", "null", "NA", "-", " "])
def test_every_word_for_nothing_is_a_missing_joint(tmp_path: Path, empty: str) -> None:
    points = person()
    rows = [list(map(str, row)) for row in flat(points)]
    rows[3][8:10] = [empty, empty]
    rows[5][:] = [empty] * 36
    path = save(tmp_path / "k.csv", ["frame", *named()], [[f, *row] for f, row in enumerate(rows)])
    (pose,) = read(path)
    assert not pose.seen[3, 4] and not pose.seen[5].any() and pose.seen.sum() == (FRAMES - 1) * 18 - 1
    (bare,) = read(save(tmp_path / "b.csv", None, rows))
    np.testing.assert_array_equal(bare.seen, pose.seen)


@pytest.mark.parametrize("header", [True, False])
def test_decimal_commas(tmp_path: Path, header: bool) -> None:
    points = person() + 0.25
    rows = [[str(value).replace(".", ",") for value in row] for row in flat(points)]
    for mark in (";", "\t"):
        (pose,) = read(save(tmp_path / "k.csv", named() if header else None, rows, mark))
        same(pose, points)
    quoted = [[f'"{cell}"' for cell in row] for row in rows]
    (pose,) = read(save(tmp_path / "k.csv", named() if header else None, quoted))
    same(pose, points)


def test_text_in_a_coordinate_is_named_by_row_and_column(tmp_path: Path) -> None:
    rows = [list(map(str, row)) for row in flat(person())]
    rows[2][6] = "left"
    error = refused(save(tmp_path / "k.csv", named(), rows))
    assert error.code == "E_KEYPOINTS_FORMAT" and "row 3, column 'right_elbow_x': 'left'" in error.cause


def test_milliseconds_by_name_are_seconds(tmp_path: Path) -> None:
    rows = [[f * 40, *r] for f, r in enumerate(flat(person()))]
    (pose,) = read(save(tmp_path / "k.csv", ["timestamp_ms", *named()], rows))
    np.testing.assert_allclose(pose.times, np.arange(FRAMES) * 0.04)


def test_a_table_of_something_else_is_refused_with_its_header(tmp_path: Path) -> None:
    error = refused(save(tmp_path / "k.csv", ["speed", "height"], [[1, 2]]))
    assert error.code == "E_KEYPOINTS_FORMAT" and "speed,height" in error.cause
