"""Runs of channels instead of people: rows, evaluation, explanation; the preset says what a table is."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from scipy.io import loadmat

from gesture_core import (
    GestureClassifier,
    classify_archive,
    cut_events,
    evaluate_archive,
    explain,
    load_settings,
)
from gesture_core.classify.balance import balanced
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.recordings import as_recording
from gesture_core.types import Signals

pytestmark = pytest.mark.usefixtures("in_this_process")


def imu(kind: str, seed: int, rate: float = 50.0) -> np.ndarray:
    """(T, 4): time, and an accelerometer that is shaken or turned, in an uneven rhythm."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.6, 1.4, 60)) / rate
    phase = times * (12 if kind == "shake" else 4) + rng.uniform(0, 1)
    values = np.stack([np.sin(phase), np.cos(phase) * (kind == "turn"), 9.8 + 0 * phase], axis=1)
    return np.column_stack([times, 3 * values + rng.normal(0, 0.1, values.shape)])


def write(path: Path, table: np.ndarray, header: str = "time,acc_x [g],acc_y [g],acc_z [g]") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, table, "%.5f", ",", header=header, comments="")
    return path


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    for kind in ("shake", "turn"):
        for n in range(3):
            write(tmp_path / "examples" / kind / f"{n}.csv", imu(kind, n))
            write(tmp_path / "imu" / f"{kind}_{n}.csv", imu(kind, 10 + n))
    return tmp_path


def test_a_folder_of_logs_is_classified_evaluated_and_explained(logs: Path) -> None:
    summary = classify_archive(logs / "imu", logs / "examples", logs / "run", "sensors", engine="inline")
    rows = summary.rows()
    assert [row.label for row in rows] == [Path(row.input).stem.partition("_")[0] for row in rows]
    assert {row.status for row in rows} == {"ok"} and rows[0].frames_read == 60 and rows[0].box == ()
    assert "acc/x[g]" in rows[0].selected and "acc/x[g].velocity" in rows[0].selected
    again = classify_archive(logs / "imu", logs / "examples", logs / "run", "sensors", engine="inline")
    assert again.done_now == 0
    assert explain(logs / "run", "turn_1").explanation.nearest.label == "turn"
    with closing(sqlite3.connect(logs / "run" / "run.db")) as db, db:
        db.execute("UPDATE rows SET margin = 0.123")  # as of a version that decides otherwise
    with pytest.warns(UserWarning, match="this version decides otherwise.* and was 0.123"):
        explain(logs / "run", "turn_1")
    result = evaluate_archive(logs / "examples", "sensors", protocol="leave-one-out", workers=1)
    assert result.accuracy == 1
    clips = cut_events(logs / "run", logs / "clips")
    assert sorted(clip.file.parent.name for clip in clips) == [*["shake"] * 3, *["turn"] * 3]


def test_other_channels_and_other_units_are_said_of_the_one_input(logs: Path) -> None:
    write(logs / "imu" / "a.csv", imu("turn", 5), "time,acc_x [m/s2],acc_y [m/s2],acc_z [m/s2]")
    write(logs / "imu" / "b.csv", imu("turn", 5)[:, :3], "time,acc_x [g],acc_y [g]")
    rows = classify_archive(logs / "imu", logs / "examples", None, "sensors", engine="inline").rows()
    a, b, *rest = rows
    assert {row.status for row in rest} == {"ok"}
    assert a.code == b.code == "E_DIMENSIONS"
    assert a.message.startswith(f"{a.input}: has other channels than the examples"), "no place in a batch"
    assert "it has acc/x[m/s2]" in a.message and "it lacks acc/x[g]" in a.message
    assert "it lacks acc/z[g]" in b.message


def test_the_preset_says_what_a_table_is(logs: Path, tmp_path: Path) -> None:
    with pytest.raises(GestureError, match=r"holds no example.*names no joints.*--preset sensors"):
        classify_archive(logs / "imu", logs / "examples", None, "modern", engine="inline")
    clip = tmp_path / "pose.mp4"
    clip.write_bytes(b"\0\0\0\x18ftypmp42" + bytes(64))
    (row,) = classify_archive(clip, logs / "examples", None, "sensors", engine="inline").rows()
    assert row.status == "skipped" and "no series of channels" in row.message


def test_dead_channels_are_noted(logs: Path) -> None:
    table = imu("turn", 7)
    table[:, 1], table[:, 3] = np.nan, 2.0
    write(logs / "imu" / "a.csv", table)
    rows = classify_archive(logs / "imu", logs / "examples", None, "sensors", engine="inline").rows()
    assert rows[0].note == "holds no value in acc/x[g]; holds one value alone in acc/z[g]"
    assert rows[0].label == "turn" and "acc/x[g]" not in rows[0].selected


def test_columns_in_another_order_are_the_same_channels(logs: Path) -> None:
    table = imu("turn", 7)[:, [3, 0, 2, 1]]
    write(logs / "imu" / "a.csv", table, "acc_z [g],time,acc_y [g],acc_x [g]")
    rows = classify_archive(logs / "imu", logs / "examples", None, "sensors", engine="inline").rows()
    assert rows[0].label == "turn"


def test_the_estimator_takes_arrays_and_frames() -> None:
    X = [imu(kind, n)[:, 1:] for kind in ("shake", "turn") for n in range(3)]
    y = ["shake"] * 3 + ["turn"] * 3
    fitted = GestureClassifier("sensors").fit(X, y)
    assert fitted.predict([imu("turn", 9)[:, 1:]]).tolist() == ["turn"]
    assert fitted.settings_.dtw.weights is not None

    def frame(table: np.ndarray) -> pa.Table:
        return pa.table(dict(zip(["time", "ax", "ay", "az"], table.T, strict=True)))

    tables = [frame(imu(kind, n)) for kind in ("shake", "turn") for n in range(3)]
    named = GestureClassifier("sensors").fit(tables, y)
    assert named.signals([frame(imu("turn", 9))])[0].channels[0] == "a/x"  # type: ignore[union-attr]
    assert named.predict([frame(imu("turn", 9))]).tolist() == ["turn"]
    with pytest.raises(GestureError, match="expected real numbers"):
        named.predict([frame(imu("turn", 9)).append_column("who", pa.array(["anna"] * 60))])


class Frame(dict[object, np.ndarray]):
    """As one of pandas: columns by their names, and an index."""

    def __init__(self, index: np.ndarray, names: Sequence[object]) -> None:
        wave = np.sin(np.arange(len(index)))
        super().__init__(dict.fromkeys(names, wave))
        self.columns, self.index = list(names), index


def test_the_index_of_a_frame_tells_its_times_and_its_columns_may_be_numbers() -> None:
    zone = timezone(timedelta(hours=2))
    dates = [datetime(2024, 5, 1, tzinfo=zone) + timedelta(milliseconds=10 * n) for n in range(20)]
    for index in (np.array(dates, object), np.arange(20) / 100, 1.7e12 + 10.0 * np.arange(20)):
        found = as_recording(Frame(index, [1, 2, "force"]), "frame", 50.0)
        np.testing.assert_allclose(found.times, np.arange(20) / 100, atol=1e-6)
        assert found.channels == ("1", "2", "force")
    with pytest.raises(GestureError, match="10 s apart"):
        as_recording(Frame(10.0 * np.arange(20), ["force"]), "milliseconds", 50.0)


def signals(*columns: np.ndarray) -> Signals:
    values = np.stack(columns, axis=1)
    return Signals(values, np.arange(len(values)) / 10, ("acc/x", "acc/y", "force")[: len(columns)])


def test_groups_count_alike_whatever_their_units() -> None:
    wave = np.sin(np.arange(50) / 3)
    settings = load_settings("sensors", ["classify.weights=force=2"])
    one = balanced([signals(wave, 0 * wave, 1000 * wave)], settings).dtw.weights
    assert one is not None and one[0] == one[1]
    np.testing.assert_allclose(2 * one[0] / one[2], 1e6, rtol=1e-4)
    with pytest.raises(ConfigError, match="no group of channels 'gyro'"):
        balanced([signals(wave, wave)], load_settings("sensors", ["classify.weights=gyro=2"]))
    with pytest.raises(GestureError, match="no channel of any example changes"):
        balanced([signals(0 * wave + 5, 0 * wave)], settings.with_values([("classify.weights", "")]))


def test_axes_and_frames_of_other_libraries_are_said() -> None:
    X = np.stack([imu(kind, n)[:, 1:] for kind in ("shake", "turn") for n in range(2)])
    y = ["shake", "shake", "turn", "turn"]
    with pytest.warns(UserWarning, match=r"3 samples of 60 channels.*transpose") as caught:
        GestureClassifier("sensors").fit([x.T for x in X], y)
    assert len(caught) == 1 and caught[0].filename == __file__
    with pytest.raises(InputError, match="one data frame"):
        GestureClassifier("sensors").fit(pa.table({"acc_x": [1.0, 2.0]}), ["a", "b"])
    labelled = [
        pa.table({"ax": x[:, 0], "ay": x[:, 1], "frame": np.arange(60), "label": [kind] * 60})
        for x, kind in zip(X, y, strict=True)
    ]
    with pytest.warns(UserWarning, match="frame, label"):
        (first, *_) = GestureClassifier("sensors").signals(labelled)
    assert isinstance(first, Signals) and first.channels[:2] == ("a/x", "a/y") and len(first.channels) == 4


def test_streams_count_alike_however_many_groups_they_have() -> None:
    rng = np.random.default_rng(0)
    names = ("acc@imu/x", "acc@imu/y", "dead@imu", "bend@glove", "j1@skin", "j2@skin", "j3@skin")
    values = rng.normal(size=(50, len(names))) * [1, 2, 0, 3, 4, 5, 6]
    item = Signals(values, np.arange(50) / 10, names)

    def shares(*sets: str) -> list[float]:
        weights = balanced([item], load_settings("sensors", sets, environment={})).dtw.weights
        assert weights is not None
        cost = np.array(weights) * values.var(axis=0)
        parts = {
            name: sum(c for n, c in zip(names, cost, strict=True) if f"@{name}" in n)
            for name in ("imu", "skin")
        }
        return [float(parts["imu"]), float(cost[3]), float(parts["skin"])]

    np.testing.assert_allclose(shares(), [1, 1, 1], rtol=1e-4)
    np.testing.assert_allclose(shares("classify.weights=*@skin*=2"), [1, 1, 2], rtol=1e-4)


def test_two_files_of_one_movement_are_put_in_step(shared: Path, tmp_path: Path) -> None:
    """Real joints as two devices write them, the second later and faster, each by a clock that trembles."""
    rng = np.random.default_rng(0)
    for path in sorted((shared / "utd_skeleton").glob("a*_s[12]_t1_skeleton.mat")):
        action, subject, _ = path.name.split("_", 2)
        if action not in ("a1", "a9", "a22", "a25"):
            continue
        joints = loadmat(path)["d_skel"].transpose(2, 0, 1)
        joints = joints - joints[:, 2:3]
        there = np.arange(len(joints)) / 30
        clip = tmp_path / ("examples/" + action if subject == "s1" else "clips") / f"{action}_{subject}"
        for name, own, first, rate in (("arms", (6, 10), 0.0, 30), ("legs", (13, 17), 0.07, 50)):
            times = np.arange(first, there[-1] - 0.1, 1 / rate)
            times = np.sort(times + rng.normal(0, 0.004, len(times))).clip(0)
            values = [np.interp(times, there, joints[:, joint, axis]) for joint in own for axis in range(3)]
            header = "time," + ",".join(f"{name}{joint}_{axis}" for joint in own for axis in "xyz")
            write(clip / f"{name}.csv", np.column_stack([times + 1000, *values]), header)
    sets = ('series.streams=["arms","legs"]',)
    settings = load_settings("sensors", sets, environment={})
    summary = classify_archive(
        tmp_path / "clips", tmp_path / "examples", tmp_path / "run", settings, engine="inline"
    )
    rows = summary.rows()
    assert len(rows) == 4 and {row.status for row in rows} == {"ok"}
    assert sum(row.label == Path(row.input).name.partition("_")[0] for row in rows) >= 3
    assert {"arms6@arms/x", "legs17@legs/z"} <= {*rows[0].selected}


@pytest.mark.parametrize(
    ("preset", "names"),
    [("sensors", ("acc/x", "gyro/x", "acc/x@+1", "gyro/x@+1")), ("modern", ("wrist_x", "knee@1", "elbow@1"))],
)
def test_moves_in_time_and_shares_are_no_streams(preset: str, names: tuple[str, ...]) -> None:
    values = np.random.default_rng(0).normal(size=(50, len(names)))
    chosen = load_settings(preset, ["classify.balance=true"], environment={})
    weights = balanced([Signals(values, np.arange(50) / 10, names)], chosen).dtw.weights
    assert weights is not None
    np.testing.assert_allclose(np.array(weights) * values.var(axis=0), 1, rtol=1e-4)
