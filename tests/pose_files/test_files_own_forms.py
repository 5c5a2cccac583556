"""Forms that people write by themselves, and files of data-frame libraries, R, MATLAB and Ultralytics."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from gesture_pose_files.arrays import ArrayReader
from gesture_pose_files.arrow_table import ArrowTableReader
from gesture_pose_files.csv_table import CsvReader
from gesture_pose_files.json_table import JsonTableReader
from gesture_pose_files.matlab import MatlabReader
from gesture_pose_files.yolo_text import YoloTextReader
from tables import COCO17, FRAMES, flat, named, person, read, same, save

from gesture_core.errors import KeypointError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.run.inputs import discover
from gesture_core.run.store import StoreReader
from gesture_core.skeletons import BLAZEPOSE33

POINTS = person(COCO17.joints)
SCORED = np.concatenate([POINTS, np.full((FRAMES, 17, 1), 0.5)], axis=2)
NAMES = [f"{joint}_{part}" for joint in COCO17.joints for part in ("x", "y", "score")]
TIMES = np.arange(FRAMES) / 20
RECORDS = [
    {"time": float(at)} | dict(zip(NAMES, row, strict=True))
    for at, row in zip(TIMES, SCORED.reshape(FRAMES, -1).tolist(), strict=True)
]
COLUMNS = {name: [record[name] for record in RECORDS] for name in RECORDS[0]}


def lists() -> list[list[list[float]]]:
    return list(SCORED.tolist())


def by_name() -> list[dict[str, Any]]:
    return [dict(zip(COCO17.joints, frame, strict=True)) for frame in lists()]


def people(**more: Any) -> list[Any]:
    return [[{"keypoints": frame} | more] for frame in lists()]


def apart(frame: list[list[float]]) -> dict[str, Any]:
    x, y, visible = zip(*frame, strict=True)
    return {"track_id": 1, "keypoints": {"x": list(x), "y": list(y), "visible": list(visible)}}


def long() -> list[dict[str, Any]]:
    return [
        {"frame": n, "joint": joint, "x": x, "y": y, "score": s}
        for n, frame in enumerate(by_name())
        for joint, (x, y, s) in frame.items()
    ]


# Each is the same clip of 17 joints; whether it tells its times.
JSON_FORMS: dict[str, tuple[Any, bool]] = {
    "records": (RECORDS, True),
    "columns": ({name: {str(n): v for n, v in enumerate(one)} for name, one in COLUMNS.items()}, True),
    "lists of columns": (COLUMNS, True),
    "split": ({"columns": list(COLUMNS), "data": [list(record.values()) for record in RECORDS]}, True),
    "table": ({"schema": {"fields": []}, "data": [{"index": n} | r for n, r in enumerate(RECORDS)]}, True),
    "by number": ({str(n): frame for n, frame in enumerate(lists())}, False),
    "long": (long(), False),
    "lists": (lists(), False),
    "flat": (SCORED.reshape(FRAMES, -1).tolist(), False),
    "by name": (by_name(), False),
    "objects": (
        [{j: {"X": x, "Y": y, "conf": s} for j, (x, y, s) in one.items()} for one in by_name()],
        False,
    ),
    "names inside": (
        [[{"name": j, "x": x, "y": y, "c": s} for j, (x, y, s) in f.items()] for f in by_name()],
        False,
    ),
    "arrays by joint": ({joint: SCORED[:, n].tolist() for n, joint in enumerate(COCO17.joints)}, False),
    "frames": ({"fps": 20, "width": 640, "height": 480, "frames": [{"pose": f} for f in lists()]}, True),
    "frames with times": ({"frames": [{"ms": 50 * n, "pose": f} for n, f in enumerate(lists())]}, True),
    "people of frames": (people(bbox=[0, 0, 9, 9], score=0.9, category_id=1), False),
    "predictions": ([{"frame": n, "predictions": one} for n, one in enumerate(people(score=0.9))], False),
    "x and y apart": ([[apart(frame)] for frame in lists()], False),
    "scores apart": ([[{"keypoints": f, "keypoint_scores": [0.5] * 17}] for f in POINTS.tolist()], False),
}


def check(pose: Any, timed: bool, rate: float = 20.0) -> None:
    same(pose, POINTS, COCO17.joints)
    np.testing.assert_allclose(pose.scores, 0.5)
    np.testing.assert_allclose(pose.times, np.arange(FRAMES) / (rate if timed else 30), atol=1e-6)


@pytest.mark.parametrize("form", JSON_FORMS)
def test_json_of_ones_own_is_a_table(tmp_path: Path, form: str) -> None:
    tree, timed = JSON_FORMS[form]
    (tmp_path / "clip.json").write_text(json.dumps(tree))
    assert JsonTableReader().accepts(tmp_path / "clip.json")
    (pose,) = JsonTableReader().read(tmp_path / "clip.json")
    check(pose, timed)


@pytest.mark.parametrize("suffix", [".jsonl", ".ndjson", ".json", ".jsonl.gz"])
@pytest.mark.parametrize("form", ["records", "long", "by name", "people of frames", "predictions"])
def test_lines_of_json_are_frames(tmp_path: Path, form: str, suffix: str) -> None:
    tree, timed = JSON_FORMS[form]
    lines = "\n".join([*map(json.dumps, tree), ""]).encode()
    path = tmp_path / f"clip{suffix}"
    path.write_bytes(gzip.compress(lines) if suffix.endswith(".gz") else lines)
    assert JsonTableReader().accepts(path)
    (pose,) = JsonTableReader().read(path)
    check(pose, timed)


def test_landmarks_of_mediapipe_keep_their_gaps_people_and_names(tmp_path: Path) -> None:
    points = np.random.default_rng(3).uniform(0.2, 0.8, (33, 2)) + TIMES[:, None, None] / 9
    frames = [[{"x": x, "y": y, "z": 0.1, "visibility": 0.9} for x, y in frame] for frame in points.tolist()]
    path = tmp_path / "clip.json"
    path.write_text(json.dumps([None, [], *frames[2:]]))
    (pose,) = JsonTableReader().read(path)
    assert pose.skeleton == BLAZEPOSE33.name and len(pose) == FRAMES and pose.frames_with_pose == FRAMES - 2
    assert "frame_size=640x480" in pose.provenance["assumed"] and "depth (z)" in pose.provenance["notes"]
    np.testing.assert_allclose(pose.keypoints[2:], points[2:] * (640, 480), rtol=1e-4)
    two = [{"timestamp_ms": 50 * n, "pose_landmarks": [frame, frame[::-1]]} for n, frame in enumerate(frames)]
    path.write_text(json.dumps(two))
    assert len(JsonTableReader(people="multi").read(path)) == 2
    path.write_text(json.dumps([[[x, y, 0.3] for x, y in frame] for frame in points.tolist()]))
    assert "depth (z)" in JsonTableReader().read(path)[0].provenance["notes"], (
        "a third value is no score here"
    )


@pytest.mark.parametrize(
    "tree",
    [
        [one for one, in people(score=0.9)],
        {"predictions": [one for one, in people(bbox=[0, 0, 9, 9])[:2]]},
        {"version": 1.3, "people": [{"pose_keypoints_2d": [0.0] * 54}]},
        {"model": "compact", "classes": ["wave", "clap"], "fps": 30},
        {"frames": []}, [1, 2, 3], [], {}, "text", None,
    ],
)  # fmt: skip
def test_what_may_be_the_people_of_one_frame_or_no_clip_is_left(tmp_path: Path, tree: Any) -> None:
    (tmp_path / "notes.json").write_text(json.dumps(tree))
    assert not JsonTableReader().accepts(tmp_path / "notes.json")


def test_a_line_that_is_cut_is_named(tmp_path: Path) -> None:
    (tmp_path / "k.jsonl").write_text("\n".join([*map(json.dumps, RECORDS[:5]), json.dumps(RECORDS[5])[:40]]))
    with pytest.raises(KeypointError, match="line 6 is not JSON"):
        JsonTableReader().read(tmp_path / "k.jsonl")


# -------------------------------------------------------------------------------------- packed and in text


@pytest.mark.parametrize("mark", [" ", "\t", ",", "  "])
def test_texts_of_numbers_and_of_names_are_tables(tmp_path: Path, mark: str) -> None:
    for header in (None, named(COCO17.joints)):
        path = save(tmp_path / "k.txt", header, flat(POINTS), mark)
        same(read(path)[0], POINTS, COCO17.joints)
        (item,) = discover([path])
        assert (item.kind, item.reader) == ("keypoints", "csv"), "and no list of paths"


@pytest.mark.parametrize("text", ["a.mp4\nb.mp4\n", "1 2 3 4\n" * 20, "0 0.5 0.5 0.1 0.1 " + "0.5 " * 51])
def test_other_texts_are_no_tables(tmp_path: Path, text: str) -> None:
    (tmp_path / "k.txt").write_text(text)
    assert not CsvReader().accepts(tmp_path / "k.txt")


def test_the_row_names_of_r_have_no_heading(tmp_path: Path) -> None:
    rows = [[f'"{n}"', *row] for n, row in enumerate(flat(POINTS), 1)]
    path = save(tmp_path / "k.txt", [f'"{name}"' for name in named(COCO17.joints)], rows, " ")
    same(read(path)[0], POINTS, COCO17.joints)


@pytest.mark.parametrize("written", [
    lambda at: f"2024-03-01 23:59:59.{int(1000 * at):03d}", lambda at: f"0 days 00:00:{at:09.6f}",
    lambda at: f"00:01:{at:06.3f}", lambda at: f"01:{at:06.3f}".replace(".", ","), lambda at: 1.7e9 + at,
])  # fmt: skip
def test_clocks_and_calendars_are_seconds(tmp_path: Path, written: Callable[[float], object]) -> None:
    rows = [[written(at), *row] for at, row in zip(TIMES, flat(POINTS), strict=True)]
    path = save(tmp_path / "k.csv", ["time", *named(COCO17.joints)], [], ";")
    with path.open("a") as file:
        file.writelines(";".join(map(str, row)) + "\n" for row in rows)
    (pose,) = read(path)
    np.testing.assert_allclose(pose.times - pose.times[0], TIMES, atol=1e-3)
    assert pose.times[0] < 100


def test_thousands_have_commas(tmp_path: Path) -> None:
    rows = [[f'"{value * 10:,.1f}"' for value in row] for row in flat(POINTS)]
    path = tmp_path / "k.csv"
    path.write_text("\n".join([",".join(named(COCO17.joints)), *map(",".join, rows)]))
    np.testing.assert_allclose(read(path)[0].keypoints, POINTS * 10)


# ------------------------------------------------------------------------------------------- other programs


def test_parquet_and_feather_of_others_are_tables(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.feather
    import pyarrow.parquet

    table = pa.Table.from_pylist(RECORDS)
    pa.parquet.write_table(table, tmp_path / "k.parquet")
    pa.feather.write_feather(table, tmp_path / "k.feather")
    nested = pa.Table.from_pylist(
        [{"time": timedelta(seconds=at), **frame} for at, frame in zip(TIMES, by_name(), strict=True)]
    )
    pa.parquet.write_table(nested, tmp_path / "nested.parquet")
    for name in ("k.parquet", "k.feather", "nested.parquet"):
        assert ArrowTableReader().accepts(tmp_path / name) and not StoreReader().accepts(tmp_path / name)
        check(ArrowTableReader().read(tmp_path / name)[0], True)
    pa.parquet.write_table(pa.table({"path": ["a", "c"], "label": ["b", "b"]}), tmp_path / "rows.parquet")
    assert not ArrowTableReader().accepts(tmp_path / "rows.parquet")
    assert "path, label" in ArrowTableReader().refusal(tmp_path / "rows.parquet")


@pytest.mark.parametrize("turn", [(0, 1, 2), (1, 2, 0), (2, 1, 0)])
@pytest.mark.parametrize("version", ["5", "7.3"])
def test_matlab_has_its_frames_first_or_last(tmp_path: Path, version: str, turn: tuple[int, ...]) -> None:
    path, array = tmp_path / "k.mat", SCORED.transpose(turn)
    if version == "5":
        scipy.io.savemat(path, {"keypoints": array, "fps": 20.0, "label": "wave"}, do_compression=True)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w", userblock_size=512) as file:
            file["keypoints"], file["fps"] = array.T, np.array([[20.0]])
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    assert MatlabReader().accepts(path)
    check(MatlabReader().read(path)[0], True)
    path.write_bytes(path.read_bytes()[:-400])
    with pytest.raises(KeypointError) as caught:
        MatlabReader().read(path)
    assert caught.value.code == "E_KEYPOINTS_BROKEN"


def test_matlab_says_what_it_holds_where_that_is_no_clip(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "k.mat", {"d_skel": np.zeros((20, 3, 9)), "s": {"a": 1}})
    with pytest.raises(KeypointError, match=r"holds d_skel \(20, 3, 9\).*keypoints.order"):
        MatlabReader().read(tmp_path / "k.mat")


@pytest.mark.parametrize("behind", ["", " 0.9", " 0.9 4"])
def test_labels_of_ultralytics_are_frames(tmp_path: Path, behind: str) -> None:
    shares = np.concatenate([POINTS / (640, 480), SCORED[..., 2:]], axis=2)
    for number in (1, 2, *range(5, FRAMES + 1)):  # frames without people have no file
        line = "0 0.5 0.5 0.3 0.9 " + " ".join(f"{v:.6f}" for v in shares[number - 1].reshape(-1)) + behind
        (tmp_path / f"clip_{number}.txt").write_text(line + "\n")
    assert YoloTextReader().accepts(tmp_path)
    (pose,) = YoloTextReader().read(tmp_path)
    assert len(pose) == FRAMES and pose.frames_with_pose == FRAMES - 2
    np.testing.assert_allclose(pose.keypoints[4:], POINTS[4:], atol=0.01)
    (item,) = discover([tmp_path])
    assert item.reader == "yolo-text", "its files are no inputs of their own"


def test_an_archive_with_an_array_for_each_joint_is_one_clip(tmp_path: Path) -> None:
    joints: dict[str, Any] = {joint: SCORED[:, n] for n, joint in enumerate(COCO17.joints)}
    np.savez(tmp_path / "k.npz", times=TIMES, **joints)
    assert ArrayReader().members(tmp_path / "k.npz") == [""]
    check(ArrayReader().read(tmp_path / "k.npz")[0], True)


def test_depths_are_no_scores_in_metres(tmp_path: Path) -> None:
    bones = {
        joint: [[x / 200, -y / 200, 2.0] for x, y in POINTS[:, n].tolist()]
        for n, joint in enumerate(COCO17.joints)
    }
    (tmp_path / "k.json").write_text(json.dumps({"bones": bones, "fps": 20}))
    (pose,) = JsonTableReader(ReadOptions(unit="metres", axes="x-y")).read(tmp_path / "k.json")
    np.testing.assert_allclose(pose.keypoints, POINTS / 200, rtol=1e-5)
    assert "depth (z)" in pose.provenance["notes"]


@pytest.mark.parametrize(
    ("name", "said"),
    [("k.xlsx", "spreadsheet"), ("k.csv.zip", "unpack"), ("k.pt", "numpy.save"), ("k.fbx", "places of"),
     ("k.bvh", "HIERARCHY"), ("k.c3d", "mark of C3D"),
     ("k.slp", "sleap-convert"), ("k.rds", "CSV"), ("k.dat", ".txt")],
)  # fmt: skip
def test_files_of_other_programs_are_refused_with_what_to_do(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / name).write_bytes(b"PK\x03\x04 something")
    (item,) = discover([tmp_path])
    assert item.kind == "other" and said in item.fault


def test_a_file_of_another_kind_among_frames_is_not_dropped(tmp_path: Path) -> None:
    for number in range(3):
        tree = {"people": [{"pose_keypoints_2d": SCORED[number].reshape(-1).tolist()}]}
        (tmp_path / f"wave_{number:012d}_keypoints.json").write_text(json.dumps(tree))
    (tmp_path / "clip.xlsx").write_bytes(b"PK\x03\x04")
    (tmp_path / "notes.md").write_text("# of the recording")
    found = {item.path.name: item.kind for item in discover([tmp_path])}
    assert found == {tmp_path.name: "keypoints", "clip.xlsx": "other"}


@pytest.mark.parametrize(
    "tree",
    [
        {"columns": ["nose_x"], "data": [1, 2, 3]},
        {"9" * 5000: {}, "2": {}},
        {"nose_x": {"9" * 5000: 1}, "nose_y": {"0": 1}},
        {"1": {"nose_x": 1}, "01": {"nose_x": 2}},
    ],
)
def test_odd_trees_are_no_clips(tmp_path: Path, tree: Any) -> None:
    path = tmp_path / "clip.json"
    path.write_text(json.dumps(tree))
    assert not JsonTableReader().accepts(path)


@pytest.mark.parametrize("scored", [False, True])
def test_depth_and_time_beside_lists_of_x_and_y_are_not_lost(tmp_path: Path, scored: bool) -> None:
    path = tmp_path / "clip.json"
    z = list(range(17))
    frames: list[dict[str, Any]] = []
    for at, frame in zip(TIMES.tolist(), SCORED, strict=True):
        x, y, score = frame.T.tolist()
        lists = {"x": x, "y": y, "z": z} | ({"confidence": score} if scored else {})
        frames.append({"time": at} | lists)
    path.write_text(json.dumps(frames))
    one = JsonTableReader().read(path)[0]
    np.testing.assert_allclose(one.keypoints, POINTS, atol=1e-3)
    np.testing.assert_allclose(one.times, TIMES)
    assert "depth (z)" in one.provenance["notes"]
    assert set(one.scores.ravel().tolist()) == ({0.5} if scored else {1.0})


def test_a_third_value_beside_scores_of_their_own_is_depth_unless_it_is_the_score(tmp_path: Path) -> None:
    path = tmp_path / "clip.json"
    for third, said in ((7.0, True), (0.5, False)):
        joints = [[[*joint[:2], third] for joint in frame] for frame in SCORED.tolist()]
        path.write_text(json.dumps([{"keypoints": one, "keypoint_scores": [0.5] * 17} for one in joints]))
        found = JsonTableReader().read(path)[0]
        np.testing.assert_allclose(found.scores, 0.5)
        assert ("depth (z)" in found.provenance.get("notes", "")) == said
