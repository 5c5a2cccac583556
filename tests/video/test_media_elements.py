"""The chain of elements of Matroska files."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import TYPE_CHECKING, cast

import pytest
from clips import FRAMES, write_clip
from hypothesis import given
from hypothesis import strategies as st

if TYPE_CHECKING:
    from av.audio.stream import AudioStream
    from av.video.stream import VideoStream

from gesture_core.video import open_video
from gesture_core.video.integrity import matroska
from gesture_core.video.integrity.matroska import Blocks, read_blocks

pytest.importorskip("av", reason="clips are made with PyAV")


def _sized(name: str, body: bytes) -> bytes:
    return bytes.fromhex(name) + (len(body) | 1 << 28).to_bytes(4, "big") + body


BLOCK = _sized("a3", b"\x81\0\0\x80" + bytes(20))
GROUP = _sized("a0", _sized("a1", b"\x81\0\0\0" + bytes(20)) + _sized("9b", b"\x28"))
TIME = _sized("e7", b"\0")


def _film(*blocks: bytes, open_end: bool = False) -> bytes:
    clusters = [TIME + b"".join(blocks), TIME + BLOCK]
    if open_end:
        body = b"".join(bytes.fromhex("1f43b675ff") + cluster for cluster in clusters)
        return _sized("1a45dfa3", b"") + bytes.fromhex("18538067ff") + body
    body = b"".join(_sized("1f43b675", cluster) for cluster in clusters)
    return _sized("1a45dfa3", b"") + _sized("18538067", _sized("1549a966", bytes(9)) + body)


@pytest.mark.parametrize("open_end", [False, True])
def test_blocks_are_counted_with_and_without_groups_and_sizes(open_end: bool) -> None:
    film = io.BytesIO(_film(BLOCK, GROUP, _sized("a3", b"\x81\0\0\x80"), open_end=open_end))
    # A block without data is no loss.
    assert read_blocks(film) == Blocks(count=3, closed=not open_end)


def test_what_follows_the_segment_may_be_anything() -> None:
    assert read_blocks(io.BytesIO(_film(BLOCK) + b"padding")) == Blocks(count=2, closed=True)


@pytest.mark.parametrize("name", ["a2", "a7", "a1", "9b", "83", "5854", "00", "ff"])
def test_a_block_of_another_name_breaks_the_chain(name: str) -> None:
    assert read_blocks(io.BytesIO(_film(BLOCK, _sized(name, bytes(24))))).fault or name == "5854"


def test_unused_space_among_blocks_is_counted() -> None:
    assert read_blocks(io.BytesIO(_film(BLOCK, _sized("ec", bytes(24))))).voids == 1
    assert read_blocks(io.BytesIO(_sized("ec", bytes(24)) + _film(BLOCK))).voids == 0


def test_a_file_of_too_many_elements_is_not_called_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matroska, "_MAX_ELEMENTS", 4)
    assert not read_blocks(io.BytesIO(_film(BLOCK, BLOCK))).closed


@given(st.integers(0, 150))
def test_a_cut_file_is_at_fault(cut: int) -> None:
    film = _film(BLOCK, GROUP, BLOCK)
    found = read_blocks(io.BytesIO(film[: len(film) - cut]))
    assert bool(found.fault) == (cut > 0)


@given(st.binary(max_size=60), st.integers(0, 200))
def test_no_bytes_break_the_walk(noise: bytes, at: int) -> None:
    data = bytearray(_film(BLOCK, GROUP))
    data[at : at + len(noise)] = noise
    read_blocks(io.BytesIO(bytes(data)))
    read_blocks(io.BytesIO(noise))


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("plain.mkv", {}),
        ("live.mkv", {"live": "1", "cluster_size_limit": "4000"}),
        ("checked.mkv", {"write_crc32": "1", "cluster_time_limit": "200"}),
        ("front.mkv", {"cues_to_front": "1", "reserve_index_space": "5000"}),
    ],
)
def test_healthy_files_are_whole(tmp_path: Path, name: str, options: dict[str, str]) -> None:
    write_clip(tmp_path / name, "mjpeg", container_options=options)
    with (tmp_path / name).open("rb") as file:
        assert read_blocks(file) == Blocks(count=FRAMES, closed=name != "live.mkv")
    with open_video(tmp_path / name, "pyav") as video:
        assert sum(1 for _ in video) == FRAMES
    assert video.report.complete, video.report.notes


@pytest.mark.parametrize(
    ("name", "codec", "sound"), [("a.webm", "libvpx", "libopus"), ("a.mkv", "mjpeg", "aac")]
)
def test_a_film_with_sound_is_whole(tmp_path: Path, name: str, codec: str, sound: str) -> None:
    """Sounds lie several to a block, begin before the picture, and end before or after it."""
    import av
    import numpy as np

    rate = 48000
    with av.open(str(tmp_path / name), "w") as container:
        pictures = cast("VideoStream", container.add_stream(codec, rate=25))
        sounds = cast("AudioStream", container.add_stream(sound, rate=rate))
        pictures.width, pictures.height = 96, 64
        pictures.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        for index in range(FRAMES):
            picture = av.VideoFrame.from_ndarray(np.full((64, 96, 3), 7 * index, np.uint8), format="bgr24")
            container.mux(pictures.encode(picture))
            wave = av.AudioFrame.from_ndarray(np.zeros((1, 3840), np.int16), layout="stereo")
            wave.sample_rate, wave.pts = rate, 1920 * index
            container.mux(sounds.encode(wave))
        container.mux(pictures.encode(None))
        container.mux(sounds.encode(None))
    with open_video(tmp_path / name, "pyav") as video:
        assert sum(1 for _ in video) == FRAMES
    assert video.report.complete, video.report.notes


def test_a_header_that_declares_longer_sound_than_there_is_costs_no_picture(tmp_path: Path) -> None:
    write_clip(tmp_path / "whole.mkv", "mjpeg")
    data = bytearray((tmp_path / "whole.mkv").read_bytes())
    at = data.index(bytes.fromhex("448988")) + 3  # Duration, eight bytes of milliseconds
    (length,) = struct.unpack_from(">d", data, at)
    struct.pack_into(">d", data, at, length + 60)
    (tmp_path / "longer.mkv").write_bytes(bytes(data))
    with open_video(tmp_path / "longer.mkv", "pyav") as video:
        assert sum(1 for _ in video) == FRAMES
    assert video.report.complete, video.report.notes


def test_a_block_of_a_track_that_is_not_there_is_damage(tmp_path: Path) -> None:
    write_clip(tmp_path / "whole.mkv", "mjpeg")
    data = bytearray((tmp_path / "whole.mkv").read_bytes())
    images = [at for at in range(len(data) - 1) if data[at : at + 3] == b"\xff\xd8\xff"]
    assert data[images[20] - 4] == 0x81
    data[images[20] - 4] = 0x83
    (tmp_path / "lost.mkv").write_bytes(bytes(data))
    with open_video(tmp_path / "lost.mkv", "pyav") as video:
        assert sum(1 for _ in video) < FRAMES
    assert not video.report.complete


@pytest.mark.parametrize("reader", ["pyav", "opencv"])
def test_a_first_cluster_whose_name_is_lost_is_damage(tmp_path: Path, reader: str) -> None:
    write_clip(tmp_path / "whole.mkv", "mjpeg", container_options={"cluster_time_limit": "200"})
    data = bytearray((tmp_path / "whole.mkv").read_bytes())
    data[data.index(bytes.fromhex("1f43b675"), 300) + 3] ^= 1
    (tmp_path / "lost.mkv").write_bytes(bytes(data))
    with open_video(tmp_path / "lost.mkv", reader) as video:
        assert sum(1 for _ in video) < FRAMES
    assert not video.report.complete
