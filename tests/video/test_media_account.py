"""Clocks, counts, gaps and edit lists on their own."""

from __future__ import annotations

import io
import itertools
import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gesture_core.video import DamageLog, Integrity
from gesture_core.video.decoder import Clock, fit, upright
from gesture_core.video.integrity import MAX_NOTES, gaps
from gesture_core.video.integrity.iso import edit_list_fault

stamps = st.lists(st.none() | st.floats(allow_nan=True, allow_infinity=True), max_size=40)


@given(stamps, st.none() | st.floats(1, 240))
@settings(max_examples=200)
def test_times_are_finite_and_never_decrease(values: list[float | None], fps: float | None) -> None:
    clock = Clock(fps, DamageLog())
    times = [clock.at(value) for value in values]
    assert all(math.isfinite(time) for time in times)
    assert all(a <= b for a, b in itertools.pairwise(times))


def test_good_stamps_pass_unchanged_and_silently() -> None:
    log = DamageLog()
    clock = Clock(25, log)
    values = [0.0, 0.04, 0.04, 0.3, 10.0]
    assert [clock.at(value) for value in values] == values
    assert not log.notes and not log.damaged


def test_what_follows_a_backward_jump_keeps_its_pace() -> None:
    clock = Clock(10, DamageLog())
    times = [clock.at(value) for value in (5.0, 5.1, 1.0, 1.1, 1.3)]
    np.testing.assert_allclose(times, [5.0, 5.1, 5.2, 5.3, 5.5])


def test_a_leap_of_hours_is_damage() -> None:
    log = DamageLog()
    clock = Clock(10, log)
    times = [clock.at(value) for value in (0.0, 0.1, 1e9, 0.3)]
    assert log.damaged == 1 and times[-1] < 1


@given(st.integers(10, 200), st.sets(st.integers(2, 198), max_size=5), st.integers(5, 60))
def test_gaps_counts_the_frames_that_were_taken_out(count: int, lost: set[int], fps: int) -> None:
    times = np.round(np.arange(count) / fps, 3)
    lost = {index for index in lost if index < count - 1}
    kept = np.delete(times, sorted(lost))
    constant = (
        len(kept) - 1 >= 8 and np.mean(np.abs(np.diff(kept) - np.median(np.diff(kept))) <= 0.0016) >= 0.9
    )
    assert gaps(kept) == (len(lost) if constant else 0)


def test_an_uneven_recording_has_no_gaps() -> None:
    times = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.08, 100))
    assert gaps(times) == 0


def _counts(log: DamageLog, **counts: object) -> Integrity:
    """Of a second and 30 frames in FLV, whose bytes are not looked at."""
    values = {"packets": 30, "frames": 30, "end": 1.0, "stamps": list(np.arange(30) / 30), **counts}
    return Integrity(io.BytesIO(), "flv", log, **values)  # type: ignore[arg-type]


def test_counts_that_agree_leave_no_note() -> None:
    log = DamageLog()
    account = _counts(log)
    account.compare_packets(declared=30, duration=1.0)
    assert not log.damaged and not log.notes


@pytest.mark.parametrize(
    ("change", "declared", "duration"),
    [
        ({"packets": 29}, 30, None),
        ({"frames": 28}, 30, None),
        ({"end": 0.9}, None, 1.0),
        ({"hidden": 2, "frames": 28, "stamps": [0.1, 0.0, 0.2]}, 30, None),
    ],
)
def test_counts_that_disagree_are_damage(
    change: dict[str, object], declared: int | None, duration: float | None
) -> None:
    log = DamageLog()
    _counts(log, **change).compare_packets(declared=declared, duration=duration)
    assert log.damaged >= 1 and log.notes


def test_a_long_stretch_without_packets_is_a_hole() -> None:
    account = Integrity(io.BytesIO(), "avi", DamageLog())
    for position in (100, 200, 261, None, 260, 260):
        account.count_bytes(position, 60, 0.0)
    assert (account.holes, account.places) == (1, 4)


def test_a_file_cannot_fill_memory_with_notes() -> None:
    log = DamageLog()
    for index in range(10_000):
        log.damage(f"clause {index}")
    assert log.damaged == 10_000 and len(log.notes) == MAX_NOTES + 1


def _box(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(body), kind) + body


def _movie(*, clock: int = 1000, media_clock: int = 12800, track: int = 700, edits: int = 700) -> bytes:
    moov = _box(b"mvhd", struct.pack(">IIIII80x", 0, 0, 0, clock, track))
    tkhd = _box(b"tkhd", struct.pack(">IIIIII60x", 0, 0, 0, 7, 0, track))
    elst = _box(b"edts", _box(b"elst", struct.pack(">IIIiI", 0, 1, edits, 0, 1 << 16)))
    stbl = _box(b"minf", _box(b"stbl", _box(b"stts", struct.pack(">IIII", 0, 1, 36, 512))))
    mdia = _box(b"mdia", _box(b"mdhd", struct.pack(">IIIII4x", 0, 0, 0, media_clock, 18432)) + stbl)
    return _box(b"ftyp", b"isom") + _box(b"moov", moov + _box(b"trak", tkhd + elst + mdia))


def test_a_consistent_edit_list_is_accepted() -> None:
    assert edit_list_fault(io.BytesIO(_movie()), 7) == ""


@pytest.mark.parametrize(
    "change", [{"edits": 300}, {"track": 1440}, {"clock": 1049576}, {"media_clock": 8704}]
)
def test_an_edit_list_that_contradicts_the_header_is_a_fault(change: dict[str, int]) -> None:
    assert edit_list_fault(io.BytesIO(_movie(**change)), 7)


def test_hidden_frames_without_a_track_or_an_edit_list_are_a_fault() -> None:
    assert "number 8" in edit_list_fault(io.BytesIO(_movie()), 8)
    assert "no edit list" in edit_list_fault(io.BytesIO(_movie().replace(b"elst", b"free")), 7)


@pytest.mark.parametrize("kind", [b"mvhd", b"tkhd", b"mdhd"])
def test_a_header_box_of_the_wrong_version_or_without_its_name_is_a_fault(kind: bytes) -> None:
    data = bytearray(_movie())
    data[data.index(kind) + 4] = 1
    assert kind.decode() in edit_list_fault(io.BytesIO(bytes(data)), 7)
    assert edit_list_fault(io.BytesIO(_movie().replace(kind, kind.upper())), 7)


@given(st.binary(max_size=200), st.integers(0, 260))
def test_no_header_breaks_the_parser(noise: bytes, at: int) -> None:
    data = bytearray(_movie())
    data[at : at + len(noise)] = noise
    edit_list_fault(io.BytesIO(bytes(data)), 7)
    edit_list_fault(io.BytesIO(noise), 7)


def test_upright_turns_clockwise() -> None:
    frame = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    assert upright(frame, 90).shape == (4, 2, 3)
    np.testing.assert_array_equal(upright(frame, 90)[0, -1], frame[0, 0])
    np.testing.assert_array_equal(upright(upright(frame, 90), 270), frame)


def test_fit_keeps_the_aspect() -> None:
    out = fit(np.full((10, 10, 3), 255, np.uint8), 40, 20)
    assert out.shape == (20, 40, 3)
    assert out[:, 10:30].all() and not out[:, :10].any() and not out[:, 30:].any()
