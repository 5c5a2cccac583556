"""Tables as data-frame libraries, spreadsheets and loggers leave them: index, remarks, units, thousands."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gesture_pose_files.arrow_table import ArrowTableReader
from gesture_pose_files.csv_table import CsvReader
from gesture_pose_files.json_table import JsonTableReader
from gesture_pose_files.openpose_json import OpenPoseJsonReader
from tables import COCO17, FRAMES, flat, named, person, read, refused, same, save

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.pose.plausible import check_plausible

POINTS = person(COCO17.joints)
ROWS = flat(POINTS)
TURNED = [5, 0, 3, 1, 2, 4, 11, 10, 6, 8, 9, 7]
"""Rows in another order."""


def lines(*before: str, header: str = ",".join(named(COCO17.joints)), mark: str = ",") -> str:
    return "\n".join([*before, header, *(mark.join(f"{value:g}" for value in row) for row in ROWS)]) + "\n"


@pytest.mark.parametrize("name", ["", "index", "Unnamed: 0", "row"])
def test_rows_are_put_into_the_order_of_their_index(tmp_path: Path, name: str) -> None:
    rows = [[number, *ROWS[number]] for number in TURNED]
    (pose,) = read(save(tmp_path / "k.csv", [name, *named(COCO17.joints)], rows))
    same(pose, POINTS, COCO17.joints)
    assert "rows sorted by their index" in pose.provenance["notes"]


def test_rows_without_names_are_put_into_the_order_of_their_index(tmp_path: Path) -> None:
    points = person()
    header = ["", *range(36)]
    (pose,) = read(save(tmp_path / "k.csv", header, [[n, *flat(points)[n]] for n in TURNED]))
    same(pose, points)
    assert "rows sorted by their index" in pose.provenance["notes"]


@pytest.mark.parametrize("header", [["", *named(COCO17.joints)], None], ids=["named", "counted"])
def test_an_index_that_repeats_is_of_several_clips(tmp_path: Path, header: list[str] | None) -> None:
    rows = [[number, *ROWS[number]] for number in [*range(FRAMES)] * 2]
    error = refused(save(tmp_path / "k.csv", header or ["", *range(34)], rows))
    assert "repeat" in error.cause and "column person" in str(error.remedy)


@pytest.mark.parametrize(
    "index",
    [[0] * FRAMES, [*range(7, 7 + 5 * FRAMES, 5)], [*range(FRAMES - 1), np.inf]],
    ids=["zeros", "with gaps", "endless"],
)
def test_an_index_of_zeros_or_with_gaps_changes_nothing(tmp_path: Path, index: list[float]) -> None:
    rows = [[f"{number:g}", *row] for number, row in zip(index, ROWS, strict=True)]
    (pose,) = read(save(tmp_path / "k.csv", ["", *named(COCO17.joints)], rows), fps=10)
    same(pose, POINTS, COCO17.joints)
    np.testing.assert_allclose(pose.times, np.arange(FRAMES) / 10)


@pytest.mark.parametrize(
    "written",
    [
        lambda n: f"{n / 20}",
        lambda n: f"0 days 00:00:00.{50000 * n:06d}",
        lambda n: f"2024-03-01 09:00:00.{50 * n:03d}",
    ],
    ids=["seconds", "durations", "dates"],
)
def test_an_index_of_times_is_the_time(tmp_path: Path, written: Callable[[int], str]) -> None:
    rows = [[written(number), *row] for number, row in enumerate(ROWS)]
    (pose,) = read(save(tmp_path / "k.csv", ["", *named(COCO17.joints)], rows))
    np.testing.assert_allclose(pose.times - pose.times[0], np.arange(FRAMES) / 20, atol=1e-6)


def test_joints_in_rows_are_refused(tmp_path: Path) -> None:
    turned = [
        [name, *map(int, values)] for name, values in zip(named(COCO17.joints), np.array(ROWS).T, strict=True)
    ]
    rows = [row + row[1:] * 2 for row in turned]
    error = refused(save(tmp_path / "k.csv", ["", *range(36)], rows))
    assert "has its joints in rows, as 'nose_x'" in error.cause


REMARKS = {
    "comments": lines("# by hand", "# 640,480"),
    "facts": lines("subject,S5", "fps,20", "", "width,640"),
    "a marked header": lines(header="# " + " ".join(named(COCO17.joints)), mark=" "),
    "units": lines().replace("\n", "\n" + ",".join(["px"] * 34) + "\n", 1),
    "units in brackets": lines().replace("\n", "\n" + ",".join(["(pixels)"] * 33 + ["-"]) + "\n", 1),
    "a header twice": lines(",".join(named(COCO17.joints))),
    "a mark behind each row": lines().replace("\n", ",\n").replace(",\n", "\n", 1),
    "a mark behind the header": lines().replace("\n", ",\n", 1),
    "units in the names": lines(header=",".join(f"{name} (px)" for name in named(COCO17.joints))),
    "no mark in the names": lines(header=",".join(named(COCO17.joints, "{}{}")).replace("_", "")),
}


@pytest.mark.parametrize("kind", REMARKS)
def test_remarks_and_units_around_a_table(tmp_path: Path, kind: str) -> None:
    path = tmp_path / ("k.txt" if "marked" in kind else "k.csv")
    path.write_text(REMARKS[kind])
    (pose,) = read(path)
    assert len(pose) == FRAMES
    same(pose, POINTS, COCO17.joints)


def test_lines_above_a_table_are_counted_in_a_note(tmp_path: Path) -> None:
    (tmp_path / "k.csv").write_text(REMARKS["facts"])
    assert "first 4 lines are no table" in read(tmp_path / "k.csv")[0].provenance["notes"]


@pytest.mark.parametrize("where", ["row", "name"])
def test_metres_that_a_table_says_are_no_shares_of_a_picture(tmp_path: Path, where: str) -> None:
    header = named(COCO17.joints)
    rows = [[f"{value / 300:.4f}" for value in row] for row in ROWS]
    if where == "row":
        rows = [["m"] * 34, *rows]
    else:
        header = [f"{name}_m" for name in header]
    text = "\n".join(",".join(row) for row in [header, *rows])
    (tmp_path / "k.csv").write_text(text)
    (pose,) = read(tmp_path / "k.csv")
    assert pose.provenance["unit"] == "metres" and "frame_size" not in pose.provenance["assumed"]
    np.testing.assert_allclose(pose.keypoints, POINTS / 300, atol=1e-3)


@pytest.mark.parametrize("form", ["{:,.2f}|.", "{:,.2f}|'", "{:,.2f}| ", "{:,.2f}|\u00a0"])
def test_separators_of_thousands(tmp_path: Path, form: str) -> None:
    pattern, mark = form.split("|")
    decimal = "," if mark == "." else "."

    def written(value: float) -> str:
        return pattern.format(10 * value).replace(".", "D").replace(",", mark).replace("D", decimal)

    text = "\n".join(";".join(map(written, row)) for row in ROWS)
    (tmp_path / "k.csv").write_text(";".join(named(COCO17.joints)) + "\n" + text, encoding="utf-8")
    (pose,) = read(tmp_path / "k.csv")
    same(replace(pose, keypoints=pose.keypoints / 10), POINTS, COCO17.joints)


@pytest.mark.parametrize("mark", [",", "."])
@pytest.mark.parametrize("header", [True, False])
def test_thousands_that_may_be_decimals_are_refused(tmp_path: Path, mark: str, header: bool) -> None:
    rows = [[f"{4 * value:,.0f}".replace(",", mark) for value in row] for row in ROWS]
    assert any("." in cell or "," in cell for row in rows for cell in row)
    text = "\n".join(";".join(row) for row in rows)
    names = ";".join(named(COCO17.joints)) + "\n" if header else ""
    (tmp_path / "k.csv").write_text(names + text)
    error = refused(tmp_path / "k.csv")
    assert "which may be" in error.cause and "thousands" in str(error.remedy)


@pytest.mark.parametrize("word", ["#NV", "n.a.", "?", "1.#QNAN"])
def test_further_words_for_nothing(tmp_path: Path, word: str) -> None:
    rows: list[list[object]] = [[*row] for row in ROWS]
    rows[3][0] = rows[3][1] = word
    (pose,) = read(save(tmp_path / "k.csv", named(COCO17.joints), rows))
    assert np.isnan(pose.keypoints[3, 0]).all() and np.isfinite(pose.keypoints[2, 0]).all()


@pytest.mark.parametrize("letter", ["x", "X"])
def test_columns_that_are_counted_behind_a_letter(tmp_path: Path, letter: str) -> None:
    points = person()
    (pose,) = read(save(tmp_path / "k.csv", [f"{letter}{n}" for n in range(1, 37)], flat(points)))
    same(pose, points)


@pytest.mark.parametrize("form", ["İß {}_{}_px", "{}_{} [ßpx]", "İİ_{}_{} (PX)"])
def test_letters_beyond_ascii_stand_beside_units(tmp_path: Path, form: str) -> None:
    (pose,) = read(save(tmp_path / "k.csv", named(COCO17.joints, form), ROWS))
    same(pose, POINTS, COCO17.joints)


def test_lines_above_a_table_end_where_lines_do(tmp_path: Path) -> None:
    (tmp_path / "k.csv").write_text(lines("a\x0btitle\x1cof one line\u2028, and long"), encoding="utf-8")
    (pose,) = read(tmp_path / "k.csv")
    assert len(pose) == FRAMES
    same(pose, POINTS, COCO17.joints)


def test_half_a_joint_is_refused_with_the_column(tmp_path: Path) -> None:
    names = named(COCO17.joints)
    path = save(tmp_path / "k.csv", names[:-1], [row[:-1] for row in ROWS])
    assert "'right_ankle_x' and none for its y" in refused(path).cause
    assert "'right_ankle_x' and none" in CsvReader().refusal(path) and not CsvReader().accepts(path)


def test_what_is_wrong_with_a_header_is_said_and_what_would_be_right(tmp_path: Path) -> None:
    twice = save(tmp_path / "k.csv", [*named(COCO17.joints), "nose_x"], [[*row, 1] for row in ROWS])
    assert "the same coordinate" in CsvReader().refusal(twice)
    hips = save(tmp_path / "h.csv", named(("left_hip", "right_hip", "nose")), [row[:6] for row in ROWS])
    assert CsvReader().accepts(hips)
    assert "columns left_shoulder_x" in str(refused(hips).remedy)


def tracked(second: int, at: int, frames: range) -> list[list[object]]:
    there = person(COCO17.joints, at)
    return [
        [frame, second if frame in frames else 1, *flat(there if frame in frames else POINTS)[frame]]
        for frame in range(FRAMES)
    ]


def test_a_person_whose_number_changes_stays_one(tmp_path: Path) -> None:
    header = ["frame", "track_id", *named(COCO17.joints)]
    path = save(tmp_path / "k.csv", header, tracked(7, 0, range(6, FRAMES)))
    (pose,) = read(path)
    same(pose, POINTS, COCO17.joints)
    assert "2 people or tracks that follow one another taken as one" in pose.provenance["notes"]
    assert len(read(path, "multi")) == 2


def test_tracks_before_and_after_the_longest_one_are_joined(tmp_path: Path) -> None:
    header = ["frame", "track_id", *named(COCO17.joints)]
    of_whom = [5, 5, 3, 3, 3, 1, 1, 1, 1, 2, 2, 4]
    rows: list[list[object]] = [[frame, of_whom[frame], *ROWS[frame]] for frame in TURNED]
    (pose,) = read(save(tmp_path / "k.csv", header, rows))
    same(pose, POINTS, COCO17.joints)
    assert "5 people or tracks that follow" in pose.provenance["notes"]


def test_people_who_come_one_after_the_other_elsewhere_are_two(tmp_path: Path) -> None:
    header = ["frame", "track_id", *named(COCO17.joints)]
    (pose,) = read(save(tmp_path / "k.csv", header, tracked(7, 900, range(4, FRAMES))))
    assert "the best of 2 people" in pose.provenance["notes"]


def test_two_people_below_each_other_are_refused_where_nothing_numbers_the_rows(tmp_path: Path) -> None:
    rows = [*ROWS, *flat(person(COCO17.joints, 900))]
    (pose,) = read(save(tmp_path / "k.csv", named(COCO17.joints), rows))
    with pytest.raises(KeypointError, match="first 12 rows lie elsewhere"):
        check_plausible(pose)
    (pose,) = read(
        save(tmp_path / "k.csv", ["frame", *named(COCO17.joints)], [[n, *row] for n, row in enumerate(rows)])
    )
    check_plausible(pose)


def test_who_was_away_meanwhile_may_be_elsewhere(tmp_path: Path) -> None:
    rows = flat(np.concatenate([POINTS, np.zeros((5, 17, 2)), person(COCO17.joints, 900)]))
    (pose,) = read(save(tmp_path / "k.csv", named(COCO17.joints), rows))
    check_plausible(pose)


def test_rows_in_no_order_are_doubted(tmp_path: Path) -> None:
    order = np.random.default_rng(3).permutation(40)
    turn = np.linspace(0, 6, 40)[:, None, None]
    points = np.repeat(POINTS[:1], 40, axis=0) + 60 * np.concatenate([np.sin(turn), np.cos(turn)], axis=2)
    for rows, doubted in ((points, False), (points[order], True)):
        (pose,) = read(save(tmp_path / "k.csv", named(COCO17.joints), flat(rows)))
        assert any("order of time" in note for note in check_plausible(pose)) is doubted


@pytest.mark.parametrize("header", [True, False])
@pytest.mark.parametrize("numbered", [True, False])
def test_a_last_row_that_is_cut_costs_its_frame(tmp_path: Path, header: bool, numbered: bool) -> None:
    rows = [[n, *row] if numbered else row for n, row in enumerate(ROWS)]
    names = [*(["frame"] if numbered else []), *named(COCO17.joints)]
    path = save(tmp_path / "k.csv", names if header else None, rows)
    path.write_text(path.read_text()[:-60])
    (pose,) = read(path)
    assert len(pose) == FRAMES and pose.provenance["lost"].startswith("1 of 12 frames cannot be read: ")
    np.testing.assert_allclose(pose.keypoints[:-1], POINTS[:-1])
    assert np.isnan(pose.keypoints[-1, -1]).all()


def test_a_row_that_is_cut_among_others_is_refused(tmp_path: Path) -> None:
    path = save(tmp_path / "k.csv", named(COCO17.joints), [*ROWS[:5], ROWS[5][:9], *ROWS[6:]])
    error = refused(path)
    assert "row 6 has 9 cells" in error.cause and "in every row" in str(error.remedy)


def test_sums_below_a_table_are_refused(tmp_path: Path) -> None:
    rows: list[list[object]] = [[number, *row] for number, row in enumerate(ROWS)]
    rows.append(["mean", *np.mean(ROWS, axis=0)])
    assert (
        "'mean' has no number" in refused(save(tmp_path / "k.csv", ["", *named(COCO17.joints)], rows)).cause
    )


@pytest.mark.parametrize("form", ["records", "split", "parquet"])
def test_rows_of_other_tables_are_put_into_the_order_of_their_index(tmp_path: Path, form: str) -> None:
    names = named(COCO17.joints)
    records = [{**dict(zip(names, ROWS[n], strict=True)), "index": n} for n in TURNED]
    path = tmp_path / ("k.parquet" if form == "parquet" else "k.json")
    if form == "parquet":
        import pyarrow as pa
        import pyarrow.parquet

        pa.parquet.write_table(
            pa.Table.from_pylist(records).rename_columns([*names, "__index_level_0__"]), path
        )
    elif form == "records":
        path.write_text(json.dumps(records))
    else:
        path.write_text(json.dumps({"columns": names, "index": TURNED, "data": [ROWS[n] for n in TURNED]}))
    (pose,) = (ArrowTableReader if form == "parquet" else JsonTableReader)().read(path)
    same(pose, POINTS, COCO17.joints)
    assert "rows sorted by their index" in pose.provenance["notes"]


@pytest.mark.parametrize("form", ["lists", "flat", "folder"])
def test_lists_of_json_are_read_with_y_first_where_that_is_said(tmp_path: Path, form: str) -> None:
    turned = np.concatenate([POINTS[..., ::-1], np.ones((FRAMES, 17, 1))], axis=2)
    options = ReadOptions(axes="yx")
    if form == "folder":
        for number, frame in enumerate(turned):
            one = {"people": [{"pose_keypoints_2d": frame.reshape(-1).tolist()}]}
            (tmp_path / f"{number}.json").write_text(json.dumps(one))
        (pose,) = OpenPoseJsonReader(options).read(tmp_path)
    else:
        tree = turned.tolist() if form == "lists" else turned.reshape(FRAMES, -1).tolist()
        (tmp_path / "k.json").write_text(json.dumps(tree))
        (pose,) = JsonTableReader(options).read(tmp_path / "k.json")
    same(pose, POINTS, COCO17.joints)
