"""Both video readers on healthy clips: same frames, same times, upright, whatever the file is called."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from clips import FRAMES, KINDS, SIZE, make_clips, picture, write_clip

from gesture_core.errors import ConfigError, MediaError, PluginError
from gesture_core.plugin.interfaces import VideoInfo, VideoLimits, VideoReport
from gesture_core.video import at_rate, open_video, pictures, reader_name

if TYPE_CHECKING:
    from av.video.frame import VideoFrame

pytest.importorskip("av", reason="clips are made with PyAV")
READERS = ("pyav", "opencv")


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clips")
    make_clips(folder)
    return folder


def read(path: Path | str, reader: str, **limits: float) -> tuple[list[float], list[np.ndarray], VideoReport]:
    with open_video(path, reader, VideoLimits(**limits)) as video:  # type: ignore[arg-type]
        items = list(video)
        assert all(frame.shape == (video.info.height, video.info.width, 3) for _, frame in items)
        return [time for time, _ in items], [frame for _, frame in items], video.report


def probe(path: Path, reader: str) -> VideoInfo:
    with open_video(path, reader) as video:
        return video.info


def code_of(path: Path | str, reader: str, **limits: float) -> str:
    with pytest.raises(MediaError) as caught:
        read(path, reader, **limits)
    assert caught.value.subject and caught.value.remedy
    return caught.value.code


@pytest.mark.parametrize(("container", "codec"), KINDS)
def test_both_readers_give_the_same_frames_and_times(clips: Path, container: str, codec: str) -> None:
    path = clips / f"{codec}.{container}"
    if not path.exists():
        pytest.skip(f"this FFmpeg cannot encode {codec}")
    (times, frames, report), (times_cv, frames_cv, report_cv) = (read(path, reader) for reader in READERS)
    assert len(frames) == len(frames_cv) == FRAMES
    np.testing.assert_allclose(times, np.arange(FRAMES) / 25, atol=0.0011)
    np.testing.assert_allclose(times, times_cv, atol=1e-6)
    difference = max(np.abs(a.astype(int) - b).max() for a, b in zip(frames, frames_cv, strict=True))
    assert difference <= 2
    assert np.mean([np.abs(f.astype(int) - picture(i)).mean() for i, f in enumerate(frames)]) < 20
    assert report.complete and report_cv.complete
    assert (report.reader, report_cv.reader) == READERS


@pytest.mark.parametrize("reader", READERS)
def test_probe_tells_size_rate_and_codec(clips: Path, reader: str) -> None:
    info = probe(clips / "h264.mp4", reader)
    assert (info.width, info.height) == SIZE
    assert info.frames_declared == FRAMES and info.fps == 25
    assert info.reader == reader and info.container == "mov" and info.codec in ("h264", "avc1")


@pytest.mark.parametrize("reader", READERS)
def test_times_are_the_containers_not_an_index(tmp_path: Path, reader: str) -> None:
    stamps = [0, 40, 80, 300, 310, 900, 1000, 2500]
    write_clip(tmp_path / "v.mkv", "mjpeg", frames=len(stamps), stamps=stamps)
    times, _, report = read(tmp_path / "v.mkv", reader)
    np.testing.assert_allclose(times, np.array(stamps) / 1000, atol=1e-6)
    assert report.frames_read == len(stamps)


@pytest.mark.parametrize("reader", READERS)
def test_an_animated_gif_is_a_video(tmp_path: Path, reader: str) -> None:
    write_clip(tmp_path / "a.gif", "gif", frames=12, fps=10)
    times, frames, report = read(tmp_path / "a.gif", reader)
    np.testing.assert_allclose(times, np.arange(12) / 10, atol=0.011)
    assert report.complete and len({frame.tobytes() for frame in frames}) == 12


def _with_matrix(data: bytes, *values: int) -> bytes:
    """An mp4 whose track header says how to turn the picture: a, b, c, d of the matrix."""
    a, b, c, d = (value << 16 for value in values)
    at = data.index(b"tkhd") + 4 + 40
    return data[:at] + struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30) + data[at + 36 :]


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    ("turns", "matrix"), [(0, (1, 0, 0, 1)), (1, (0, 1, -1, 0)), (2, (-1, 0, 0, -1)), (3, (0, -1, 1, 0))]
)
def test_pictures_are_turned_upright(
    clips: Path, tmp_path: Path, reader: str, turns: int, matrix: tuple[int, ...]
) -> None:
    _, stored, _ = read(clips / "h264.mp4", reader)
    (tmp_path / "turned.mp4").write_bytes(_with_matrix((clips / "h264.mp4").read_bytes(), *matrix))
    info = probe(tmp_path / "turned.mp4", reader)
    _, frames, _ = read(tmp_path / "turned.mp4", reader)
    assert info.rotation == turns * 90
    np.testing.assert_array_equal(frames[5], np.rot90(stored[5], k=-turns))


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        ((-1, 0, 0, 1), lambda f: f[:, ::-1]),
        ((1, 0, 0, -1), lambda f: f[::-1]),
        ((0, 1, 1, 0), lambda f: f.swapaxes(0, 1)),
    ],
)
def test_mirrored_pictures_are_mirrored_back(  # type: ignore[no-untyped-def]
    clips: Path, tmp_path: Path, reader: str, matrix, expected
) -> None:
    _, stored, _ = read(clips / "h264.mp4", reader)
    (tmp_path / "m.mp4").write_bytes(_with_matrix((clips / "h264.mp4").read_bytes(), *matrix))
    _, frames, _ = read(tmp_path / "m.mp4", reader)
    np.testing.assert_array_equal(frames[7], expected(stored[7]))


def test_a_recording_that_was_broken_off_lacks_its_index(clips: Path, tmp_path: Path) -> None:
    data = (clips / "h264.mp4").read_bytes()
    (tmp_path / "a.mp4").write_bytes(data[: data.rindex(b"moov") - 4])
    with pytest.raises(MediaError, match=r"has no index \(moov\)") as caught:
        open_video(tmp_path / "a.mp4", "pyav")
    assert caught.value.code == "E_MEDIA_BROKEN"


@pytest.mark.parametrize("reader", READERS)
def test_frames_that_change_their_size_are_scaled_into_the_first(tmp_path: Path, reader: str) -> None:
    for name, size in (("a.h264", (96, 64)), ("b.h264", (192, 160))):
        write_clip(tmp_path / name, "h264", frames=10, size=size, options={"bf": "0"})
    joined = tmp_path / "joined.h264"
    joined.write_bytes((tmp_path / "a.h264").read_bytes() + (tmp_path / "b.h264").read_bytes())
    _, frames, report = read(joined, reader)  # which checks that the size is constant
    assert len(frames) == 20
    if reader == "pyav":  # OpenCV stretches them before we see them
        assert any("scaled into 96 x 64" in note for note in report.notes)
        # 192 x 160 fits 96 x 64 at a height of 64 and a width of 77: black on both sides.
        assert not frames[-1][:, :8].any() and frames[-1][:, 12:-12].mean() > 50


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("begins", ["amid a packet", "behind remains"])
def test_a_broadcast_whose_beginning_is_missing_is_read(tmp_path: Path, begins: str, reader: str) -> None:
    write_clip(tmp_path / "v.ts", "h264", frames=60)
    whole = (tmp_path / "v.ts").read_bytes()
    before = whole[97:] if begins == "amid a packet" else bytes(range(256)) * 5 + whole
    (tmp_path / "v.ts").write_bytes(before)
    _, frames, _ = read(tmp_path / "v.ts", reader)
    assert len(frames) >= 48
    (tmp_path / "v.ts").write_bytes(b"const G = 1;\n" * 500)
    assert code_of(tmp_path / "v.ts", reader) == "E_MEDIA_FORMAT"


ODD_NAMES = [
    b"a b.mp4", b"it's \"so\".mp4", b"-leading.mp4", b"new\nline.mp4", b"caf\xe9.mp4", b"%d.mp4",
    b"a:b.mp4", b"http:x.mp4", b"concat:a|b.mp4", b"\xff\xfe.mp4", "Größe-動画.mp4".encode(), b"[1].mp4",
]  # fmt: skip


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", ODD_NAMES, ids=repr)
def test_any_file_name_opens(clips: Path, tmp_path: Path, name: bytes, reader: str) -> None:
    target = os.path.join(os.fsencode(tmp_path), name)  # noqa: PTH118 - bytes
    try:
        os.symlink(os.fsencode(clips / "h264.mp4"), target)  # noqa: PTH211 - bytes
    except OSError as error:
        pytest.skip(f"this file system refuses the name: {error.strerror}")
    times, _, report = read(os.fsdecode(target), reader)
    assert len(times) == FRAMES and report.complete


PLAYLISTS = {
    "concat": b"ffconcat version 1.0\nfile 'secret.mp4'\n",
    "hls": b"#EXTM3U\n#EXT-X-TARGETDURATION:5\n#EXTINF:5,\nsecret.ts\n#EXT-X-ENDLIST\n",
    "hls with a mark": b"\xef\xbb\xbf#EXTM3U\nsecret.ts\n",
    "dash": b"<?xml version='1.0'?><MPD><BaseURL>secret.mp4</BaseURL></MPD>",
    "sdp": b"v=0\no=- 0 0 IN IP4 127.0.0.1\nm=video 1234 RTP/AVP 96\n",
    "text": b"just a few words\n",
    "picture": b"\x89PNG\r\n\x1a\n" + bytes(64),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("kind", PLAYLISTS)
def test_playlists_and_other_texts_are_refused(clips: Path, tmp_path: Path, kind: str, reader: str) -> None:
    (tmp_path / "secret.mp4").write_bytes((clips / "h264.mp4").read_bytes())
    for suffix in ("mp4", "avi", "ts"):
        path = tmp_path / f"list.{suffix}"
        path.write_bytes(PLAYLISTS[kind])
        assert code_of(path, reader) == "E_MEDIA_FORMAT"


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_never_opened(tmp_path: Path, reader: str) -> None:
    os.mkfifo(tmp_path / "pipe.mp4")
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "folder.mp4").mkdir()
    assert code_of(tmp_path / "pipe.mp4", reader) == "E_MEDIA_UNREADABLE"
    assert code_of("/dev/zero", reader) == "E_MEDIA_UNREADABLE"
    assert code_of(tmp_path / "folder.mp4", reader) == "E_MEDIA_UNREADABLE"
    assert code_of(tmp_path / "absent.mp4", reader) == "E_MEDIA_MISSING"
    assert code_of(tmp_path / "empty.mp4", reader) == "E_MEDIA_EMPTY"


@pytest.mark.parametrize("reader", READERS)
def test_limits_hold(clips: Path, reader: str) -> None:
    path = clips / "h264.mp4"
    assert code_of(path, reader, max_pixels=96 * 64 - 1) == "E_MEDIA_LIMIT"
    assert code_of(path, reader, max_frames=FRAMES - 1) == "E_MEDIA_LIMIT"
    assert code_of(path, reader, max_seconds=1) == "E_MEDIA_LIMIT"
    assert len(read(path, reader, max_pixels=96 * 64, max_frames=FRAMES, max_seconds=2)[0]) == FRAMES


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
def test_a_giant_picture_costs_no_memory(tmp_path: Path) -> None:
    """A GIF of 65,535 x 65,535 pixels in a few bytes is refused before four billion pixels are made."""
    head = b"GIF89a" + struct.pack("<HH", 65535, 65535) + b"\x80\0\0\0\0\0\xff\xff\xff"
    frame = b"," + struct.pack("<HHHH", 0, 0, 65535, 65535) + b"\0\x02\x02\x44\x01\0;"
    (tmp_path / "giant.gif").write_bytes(head + frame)
    script = (
        "import sys\n"
        "from gesture_core.errors import MediaError\n"
        "from gesture_core.video import open_video\n"
        "for reader in ('pyav', 'opencv'):\n"
        "    try:\n"
        "        list(open_video(sys.argv[1], reader))\n"
        "    except MediaError as error:\n"
        "        print(error.code)\n"
        "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "giant.gif")],
        capture_output=True,
        text=True,
        timeout=60,
    )
    *codes, peak = done.stdout.split()
    assert (
        codes and set(codes) <= {"E_MEDIA_LIMIT", "E_MEDIA_NO_FRAMES", "E_MEDIA_BROKEN"} and len(codes) == 2
    )
    assert int(peak) < 512 * 1024


@pytest.mark.parametrize("reader", READERS)
def test_the_report_says_when_reading_stopped_early(clips: Path, reader: str) -> None:
    with open_video(clips / "h264.mp4", reader) as video:
        for _ in video:
            break
        assert not video.report.complete and video.report.frames_read == 1
        with pytest.raises(MediaError, match="already used"):
            next(iter(video))


def test_no_descriptor_is_left_open(clips: Path) -> None:
    folder = Path("/proc/self/fd")
    if not folder.is_dir():
        pytest.skip("no /proc here")
    for reader in READERS:
        read(clips / "h264.mp4", reader)
        before = len(list(folder.iterdir()))
        for _ in range(5):
            read(clips / "h264.mp4", reader)
            code_of("/dev/null", reader)
        assert len(list(folder.iterdir())) == before


def test_the_environment_and_the_log_level_are_left_as_they_were(clips: Path) -> None:
    import av

    before, level = os.environ.get("OPENCV_FFMPEG_CAPTURE_OPTIONS"), av.logging.get_level()
    with open_video(clips / "h264.mp4", "pyav"), open_video(clips / "h264.avi", "pyav"):
        pass
    read(clips / "h264.mp4", "opencv")
    assert os.environ.get("OPENCV_FFMPEG_CAPTURE_OPTIONS") == before
    assert av.logging.get_level() == level


def test_readers_are_named() -> None:
    assert reader_name("auto") in READERS
    with pytest.raises(PluginError, match="one of opencv, pyav") as caught:
        reader_name("vlc")
    assert caught.value.code == "E_PLUGIN_UNKNOWN"
    with pytest.raises(ConfigError, match="has no option 'threads'"):
        open_video("a.mp4", "auto", options={"pyav": {"threads": 2}, "opencv": {"threads": 2}})
    with pytest.raises(ConfigError):
        VideoLimits(max_frames=0)


def looked_at(
    path: Path, reader: str, rate: float | None
) -> tuple[list[float], list[np.ndarray], VideoReport]:
    with open_video(path, reader) as video:
        items = list(at_rate(pictures(video), rate))
        return [time for time, _ in items], [frame for _, frame in items], video.report


@pytest.mark.parametrize("reader", READERS)
def test_every_frame_counts_whether_it_is_looked_at_or_not(clips: Path, reader: str) -> None:
    times, frames, whole = read(clips / "h264.mp4", reader)
    some, few, report = looked_at(clips / "h264.mp4", reader, 5)
    assert report == whole and report.frames_read == FRAMES
    assert some == times[::5]
    assert all(np.array_equal(a, b) for a, b in zip(few, frames[::5], strict=True))


@pytest.mark.parametrize("rate", [None, 0.0, 25.0, 30.0])
def test_no_rate_or_one_that_is_not_exceeded_looks_at_every_frame(clips: Path, rate: float | None) -> None:
    assert looked_at(clips / "h264.mp4", "pyav", rate)[0] == read(clips / "h264.mp4", "pyav")[0]


def test_what_is_looked_at_is_chosen_by_time_stamps(tmp_path: Path) -> None:
    stamps = [0, 33, 67, 100, 133, 167, 200, 1000, 1001, 1002, 1066, 1067, 2500]
    write_clip(tmp_path / "v.mkv", "mjpeg", frames=len(stamps), stamps=stamps)
    times = looked_at(tmp_path / "v.mkv", "pyav", 15)[0]
    np.testing.assert_allclose(times, [0, 0.067, 0.133, 0.2, 1.0, 1.066, 2.5], atol=1e-6)


@pytest.mark.parametrize(("fps", "step"), [(29.97, 2), (30, 2), (59.94, 4), (60, 4), (15, 1), (14.985, 1)])
def test_usual_rates_are_looked_at_in_even_steps(fps: float, step: int) -> None:
    rounded = np.round(np.arange(300) / fps, 3)  # to milliseconds, as Matroska does
    found = [time for time, _ in at_rate(((time, lambda: np.zeros(0)) for time in rounded.tolist()), 15)]
    np.testing.assert_array_equal(found, rounded[::step][: len(found)])
    assert len(found) >= 300 // step


@pytest.mark.parametrize(("fps", "step"), [(30, 2), (60, 4), (15, 1), (14, 1), (10, 1)])
@pytest.mark.parametrize("seed", range(5))
def test_stamps_that_jitter_choose_the_frames_that_even_ones_would(fps: float, step: int, seed: int) -> None:
    even = np.arange(300) / fps
    jitter = np.random.default_rng(seed).uniform(-0.005, 0.005, 300) * min(1, 30 / fps)
    times = np.maximum.accumulate(even + jitter)
    found = [time for time, _ in at_rate(((time, lambda: np.zeros(0)) for time in times.tolist()), 15)]
    np.testing.assert_array_equal(found, times[::step])


@pytest.mark.parametrize("odd", [float("nan"), float("inf"), 0.01])
@pytest.mark.parametrize("rate", [None, 15.0])
def test_times_that_are_none_are_an_error_of_the_video(odd: float, rate: float | None) -> None:
    times = [0.0, 0.1, 0.2, odd, 0.4]
    with pytest.raises(MediaError, match=r"E_MEDIA_BROKEN.*video\.retime"):
        list(at_rate(((time, lambda: np.zeros(0)) for time in times), rate))


def test_no_stretch_has_more_frames_than_the_rate() -> None:
    times = np.sort(np.random.default_rng(0).uniform(0, 20, 2000))
    found = np.array([at for at, _ in at_rate(((at, lambda: np.zeros(0)) for at in times.tolist()), 8)])
    assert 155 <= len(found) <= 161
    assert all(np.sum((found >= start) & (found < start + 1)) <= 9 for start in found)


def test_a_picture_that_is_not_looked_at_is_not_converted(
    clips: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from gesture_video.pyav import PyAvDecoder

    real, converted = PyAvDecoder._convert, []

    def counting(self: PyAvDecoder, frame: VideoFrame, fatal: bool) -> np.ndarray | None:
        converted.append(frame)
        return real(self, frame, fatal)

    monkeypatch.setattr(PyAvDecoder, "_convert", counting)
    times = looked_at(clips / "h264.mp4", "pyav", 5)[0]
    assert len(times) == len(converted) == -(-FRAMES // 5)


def test_a_picture_that_cannot_be_converted_is_damage_and_the_next_one_is_looked_at(
    clips: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from gesture_video.pyav import PyAvDecoder

    real, seen = PyAvDecoder._convert, []

    def fails_once(self: PyAvDecoder, frame: VideoFrame, fatal: bool) -> np.ndarray | None:
        seen.append(frame)
        if len(seen) == 2:
            self.log.damage("cannot be converted")
            return None
        return real(self, frame, fatal)

    monkeypatch.setattr(PyAvDecoder, "_convert", fails_once)
    times, _, report = looked_at(clips / "h264.mp4", "pyav", 5)
    np.testing.assert_allclose(times[:3], [0, 0.24, 0.4], atol=0.0011)
    assert report.frames_read == FRAMES - 1 and not report.complete
