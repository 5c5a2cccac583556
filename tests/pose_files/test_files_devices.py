"""Logs as devices and their apps write them: what is above the table, clocks, counters, labels, axes."""

from __future__ import annotations

import wave
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gesture_core.errors import GestureError
from gesture_core.plugin.reading import ReadOptions
from gesture_core.plugin.registry import registry
from gesture_core.types import Recording

ROWS = 12
TIMES = np.arange(ROWS) / 50
WAVES = np.stack([np.sin(9 * TIMES), np.cos(9 * TIMES), np.sin(5 * TIMES + 1)], axis=1).round(5)


def read(path: Path, **options: object) -> Recording:
    reader = registry().make("reader", "series", options, options=ReadOptions())
    assert reader.accepts(path), reader.refusal(path)
    (recording,) = reader.read(path)
    assert isinstance(recording, Recording)
    return recording


def rows(*columns: np.ndarray | Callable[[int], object], mark: str = ",") -> str:
    """Lines of a table; a column is an array, or a function of the row."""
    cells = [
        [str(column(n)) for n in range(ROWS)] if callable(column) else [f"{value:.5f}" for value in column]
        for column in columns
    ]
    return "\n".join(mark.join(line) for line in zip(*cells, strict=True)) + "\n"


def number(n: int) -> int:
    return n


def milliseconds(n: int) -> int:
    return 1_700_000_000_000 + 20 * n


def nanoseconds(n: int) -> int:
    return milliseconds(n) * 1_000_000


def clock(n: int) -> str:
    return f"16:29:{30 + n // 50:02}.{20 * n % 1000:03}"


XYZ = tuple(WAVES.T)
XSENS = "// Start Time: Unknown\n// Sample rate: 50.0Hz\n"
LINE = "-" * 20
ACTIGRAPH = (
    f"{LINE} Data File By ActiGraph at 50 Hz {LINE}\nSerial Number: N1\nEpoch Period (hh:mm:ss) 00:00:00\n"
)
MOTIVE = "Format Version,1.23,Take Name,Take 1,Rate,50.0\n\n,,Body,Body,Body\n,,wand,wand,wand\n,,A,A,A\n"
SHIMMER = '"sep=\\t"\nS1_Timestamp_Unix_CAL\tS1_Acc_X_CAL\tS1_Acc_Y_CAL\tS1_Acc_Z_CAL\nms\t' + "\t".join(
    ["m/(s^2)"] * 3
)
DEVICES = {
    "axivity": (rows(lambda n: f"2024-05-07 {clock(n)}", *XYZ), "channel/1", ""),
    "empatica": (
        f"{','.join(['1544027337.0'] * 3)}\n50.0,50.0,50.0\n" + rows(*XYZ), "channel/1", "50 samples"),
    "geneactiv": (
        "Device,GENEActiv\nx gain,25548\nx offset,-1\ny gain,25\n"
        + rows(lambda n: "2024-05-07 " + clock(n).replace(".", ":"), *XYZ),
        "channel/1",
        "its first 4 lines are no table",
    ),
    "actigraph": (
        ACTIGRAPH + "Timestamp,Accelerometer X,Accelerometer Y,Accelerometer Z\n"
        + rows(lambda n: f"5/7/2024 {clock(n)} PM", *XYZ),
        "Accelerometer/x",
        "its first 3 lines are no table",
    ),
    "shimmer": (SHIMMER + "\n" + rows(milliseconds, *XYZ, mark="\t"), "S1_Acc_CAL/x[m/s^2]", ""),
    "phyphox": (
        '"Time (s)";"Acceleration x (m/s^2)";"Acceleration y (m/s^2)";"Acceleration z (m/s^2)"\n'
        + rows(TIMES, *XYZ, mark=";").replace(".", ","),
        "Acceleration/x[m/s^2]",
        "",
    ),
    "sensor logger": (
        "time,seconds_elapsed,z,y,x\n" + rows(nanoseconds, TIMES, *XYZ[::-1]), "axis/x", "seconds_elapsed",
    ),
    "sensorlog": (
        "loggingTime(txt),loggingSample(N),locationLatitude(WGS84),accelerometerTimestamp_sinceReboot(s),"
        "accX(G),accY(G),accZ(G),label(N)\n"
        + rows(lambda n: f"2024-05-07T{clock(n)}+02:00", number, lambda n: 47, lambda n: 9 + n, *XYZ, number),
        "acc/x[G]",
        "loggingSample(N), locationLatitude(WGS84), accelerometerTimestamp_sinceReboot(s), label(N)",
    ),
    "mbientlab": (
        "epoch (ms),time (+02:00),elapsed (s),x-axis (g),y-axis (g),z-axis (g)\n"
        + rows(milliseconds, lambda n: f"2024-05-07T{clock(n)}", TIMES, *XYZ),
        "axis/x[g]",
        "elapsed (s)",
    ),
    "pandas": (",time,acc_x,acc_y,acc_z\n" + rows(number, TIMES, *XYZ), "acc/x", "column 1"),
    "dates of pandas": (",acc_x,acc_y,acc_z\n" + rows(lambda n: f"2024-05-07 {clock(n)}", *XYZ), "acc/x", ""),
    "motive": (
        MOTIVE + ",,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z\n" + rows(number, TIMES, *XYZ),
        "Body_wand_A_Position/x",
        "Frame",
    ),
    "axes first": ("t,x_acc,y_acc,z_acc\n" + rows(TIMES, *XYZ), "acc/x", ""),
    "units in names": ("time_s,acc_x_g,acc_y_g,acc_z_g\n" + rows(TIMES, *XYZ), "acc/x[g]", ""),
    "empty rows below": ("time,acc_x,acc_y,acc_z\n" + rows(TIMES, *XYZ) + ",,,\n,,,\n", "acc/x", ""),
}  # fmt: skip


@pytest.mark.parametrize("device", DEVICES)
def test_the_axes_of_a_device_are_one_group_at_its_own_times(device: str, tmp_path: Path) -> None:
    text, first, note = DEVICES[device]
    (tmp_path / "a.csv").write_text(text)
    one = read(tmp_path / "a.csv")
    assert "assumed" not in one.provenance
    np.testing.assert_allclose(one.times, TIMES, atol=1e-6)
    names = [first.replace("/x", f"/{axis}") for axis in "xyz"] if "/x" in first else one.channels
    places = [one.channels.index(name) for name in names]
    assert len(one.channels) == 3
    np.testing.assert_allclose(one.values[:, places], WAVES, atol=1e-6)
    assert note in one.provenance.get("notes", "")


def test_what_counts_is_no_channel_and_may_be_made_the_time_or_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    head = XSENS + "PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\n"
    path.write_text(head + rows(number, lambda n: 10**8 + 200 * n, *XYZ, mark="\t"))
    one = read(path)
    assert one.channels == ("Acc/x", "Acc/y", "Acc/z") and one.provenance["assumed"] == "fps=30"
    assert "PacketCounter, SampleTimeFine" in one.provenance["notes"]
    assert "--set series.time='SampleTimeFine'" in one.provenance["notes"]
    timed = read(path, time="SampleTimeFine", per_second=10_000.0)
    np.testing.assert_allclose(timed.times, TIMES)
    assert "packet/PacketCounter" in read(path, groups={"PacketCounter": "packet"}).channels


def test_a_finger_and_a_place_in_a_room_are_channels(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("thumb,index,location_x,location_y,sample\n" + rows(*XYZ, *XYZ[:2]))
    assert read(path).channels == ("thumb", "index", "location/x", "location/y", "sample")
    path.write_text("index,gps_speed,label,force\n" + rows(number, XYZ[0], lambda n: n % 3, XYZ[1]))
    assert read(path).channels == ("force",)


def test_odd_times_and_shapes_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    times = TIMES + 3 * (TIMES > 0.1)
    path.write_text("time,a\n" + rows(times, XYZ[0]))
    assert "no sample for 3.02 s after 0.1 s" in read(path).provenance["notes"]
    path.write_text("time,a\n" + rows(np.repeat(TIMES[:3], 4), XYZ[0]))
    assert "9 samples have the time of the one before" in read(path).provenance["notes"]
    path.write_text("time,a\n" + rows(number, XYZ[0]))
    assert "its samples are 1 s apart" in read(path).provenance["notes"]
    np.save(tmp_path / "a.npy", WAVES.T)
    assert "3 samples of 12 channels: if each row" in read(tmp_path / "a.npy").provenance["notes"]


def test_a_clock_of_whole_seconds_is_refused_and_a_sample_a_second_is_not(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,a\n" + rows(lambda n: n // 4, XYZ[0]))
    with pytest.raises(GestureError, match=r"its 12 samples share 3 times.*whole seconds"):
        read(path)
    path.write_text("time,a\n" + rows(number, XYZ[0]))
    assert read(path).times[-1] == ROWS - 1


def test_a_row_that_is_broken_hides_none_of_those_above(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,a,b\n" + rows(TIMES, *XYZ[:2]) + "0.3,1\n" + rows(TIMES + 1, *XYZ[:2]))
    with pytest.raises(GestureError, match="row 13 has 2 cells"):
        read(path)


@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_a_wav_file_is_its_channels_at_its_rate(width: int, tmp_path: Path) -> None:
    half = 1 << (8 * width - 1)
    whole = np.clip((WAVES * half).round(), -half, half - 1).astype(np.int64)
    stored = whole + 128 * (width == 1)
    with wave.open(str(tmp_path / "a.wav"), "wb") as file:
        file.setnchannels(3)
        file.setsampwidth(width)
        file.setframerate(50)
        file.writeframes(b"".join(int(v).to_bytes(width, "little", signed=width > 1) for v in stored.flat))
    one = read(tmp_path / "a.wav")
    np.testing.assert_allclose(one.values, whole / half, atol=1e-6)
    np.testing.assert_allclose(one.times, TIMES)
    (tmp_path / "a.wav").write_bytes((tmp_path / "a.wav").read_bytes()[:60])
    with pytest.raises(GestureError, match=r"cut off|no WAV"):
        read(tmp_path / "a.wav")


@pytest.mark.parametrize("head", ["", "Unnamed: 0"])
@pytest.mark.parametrize("steps", [[2] * 11, [1, 1, 4, 1, 1, 1, 2, 1, 1, 1, 1]])
def test_an_index_in_any_step_is_no_channel_and_may_be_the_time(
    head: str, steps: list[int], tmp_path: Path
) -> None:
    index = np.cumsum([30, *steps])
    path = tmp_path / "a.csv"
    path.write_text(f"{head},acc_x,acc_y\n" + "".join(f"{n},{n % 3},{n % 2}.5\n" for n in index))
    one = read(path)
    called = head or "column 1"
    assert one.channels == ("acc/x", "acc/y") and one.times[-1] == pytest.approx(11 / 30)
    notes = one.provenance["notes"]
    assert f"left out, as they count or label: {called}" in notes
    assert f"--set series.time='{called}', without which the samples come at 30 a second" in notes
    np.testing.assert_allclose(read(path, time=called, per_second=100.0).times, (index - 30) / 100)
    path.write_text(f"{head},time,acc_x\n" + "".join(f"{n},{k / 10},{k % 3}\n" for k, n in enumerate(index)))
    timed = read(path)
    assert timed.channels == ("acc_x",) and "series.time" not in timed.provenance["notes"]
    path.write_text(f"{head},acc_x\n" + "".join(f"{n}.5,{n % 3}\n" for n in index))
    assert len(read(path).channels) == 2, "fractions may be a movement"
