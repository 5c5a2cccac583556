"""Series of channels as devices and archives write them: names, groups, units, times, labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from conftest import ROOT

from gesture_core.errors import GestureError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.plugin.registry import registry
from gesture_core.types import Recording

UEA = ROOT.parent / "shared" / "data" / "uea"
IMU = """timestamp [ms],accX,accY,accZ,gyro_x [deg/s],gyro_y [deg/s],activity
1000,0.1,0.2,9.8,1,2,walk
1010,0.2,0.2,9.7,,2,walk
1030,0.3,0.1,9.9,3,2,walk
1040,0.4,0.0,9.6,4,2,walk
"""


def read(path: Path, member: str = "", **options: object) -> Recording:
    (recording,) = registry().make("reader", "series", options, options=ReadOptions()).read(path, member)
    assert isinstance(recording, Recording)
    return recording


def written(folder: Path, text: str, name: str = "clip.csv") -> Path:
    (folder / name).write_text(text)
    return folder / name


def test_a_log_has_groups_units_uneven_times_and_gaps(tmp_path: Path) -> None:
    one = read(written(tmp_path, IMU))
    assert one.channels == ("acc/x", "acc/y", "acc/z", "gyro/x[deg/s]", "gyro/y[deg/s]")
    np.testing.assert_allclose(one.times, [0, 0.01, 0.03, 0.04])
    assert np.isnan(one.values[1, 3]) and one.frames_with_pose == 4
    assert one.provenance["notes"] == "left out, as they hold text: activity"
    assert "assumed" not in one.provenance


def test_the_same_table_in_every_form(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(size=(6, 3)).round(3)
    times = np.arange(6) / 50
    table = {"time": times, **{f"acc_{axis}": column for axis, column in zip("xyz", values.T, strict=True)}}
    pq.write_table(pa.table(table), tmp_path / "a.parquet")
    np.savez(tmp_path / "a.npz", time=times, acc=values)
    rows = [",".join(table), *(",".join(map(str, row)) for row in np.column_stack([times, values]))]
    for path in (written(tmp_path, "\n".join(rows)), tmp_path / "a.parquet", tmp_path / "a.npz"):
        one = read(path)
        assert one.channels == ("acc/x", "acc/y", "acc/z"), path
        np.testing.assert_allclose(one.values, values, rtol=1e-6)
        np.testing.assert_allclose(one.times, times, atol=1e-12)
    np.save(tmp_path / "a.npy", values)
    bare = read(tmp_path / "a.npy")
    assert bare.channels == ("channel/1", "channel/2", "channel/3")
    assert bare.provenance["assumed"] == "fps=30"


def test_dates_and_columns_of_other_names_are_times(tmp_path: Path) -> None:
    text = "when,force\n2024-05-01T12:00:00.000Z,1\n2024-05-01T12:00:00.250Z,2\n2024-05-01T12:00:00.500Z,4\n"
    one = read(written(tmp_path, text), time="when")
    np.testing.assert_allclose(one.times, [0, 0.25, 0.5], atol=1e-6)
    assert one.channels == ("force",)
    zoned = read(written(tmp_path, "time,a\n2024-05-01T12:00:00+02:00,1\n2024-05-01T10:00:01Z,2\n"))
    np.testing.assert_allclose(zoned.times, [0, 1], atol=1e-6)
    ticks = read(written(tmp_path, "n,force\n0,1\n100,2\n200,4\n"), time="n", per_second=1000.0)
    np.testing.assert_allclose(ticks.times, [0, 0.1, 0.2])


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("time,a\n0,1\n0.1,2\n0.05,3\n", "E_SIGNAL_TIMES", "time runs backwards after sample 2"),
        ("time,a\n0,1\n1000,2\n2000,3\n", "E_SIGNAL_TIMES", "time_ms"),
        ("time,a\n7,1\n7,2\n", "E_SIGNAL_TIMES", "all its 2 times are the same"),
        ("timestamp,a\n49105962326000,1\n49105982326000,2\n", "E_SIGNAL_TIMES", "series.per_second"),
        ("timestamp,a\n0,1\n20,2\n40,2\n", "E_SIGNAL_TIMES", "20 s apart"),
        ("time,who,a\n0,x,1\n0,y,2\n0,z,2\n1,x,2\n1,y,2\n", "E_KEYPOINTS_FORMAT", "pivot"),
        ("frame,label\n0,1\n1,2\n", "E_KEYPOINTS_FORMAT", "no column of numbers but frame, label"),
        ("time,a\n0,1\n,2\n0.2,3\n", "E_KEYPOINTS_TIMES", "no time in row 2"),
        ("time,a\n0,1\n0.1,two\n", "E_KEYPOINTS_FORMAT", "'two' is no number"),
        ("time,a\n0,1\n0.1,inf\n", "E_SIGNAL_VALUE", "infinity"),
        ("time,a,a\n0,1,2\n0.1,1,2\n", "E_KEYPOINTS_FORMAT", "two columns 'a'"),
        ("name,what\nx,y\nz,w\n", "E_KEYPOINTS_EMPTY", "holds no row"),
        ("time,a\n0,1\n0.1,1,2\n", "E_KEYPOINTS_FORMAT", "row 2 has 3 cells"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(tmp_path: Path, text: str, code: str, said: str) -> None:
    with pytest.raises(GestureError) as caught:
        read(written(tmp_path, text))
    assert caught.value.code == code and said in str(caught.value)


ARCHIVES = {
    "a.ts": "# c\n@problemName a\n@timeStamps false\n@classLabel true up down\n@data\n"
    "1,2,3:4,5,?:up\n3,2,1:4,5,6:down\n",
    "a.arff": "@relation a\n@attribute x relational\n@data\n'1,2,3\\n4,5,?',up\n'3,2,1\\n4,5,6',down\n",
    "a_TRAIN.tsv": "up\t1\t2\t3\ndown\t3\t2\tNaN\n",
}


@pytest.mark.parametrize("name", ARCHIVES)
def test_a_collection_names_each_series_by_label_and_number(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, ARCHIVES[name], name)
    reader = registry().make("reader", "series", options=ReadOptions())
    assert reader.accepts(path) and reader.members(path) == ["up/1", "down/2"]
    up, down = read(path, "up/1"), read(path, "down/2")
    assert up.values[:, 0].tolist() == [1, 2, 3] and down.values[0, 0] == 3
    assert len(down) == (2 if name.endswith(".tsv") else 3)
    assert name.endswith(".tsv") or np.isnan(up.values[2, 1])


@pytest.mark.skipif(not UEA.exists(), reason="the UEA sets are not here")
def test_a_set_of_the_uea_archive_is_read_whole() -> None:
    path = UEA / "JapaneseVowels" / "JapaneseVowels_TRAIN.ts"
    members = registry().make("reader", "series", options=ReadOptions()).members(path)
    assert len(members) == 270 and members[0] == "1/001"
    assert read(path, members[0]).values.shape == (20, 12)


def stream(folder: Path, name: str, start: float, rate: float, columns: str, shift: float = 0.0) -> None:
    times = start + np.arange(40) / rate
    values = [np.sin(times + shift) for _ in columns.split(",")]
    np.savetxt(
        folder / f"{name}.csv", np.stack([times, *values], axis=1), "%.6f", ",",
        header=f"time,{columns}", comments="",
    )  # fmt: skip


def test_streams_of_one_folder_are_one_recording_in_step(tmp_path: Path) -> None:
    clip = tmp_path / "clip"
    clip.mkdir()
    stream(clip, "imu", 100.0, 50.0, "acc_x,acc_y")
    stream(clip, "glove", 100.2, 20.0, "bend")
    reader = registry().make("reader", "series", {"streams": ["imu", "glove"]}, options=ReadOptions())
    stream(clip, "battery", 100.0, 1.0, "volt")
    assert reader.accepts(clip) and not reader.accepts(clip / "imu.csv")
    assert not reader.accepts(clip / "battery.csv")  # nor is what lies beside them an input
    (one,) = reader.read(clip)
    assert one.channels == ("acc@imu/x", "acc@imu/y", "bend@glove")
    assert len(one) == 30 and one.times[0] == 0
    np.testing.assert_allclose(one.values[:, 2], np.sin(100.2 + one.times), atol=1e-3)
    np.testing.assert_allclose(one.values[:, 0], np.sin(100.2 + one.times), atol=1e-5)
    assert not registry().make("reader", "series", options=ReadOptions()).accepts(clip)
    stream(clip, "glove", 200.0, 20.0, "bend")
    with pytest.raises(GestureError, match="no time in common"):
        reader.read(clip)
    np.savetxt(clip / "glove.csv", np.ones((9, 1)), header="bend", comments="")
    with pytest.raises(GestureError, match="glove has no times"):
        reader.read(clip)
