"""The awkward and broken media of real projects: the outcome of each, by each reader."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import pytest

from gesture_core.errors import MediaError
from gesture_core.video import open_video

WHOLE, PART = "complete", "incomplete"
# file: (PyAV: outcome, frames), (OpenCV: outcome, frames)
OUTCOMES: dict[str, tuple[tuple[str, int], tuple[str, int]]] = {
    # One packet of the 50 is broken; OpenCV takes it for the end unless it is asked again.
    "corrupted.mp4": ((PART, 49), (PART, 49)),
    "video_180.mov": ((WHOLE, 3), (WHOLE, 3)),
    "video_90.mov": ((WHOLE, 3), (WHOLE, 3)),
    # Header: 1000 frames/s, 1136 frames.
    "sample.flv": ((WHOLE, 30), (WHOLE, 30)),
    "full_blocks.mkv": (("E_MEDIA_NO_VIDEO", 0), ("E_MEDIA_NO_VIDEO", 0)),
    "sample_ac3.mp4": (("E_MEDIA_NO_VIDEO", 0), ("E_MEDIA_NO_VIDEO", 0)),
    "sample_av1.mp4": ((WHOLE, 30), (WHOLE, 30)),
    # Header: 4 frames.
    "sample_partially_fragmented.mp4": ((WHOLE, 30), (WHOLE, 30)),
    "bear-vp9-odd-dimensions.webm": ((WHOLE, 30), (WHOLE, 30)),
    "video_with_dash.mp4": ((WHOLE, 5), (WHOLE, 5)),
    # Header: -1.4e17 frames.
    "no_duration.webm": ((WHOLE, 74), (WHOLE, 74)),
    # Header: 351,000,000 ticks, 117,000 frames.
    "outV300.mp4": ((WHOLE, 240), (WHOLE, 240)),
    # Its second picture needs one that is not there; OpenCV has no way to tell.
    "blackframe.265": ((PART, 2), (WHOLE, 2)),
    "init_prog.mp4": (("E_MEDIA_NO_FRAMES", 0), ("E_MEDIA_NO_FRAMES", 0)),
    "init_truncated.mp4": (("E_MEDIA_BROKEN", 0), ("E_MEDIA_BROKEN", 0)),
    "invalid_userdata.mp4": (("E_MEDIA_NO_FRAMES", 0), ("E_MEDIA_NO_FRAMES", 0)),
    "WrongFile.mp4": (("E_MEDIA_BROKEN", 0), ("E_MEDIA_BROKEN", 0)),
    "portrait.MOV": ((WHOLE, 62), (WHOLE, 62)),
    "video_without_video_stream.mp4": (("E_MEDIA_NO_VIDEO", 0), ("E_MEDIA_NO_VIDEO", 0)),
    "awesome_movie.mov": ((WHOLE, 123), (WHOLE, 123)),
    "empty.flv": (("E_MEDIA_BROKEN", 0), ("E_MEDIA_BROKEN", 0)),
    "data_streams.mp4": ((WHOLE, 309), (WHOLE, 309)),
    "h265_10bits.mp4": ((WHOLE, 30), (WHOLE, 30)),
}
READERS = ("pyav", "opencv")
OLD_OPENCV = tuple(map(int, cv2.__version__.split(".")[:2])) < (4, 13)
# Where the FFmpeg inside earlier releases of OpenCV does less.
OPENCV_BEFORE_413 = {
    "sample_av1.mp4": {("E_MEDIA_NO_FRAMES", 0)},
    "sample_partially_fragmented.mp4": {(PART, 5), (WHOLE, 30)},
    "blackframe.265": {(WHOLE, 2), (WHOLE, 3)},
}


def expected(name: str, reader: str) -> set[tuple[str, int]]:
    if reader == "opencv" and OLD_OPENCV:
        return OPENCV_BEFORE_413.get(name, {OUTCOMES[name][1]})
    return {OUTCOMES[name][READERS.index(reader)]}


def outcome_of(path: Path, reader: str) -> tuple[str, int]:
    frames, last = 0, -1.0
    try:
        with open_video(path, reader) as video:
            for time, frame in video:
                assert time >= last and frame.shape == (video.info.height, video.info.width, 3)
                frames, last = frames + 1, time
            declared = video.info.frames_declared
            assert declared is None or 0 < declared <= 1000
            return ("complete" if video.report.complete else "incomplete"), frames
    except MediaError as error:
        return error.code, frames


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", OUTCOMES)
def test_outcome(shared: Path, name: str, reader: str) -> None:
    if reader == "pyav":
        pytest.importorskip("av")
    assert outcome_of(shared / "nasty_media" / name, reader) in expected(name, reader)


def test_the_table_is_complete(shared: Path) -> None:
    files = {path.name for path in (shared / "nasty_media").iterdir()} - {"MANIFEST.csv"}
    assert files == set(OUTCOMES)


def test_frames_and_times_agree(shared: Path) -> None:
    pytest.importorskip("av")
    import numpy as np

    # Earlier releases took all colours for those of BT.601, and counted time from the first packet.
    soon = 0.1 if OLD_OPENCV else 2e-3
    for name, (outcome, _) in OUTCOMES.items():
        same = {outcome} == expected(name, "opencv")
        if outcome[0] != WHOLE or not same or name == "no_duration.webm":  # large, covered by its outcome
            continue
        with (
            open_video(shared / "nasty_media" / name, "pyav") as one,
            open_video(shared / "nasty_media" / name, "opencv") as two,
        ):
            assert (one.info.width, one.info.height) == (two.info.width, two.info.height)
            assert one.info.rotation == two.info.rotation
            for (time, frame), (time_cv, frame_cv) in zip(one, two, strict=True):
                assert abs(time - time_cv) < soon, name
                difference = np.abs(frame[::4, ::4].astype(int) - frame_cv[::4, ::4])
                assert difference.mean() < 10 if OLD_OPENCV else difference.max() <= 2, name


@pytest.mark.parametrize("reader", READERS)
def test_the_same_under_odd_names(shared: Path, tmp_path: Path, reader: str) -> None:
    if reader == "pyav":
        pytest.importorskip("av")
    prefixes = [b"a b ", b"'q\" ", b"-x ", b"new\nline ", b"caf\xe9 ", b"%d ", b"a:b "]
    for index, name in enumerate(OUTCOMES):
        target = os.path.join(os.fsencode(tmp_path), prefixes[index % len(prefixes)] + name.encode())  # noqa: PTH118
        try:
            shutil.copyfile(os.fsencode(shared / "nasty_media" / name), target)
        except OSError as error:
            pytest.skip(f"this file system refuses the name: {error.strerror}")
        assert outcome_of(Path(os.fsdecode(target)), reader) in expected(name, reader), target
