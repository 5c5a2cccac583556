"""Keypoint tables: bare rows, named columns, and CSV files that are something else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gesture_pose_files.csv_table import CsvReader

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.skeletons import COCO17, COCO18


def code_of(path: Path) -> str:
    with pytest.raises(KeypointError) as caught:
        CsvReader().read(path)
    assert caught.value.subject and caught.value.code.startswith("E_KEYPOINTS_")
    return caught.value.code


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def bare(array: np.ndarray, mark: str = ",", end: str = "\n") -> str:
    return "".join(mark.join(map(repr, row.reshape(-1).tolist())) + end for row in array)


@pytest.mark.parametrize(
    ("mark", "end", "start"), [(",", "\n", ""), (";", "\r\n", "\ufeff"), ("\t", "\n\n", "")]
)
def test_bare_rows_are_frames(tmp_path: Path, mark: str, end: str, start: str) -> None:
    array = np.random.default_rng(0).uniform(1, 500, (6, 18, 2))
    array[2, 4] = 0
    path = write(tmp_path / "k.csv", start + bare(array, mark, end))
    assert CsvReader().accepts(path) and CsvReader().members(path) == [""]
    (sequence,) = CsvReader(ReadOptions(fps=15)).read(path)
    assert sequence.skeleton == "coco18" and not sequence.seen[2, 4] and sequence.seen.sum() == 6 * 18 - 1
    seen = sequence.seen
    np.testing.assert_array_equal(sequence.keypoints[seen], array[seen].astype(np.float32))
    np.testing.assert_allclose(sequence.times, np.arange(6) / 15)


def test_scores_and_other_skeletons_by_width(tmp_path: Path) -> None:
    array = np.random.default_rng(0).uniform(0.1, 1, (3, 25, 3)) * [500, 500, 1]
    (sequence,) = CsvReader().read(write(tmp_path / "k.csv", bare(array)))
    assert sequence.skeleton == "body25"
    np.testing.assert_allclose(sequence.scores, array[..., 2].astype(np.float32))


def named(joints: tuple[str, ...], parts: tuple[str, ...] = ("x", "y", "score")) -> list[str]:
    return [f"{joint}_{part}" for joint in joints for part in parts]


def test_named_columns_in_any_order_and_empty_cells(tmp_path: Path) -> None:
    text = (
        "right_wrist_y, right_wrist_x ,time,neck_x,neck_y,neck_score\n"
        "10,20,0.5,1,2,0.9\n"
        ",,0.75,3,4,\n"
        "nan,5,1.5,0,0,0\n"
    )
    path = write(tmp_path / "k.csv", text)
    assert CsvReader().accepts(path)
    (sequence,) = CsvReader().read(path)
    wrist, neck = COCO18.index("right_wrist"), COCO18.index("neck")
    assert sequence.skeleton == "coco18" and sequence.times.tolist() == [0.5, 0.75, 1.5]
    assert sequence.keypoints[0, wrist].tolist() == [20, 10]
    assert sequence.seen[:, wrist].tolist() == [True, False, False]
    assert sequence.seen[:, neck].tolist() == [True, True, False]
    np.testing.assert_allclose(sequence.scores[:, neck], [0.9, 1, 0])
    assert sequence.seen.sum() == 3


def test_skeleton_by_joint_names_and_time_by_frame(tmp_path: Path) -> None:
    rows = [",".join(["frame", *named(COCO17.joints, ("x", "y"))])]
    rows += [",".join(map(str, [number, *range(1, 35)])) for number in (3, 4, 9)]
    (sequence,) = CsvReader(ReadOptions(fps=10)).read(write(tmp_path / "k.csv", "\n".join(rows)))
    assert sequence.skeleton == "coco17"
    np.testing.assert_allclose(sequence.times, [0.3, 0.4, 0.9])
    assert sequence.provenance["assumed"] == "unit=pixels", "the rate is stated"


def test_people_of_a_table(tmp_path: Path) -> None:
    rows = ["time,person,nose_x,nose_y,neck_x,neck_y"]
    for index in range(6):
        rows.append(f"{index / 10},7,{index + 1},1,{index + 1},2")
        if index % 2:
            rows.append(f"{index / 10},3,{100 + index},1,,")
    path = write(tmp_path / "k.csv", "\n".join(rows))
    (best,) = CsvReader().read(path)
    assert len(best) == 6 and best.keypoints[0, 0, 0] == 1
    few, many = CsvReader(people="multi").read(path)
    assert (few.person, many.person) == (0, 1) and (len(few), len(many)) == (3, 6)


def test_a_person_who_is_seen_twice_in_a_minute_makes_no_milliseconds(tmp_path: Path) -> None:
    rows = ["time,person,nose_x,nose_y,neck_x,neck_y"]
    rows += [f"{t / 10},0,{t + 1},1,{t + 1},2" for t in range(600)] + ["1,1,9,9,9,9", "59,1,9,9,9,9"]
    assert len(CsvReader(people="multi").read(write(tmp_path / "k.csv", "\n".join(rows)))) == 2


BAD_TABLES = {
    "manifest": ("path,label\na.mp4,wave\n", "E_KEYPOINTS_FORMAT"),
    "numbers of no width": ("1,2,3\n4,5,6\n", "E_KEYPOINTS_FORMAT"),
    "ragged": (bare(np.ones((2, 18, 2))) + "1,2,3\n" + bare(np.ones((2, 18, 2))), "E_KEYPOINTS_FORMAT"),
    "text in a row": (
        bare(np.ones((2, 18, 2))) + ",".join(["1"] * 35 + ["=cmd()"]) + "\n",
        "E_KEYPOINTS_FORMAT",
    ),
    "infinite": (bare(np.full((2, 18, 2), np.inf)), "E_KEYPOINTS_VALUE"),
    "infinite in a column": ("time,nose_x,nose_y,neck_x,neck_y\n0,inf,1,1,1\n", "E_KEYPOINTS_VALUE"),
    "unknown joints": ("time,tail_x,tail_y,wing_x,wing_y\n0,1,1,1,1\n", "E_KEYPOINTS_FORMAT"),
    "a name twice": ("nose_x,nose_y,neck_x,neck_y,nose_x\n1,1,1,1,1\n", "E_KEYPOINTS_FORMAT"),
    "no origin": ("left_heel_x,left_heel_y,mid_hip_x,mid_hip_y\n1,2,3,4\n", "E_KEYPOINTS_SKELETON"),
    "time empty": ("time,nose_x,nose_y,neck_x,neck_y\n,1,1,1,1\n", "E_KEYPOINTS_TIMES"),
    "milliseconds": (
        "time,nose_x,nose_y,neck_x,neck_y\n0,1,1,1,1\n33,1,1,1,1\n66,1,1,1,1\n",
        "E_KEYPOINTS_TIMES",
    ),
    "a clock that stands": (
        "time,nose_x,nose_y,neck_x,neck_y\n" + "".join(f"0.5,1,{n},1,1\n" for n in range(9)),
        "E_KEYPOINTS_TIMES",
    ),
    "a clock of whole seconds": (
        "time,nose_x,nose_y,neck_x,neck_y\n" + "".join(f"{n // 25},1,{n},1,1\n" for n in range(60)),
        "E_KEYPOINTS_TIMES",
    ),
    "header only": ("time,nose_x,nose_y,neck_x,neck_y\n", "E_KEYPOINTS_EMPTY"),
    "nobody": ("person,nose_x,nose_y,neck_x,neck_y\n,1,1,1,1\n", "E_KEYPOINTS_VALUE"),
    "blank": ("\n\n \n", "E_KEYPOINTS_EMPTY"),
    "nothing": ("", "E_KEYPOINTS_EMPTY"),
    "one long line": ("1," * 600_000, "E_KEYPOINTS_LIMIT"),
    "an open quote": ('"' + "1,2\n" * 50, "E_KEYPOINTS_FORMAT"),
}


@pytest.mark.parametrize("kind", BAD_TABLES)
def test_a_bad_table_is_a_typed_error(tmp_path: Path, kind: str) -> None:
    text, code = BAD_TABLES[kind]
    assert code_of(write(tmp_path / "k.csv", text)) == code


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "k.csv"
    path.write_bytes(bare(np.ones((1, 18, 2))).encode() + b"\xff\xfe\n")
    assert code_of(path) == "E_KEYPOINTS_FORMAT"
    path.write_bytes(bytes(range(256)) * 4)
    assert code_of(path) == "E_KEYPOINTS_FORMAT"
    assert not CsvReader().accepts(path)
    assert not CsvReader().accepts(tmp_path / "k.txt")


def test_the_papers_own_tables(shared: Path) -> None:
    """198 files, neck at the origin in every frame; other joints fall on it and are not missing."""
    paths = [
        path for path in sorted((shared / "utd_openpose").rglob("*.csv")) if path.name != "authors_result.csv"
    ]
    assert len(paths) >= 171
    on_neck = 0
    for path in paths:
        assert CsvReader().accepts(path)
        raw = np.loadtxt(path, delimiter=",", ndmin=2).reshape(-1, 18, 2)
        (sequence,) = CsvReader().read(path)
        assert sequence.seen.all()
        np.testing.assert_array_equal(sequence.keypoints, raw.astype(np.float32))
        on_neck += int((np.delete(raw, 1, axis=1) == 0).all(axis=2).sum())
    assert on_neck > 50


@pytest.mark.parametrize(
    "name", ["nasty_media/MANIFEST.csv", "utd_openpose/authors_result.csv", "published_dtw_1nn.csv"]
)
def test_real_tables_of_something_else(shared: Path, name: str) -> None:
    assert not CsvReader().accepts(shared / name)
    assert code_of(shared / name) == "E_KEYPOINTS_FORMAT"
