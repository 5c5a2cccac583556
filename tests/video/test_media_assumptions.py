"""What a video does not say, or says of its pixels and streams: squared, chosen, and never kept quiet."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from clips import SIZE, picture, write_clip

from gesture_core.errors import MediaError
from gesture_core.plugin.interfaces import VideoInfo, VideoLimits, VideoReport
from gesture_core.settings.schema import VideoSettings
from gesture_core.video import open_video
from gesture_core.video.integrity.matroska import track_types

av = pytest.importorskip("av", reason="clips are made with PyAV")
if TYPE_CHECKING:
    from av.video.stream import VideoStream

READERS = ("pyav", "opencv")


@dataclass(frozen=True)
class Read:
    info: VideoInfo
    times: list[float]
    frames: list[np.ndarray]
    report: VideoReport

    @property
    def notes(self) -> str:
        return "; ".join(self.report.notes)


def read(path: Path, reader: str = "pyav", rates: VideoSettings | None = None) -> Read:
    with open_video(path, reader, VideoLimits(), rates=rates) as video:
        items = list(video)
        assert all(frame.shape == (video.info.height, video.info.width, 3) for _, frame in items)
        return Read(video.info, [at for at, _ in items], [frame for _, frame in items], video.report)


@dataclass(frozen=True)
class Track:
    """A stream to write: its pictures, and what the container says of it."""

    frames: int = 20
    size: tuple[int, int] = SIZE
    codec: str = "mpeg4"
    format: str = "yuv420p"
    title: str = ""
    default: bool = False
    cover: bool = False
    pixels: Fraction | None = None
    first: int = 0


def write_tracks(path: Path, tracks: Sequence[Track], fps: int = 10) -> Path:
    with av.open(str(path), "w") as container:
        streams = []
        for track in tracks:
            stream = cast("VideoStream", container.add_stream(track.codec, rate=fps))
            stream.width, stream.height = track.size
            stream.pix_fmt = track.format
            if track.pixels:
                stream.codec_context.sample_aspect_ratio = track.pixels
            if track.title:
                stream.metadata["title"] = stream.metadata["handler_name"] = track.title
            flags = av.stream.Disposition(0)
            flags |= av.stream.Disposition.default if track.default else flags
            flags |= av.stream.Disposition.attached_pic if track.cover else flags
            if flags:
                stream.disposition = flags
            streams.append(stream)
        for index in range(max(track.frames for track in tracks)):
            for stream, track in zip(streams, tracks, strict=True):
                if index < track.frames:
                    array = picture(index + track.first, *track.size)
                    frame = av.VideoFrame.from_ndarray(array, format="bgr24").reformat(format=track.format)
                    frame.pts, frame.time_base = index, Fraction(1, fps)
                    container.mux(stream.encode(frame))
        for stream in streams:
            container.mux(stream.encode())
    return path


# ---- pixels that are not square


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi", "mpg"])
@pytest.mark.parametrize(
    ("pixels", "size"),
    [(Fraction(64, 45), (137, 64)), (Fraction(1, 2), (96, 128)), (Fraction(8, 9), (96, 72))],
)
def test_pixels_that_are_not_square_are_squared(
    tmp_path: Path, reader: str, suffix: str, pixels: Fraction, size: tuple[int, int]
) -> None:
    codec = "mpeg2video" if suffix == "mpg" else "mpeg4"
    if suffix == "mpg":  # MPEG-2 knows the shape of the screen only: 4:3, 16:9, 2.21:1
        pixels, size = Fraction(4, 3) / Fraction(96, 64), (96, 72)
    rate = 25 if suffix == "mpg" else 10
    found = read(write_tracks(tmp_path / f"v.{suffix}", [Track(codec=codec, pixels=pixels)], rate), reader)
    assert (found.info.width, found.info.height) == size
    assert f"made square: 96 x 64 shown as {size[0]} x {size[1]}" in found.notes
    assert found.report.complete and not found.report.damaged
    plain = (
        read(write_tracks(tmp_path / f"p.{suffix}", [Track(codec=codec)], rate), reader)
        if codec == "mpeg4"
        else found
    )
    assert len(plain.frames) == len(found.frames) == 20
    # The bright block is where it is in the picture without the note, stretched.
    (y, x), (y0, x0) = (np.mean(np.nonzero(f[..., 1] > 200), axis=1) for f in (found.frames[9], picture(9)))
    np.testing.assert_allclose([x / size[0], y / size[1]], [x0 / SIZE[0], y0 / SIZE[1]], atol=0.03)


@pytest.mark.parametrize("reader", READERS)
def test_the_containers_word_on_pixels_counts_more_than_the_codecs(tmp_path: Path, reader: str) -> None:
    path = write_tracks(tmp_path / "v.mp4", [Track(codec="libx264", pixels=Fraction(4, 3))])
    before, after = (b"pasp" + struct.pack(">2I", *pixels) for pixels in ((4, 3), (2, 1)))
    assert path.read_bytes().count(before) == 1
    path.write_bytes(path.read_bytes().replace(before, after))
    found = read(path, reader)
    assert (found.info.width, found.info.height) == (192, 64) and len(found.report.notes) == 1


@pytest.mark.parametrize("reader", READERS)
def test_pixels_that_are_square_but_for_a_rounding_cost_no_note(tmp_path: Path, reader: str) -> None:
    found = read(write_tracks(tmp_path / "v.mp4", [Track(pixels=Fraction(193, 192))]), reader)
    assert (found.info.width, found.info.height) == SIZE and found.report.notes == ()


@pytest.mark.parametrize("reader", READERS)
def test_square_pixels_cost_no_note(tmp_path: Path, reader: str) -> None:
    found = read(write_tracks(tmp_path / "v.mp4", [Track(pixels=Fraction(1, 1))]), reader)
    assert found.report.notes == () and found.report.assumed == ""


@pytest.mark.parametrize("reader", READERS)
def test_implausible_pixels_are_taken_as_square(tmp_path: Path, reader: str) -> None:
    found = read(write_tracks(tmp_path / "v.mp4", [Track(codec="libx264", pixels=Fraction(1, 20))]), reader)
    assert (found.info.width, found.info.height) == SIZE and "implausible" in found.notes


@pytest.mark.parametrize("reader", READERS)
def test_the_limit_on_pixels_is_one_on_squared_ones(tmp_path: Path, reader: str) -> None:
    path = write_tracks(tmp_path / "v.mp4", [Track(pixels=Fraction(2, 1))])
    with open_video(path, reader, VideoLimits(max_pixels=192 * 64)) as video:
        assert video.info.width == 192
    with pytest.raises(MediaError) as caught:
        open_video(path, reader, VideoLimits(max_pixels=192 * 64 - 1))
    assert caught.value.code == "E_MEDIA_LIMIT"


def test_pixels_that_change_half_way_are_followed(tmp_path: Path) -> None:
    """A broadcast goes from 4:3 to 16:9: what comes later is fitted into the first size, undistorted."""
    for name, pixels in (("a", Fraction(1, 1)), ("b", Fraction(2, 1))):
        write_tracks(
            tmp_path / f"{name}.ts",
            [Track(codec="mpeg2video", pixels=None)]
            if pixels == 1
            else [Track(codec="libx264", pixels=pixels)],
            25,
        )
    for name, pixels in (("a", Fraction(1, 1)), ("b", Fraction(2, 1))):
        write_tracks(tmp_path / f"{name}.h264", [Track(codec="libx264", pixels=pixels)], 25)
    joined = tmp_path / "j.h264"
    joined.write_bytes((tmp_path / "a.h264").read_bytes() + (tmp_path / "b.h264").read_bytes())
    found = read(joined)
    assert len(found.frames) == 40 and "pixels become 2:1 half-way" in found.notes
    assert found.frames[5][:8].any() and not found.frames[-1][:8].any()


# ---- times that a video does not have


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(("suffix", "codec"), [("h264", "h264"), ("hevc", "hevc")])
def test_a_stream_without_times_says_what_was_assumed(
    tmp_path: Path, reader: str, suffix: str, codec: str
) -> None:
    write_clip(tmp_path / f"v.{suffix}", codec, frames=20, fps=50)
    found = read(tmp_path / f"v.{suffix}", reader)
    rate = 50 if reader == "pyav" else 25  # OpenCV does not see what the codec says
    np.testing.assert_allclose(found.times, np.arange(20) / rate, atol=1e-9)
    says = "50 frames/s, as its codec says (video.fps)"
    assert found.report.assumed == (says if reader == "pyav" else "25 frames/s (video.fps)")
    assert found.report.notes == () or reader == "opencv"


def test_a_stream_that_says_nothing_of_its_rate(tmp_path: Path) -> None:
    write_clip(tmp_path / "v.hevc", "hevc", frames=9, fps=50, options={"x265-params": "vui-timing-info=0"})
    found = read(tmp_path / "v.hevc")
    assert found.info.fps is None and found.report.assumed == "25 frames/s (video.fps)"
    np.testing.assert_allclose(found.times, np.arange(9) / 25, atol=1e-9)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("suffix", ["h264", "mp4"])
def test_the_settings_give_times_and_say_so(tmp_path: Path, reader: str, suffix: str) -> None:
    write_clip(tmp_path / f"v.{suffix}", "h264", frames=20, fps=50)
    found = read(tmp_path / f"v.{suffix}", reader, VideoSettings(retime=10))
    np.testing.assert_allclose(found.times, np.arange(20) / 10, atol=1e-9)
    assert found.info.fps == 10 and found.report.complete
    instead = " instead of its own times" if suffix == "mp4" else ""
    assert found.report.assumed == f"10 frames/s{instead} (video.retime)"
    own = read(tmp_path / f"v.{suffix}", reader, VideoSettings(fps=10))
    if suffix == "mp4":  # its own times stay: an archive of streams may have examples that have some
        np.testing.assert_allclose(own.times, np.arange(20) / 50, atol=0.001)
        assert own.info.fps == 50 and "its own times, not video.fps" in own.report.assumed
    else:
        np.testing.assert_allclose(own.times, found.times)
        assert own.report.assumed == "10 frames/s (video.fps)"


@pytest.mark.parametrize("reader", READERS)
def test_a_variable_rate_keeps_its_times_and_is_noted(tmp_path: Path, reader: str) -> None:
    stamps = [0, 40, 80, 280, 320, 520, 560, 760, 960, 1000]
    write_clip(tmp_path / "v.mkv", "mjpeg", frames=len(stamps), stamps=stamps)
    found = read(tmp_path / "v.mkv", reader)
    np.testing.assert_allclose(found.times, np.array(stamps) / 1000, atol=1e-6)
    assert "variable frame rate, 5 to 25 frames/s; times are those of the file" in found.notes
    write_clip(tmp_path / "c.mkv", "mjpeg", fps=30)  # rounded to milliseconds
    assert "variable" not in read(tmp_path / "c.mkv", reader).notes


@pytest.mark.parametrize("reader", READERS)
def test_a_pause_is_noted(tmp_path: Path, reader: str) -> None:
    stamps = [*range(0, 800, 40), *range(9000, 9800, 40)]
    write_clip(tmp_path / "v.mkv", "mjpeg", frames=len(stamps), stamps=stamps)
    found = read(tmp_path / "v.mkv", reader)
    assert "no frame for 8.2 s after 0.8 s, by the file's times" in found.notes


# ---- several streams of pictures

CLIP = Track(first=5)
PREVIEW = Track(frames=1, size=(32, 32))
SEVERAL = {
    "a preview of one frame before the clip": [PREVIEW, CLIP],
    "a preview of one frame that is the default": [Track(frames=1, size=(32, 32), default=True), CLIP],
    "a larger picture": [Track(frames=1, size=(192, 128)), CLIP],
    "a short preview": [Track(frames=4, size=(32, 32)), CLIP],
    "a small preview as long": [Track(size=(32, 32)), CLIP],
    "the default after another one": [Track(), Track(first=5, default=True)],
    "the default before a longer one": [Track(first=5, default=True), Track(frames=30)],
    "depth by its name": [Track(title="Depth map"), CLIP],
    "depth by its pixels": [Track(codec="ffv1", format="gray16le"), CLIP],
    "grey pictures": [Track(codec="ffv1", format="gray"), CLIP],
}


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "ts"])
@pytest.mark.parametrize("case", SEVERAL)
def test_the_clip_is_read_and_not_what_lies_beside_it(tmp_path: Path, case: str, suffix: str) -> None:
    tracks = SEVERAL[case]
    if suffix != "mkv" and any(track.codec == "ffv1" for track in tracks):
        pytest.skip(f"no such codec in {suffix}")
    if suffix == "ts" and ("default" in case or "name" in case):
        pytest.skip("a transport stream names nothing, and has no default")
    found = read(write_tracks(tmp_path / f"v.{suffix}", tracks))
    (wanted,) = (track for track in tracks if track.first)
    assert len(found.frames) == wanted.frames, found.notes
    assert (found.info.width, found.info.height) == wanted.size
    assert np.abs(found.frames[3].astype(int) - picture(8)).mean() < 20, "the other stream"
    number = tracks.index(wanted)
    assert (
        f"2 video streams: number {number} (96 x 64" in found.notes and "is read, not number" in found.notes
    )
    assert found.report.complete, found.notes


def test_lengths_are_counted_where_the_container_has_none(tmp_path: Path) -> None:
    whole = write_tracks(tmp_path / "v.mkv", [PREVIEW, CLIP]).read_bytes()
    (tmp_path / "v.mkv").write_bytes(whole.replace(b"DURATION", b"XURATION"))
    found = read(tmp_path / "v.mkv")
    assert len(found.frames) == CLIP.frames and "1 frame)" in found.notes


def test_cover_art_is_no_video_and_does_not_hide_one(tmp_path: Path) -> None:
    cover = Track(frames=1, size=(64, 64), codec="mjpeg", format="yuvj420p", cover=True)
    found = read(write_tracks(tmp_path / "v.mp4", [CLIP, cover]))
    assert len(found.frames) == CLIP.frames and "cover art" in found.notes
    with pytest.raises(MediaError) as caught:
        read(write_tracks(tmp_path / "c.mp4", [cover]))
    assert caught.value.code == "E_MEDIA_NO_VIDEO"


def test_what_looks_like_a_track_among_the_data_is_none(tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "v.mkv", [CLIP, Track(size=(32, 32))])
    with path.open("rb") as file:
        assert track_types(file) == [1, 1]
    path = write_tracks(tmp_path / "v.mkv", [CLIP])
    path.write_bytes(path.read_bytes() + b"\x86\x85V_VP8\xae\x83\x83\x81\x01" * 3)
    assert not any("video streams" in note for note in read(path, "opencv").notes)
    for cut in range(0, path.stat().st_size, 97):
        (tmp_path / "cut.mkv").write_bytes(path.read_bytes()[:cut])
        with (tmp_path / "cut.mkv").open("rb") as file:
            assert len(track_types(file)) <= 1


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi", "wmv", "ts"])
def test_opencv_says_that_it_cannot_choose(tmp_path: Path, suffix: str) -> None:
    tracks = [CLIP, Track(size=(32, 32))]
    if suffix == "ts":  # a codec that OpenCV finds there
        tracks = [replace(track, codec="libx264") for track in tracks]
    found = read(write_tracks(tmp_path / f"v.{suffix}", tracks), "opencv")
    assert "2 video streams, of which OpenCV reads the first" in found.notes
    with pytest.raises(MediaError, match="the first of its 2 video streams is a picture"):
        read(write_tracks(tmp_path / f"p.{suffix}", [PREVIEW, CLIP]), "opencv")


def test_the_header_inside_a_recording_is_no_second_stream(tmp_path: Path) -> None:
    """Some recorders write fragments, and at the end a header that hides the first one among the data."""
    whole = write_tracks(tmp_path / "v.mp4", [CLIP]).read_bytes()
    start = whole.index(b"moov") - 4
    hidden = whole[start : start + int.from_bytes(whole[start : start + 4], "big")]
    hidden = struct.pack(">I4s", 8 + len(hidden), b"free") + hidden
    (tmp_path / "v.mp4").write_bytes(whole + hidden)
    assert read(tmp_path / "v.mp4", "opencv").report.notes == ()


def test_interlaced_pictures_are_shown_or_refused(tmp_path: Path) -> None:
    """Some releases of OpenCV cannot convert them, and give memory as it was in their place."""
    path = tmp_path / "v.mpg"
    write_clip(path, "mpeg2video", frames=20, options={"flags": "+ildct+ilme", "b": "4M"})
    shown = read(path).frames
    assert len(shown) == 20
    try:
        found = read(path, "opencv").frames
    except MediaError as error:
        assert "20 pictures are one" in error.cause and "gesture-core[video]" in str(error.remedy)
    else:
        assert np.abs(found[9].astype(int) - shown[9]).mean() < 5
    write_clip(tmp_path / "still.mkv", "mjpeg", frames=1)
    assert len(read(tmp_path / "still.mkv", "opencv").frames) == 1


# ---- side data that PyAV does not know


def write_exif(path: Path, orientation: int) -> Path:
    """Motion JPEG with the EXIF of a camera in each picture.

    FFmpeg 8 hands it on as side data of kind 31, as it does the view of a spatial video as 29. PyAV 18 knows
    neither, and refuses all side data of such a frame.
    """
    tiff = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 0x112, 3, 1, orientation, 0, 0)
    exif = b"\xff\xe1" + struct.pack(">H", len(tiff) + 8) + b"Exif\0\0" + tiff
    with av.open(str(path), "w") as container:
        stream = cast("VideoStream", container.add_stream("mjpeg", rate=10))
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuvj420p"
        for index in range(5):
            frame = av.VideoFrame.from_ndarray(picture(index), format="bgr24").reformat(format="yuvj420p")
            frame.pts, frame.time_base = index, Fraction(1, 10)
            for plain in stream.encode(frame):
                data = bytes(plain)
                packet = av.Packet(data[:2] + exif + data[2:])
                packet.pts, packet.dts, packet.time_base = plain.pts, plain.dts, plain.time_base
                packet.stream, packet.is_keyframe = stream, True
                container.mux(packet)
    return path


@pytest.mark.parametrize(
    ("orientation", "upright"),
    [
        (1, lambda f: f),
        (2, lambda f: f[:, ::-1]),
        (3, lambda f: f[::-1, ::-1]),
        (4, lambda f: f[::-1]),
        (5, lambda f: f.swapaxes(0, 1)),
        (6, lambda f: np.rot90(f, -1)),
        (8, lambda f: np.rot90(f, 1)),
    ],
)
def test_unknown_side_data_costs_nothing(
    tmp_path: Path, orientation: int, upright: Callable[[np.ndarray], np.ndarray]
) -> None:
    path = write_exif(tmp_path / "v.mkv", orientation)
    with av.open(str(path)) as container:
        frame = next(container.decode(video=0))
        try:
            pytest.skip(f"this PyAV knows them: {frame.side_data}")
        except ValueError as error:
            if "is not a valid Type" not in str(error):
                raise
    plain = read(write_exif(tmp_path / "p.mkv", 1))
    found = read(path)
    assert found.report.complete and len(found.frames) == 5 and not found.report.notes
    np.testing.assert_array_equal(found.frames[3], upright(plain.frames[3]))
