"""The suite of video readers. Each check takes a reader, and a whole video file if it needs one of its own.

>>> import pytest
>>> from gesture_core.testing import VIDEO_CHECKS
>>> @pytest.mark.parametrize("check", VIDEO_CHECKS)
... def test_my_reader(check):
...     check(MyReader())
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

import numpy as np

from gesture_core.errors import GestureError, MediaError
from gesture_core.plugin.interfaces import VideoReader
from gesture_core.records import VideoInfo, VideoLimits, VideoReport

_RATE = 10.0


class VideoCheck(Protocol):
    """A check of a video reader; ``sample`` is an undamaged video, a drawn AVI file by default."""

    __name__: str

    def __call__(self, reader: VideoReader, sample: Path | None = None) -> None: ...


def draw_video(folder: Path, frames: int = 12) -> Path:
    """An AVI file of 64 x 48 pixels at 10 frames a second, each frame brighter than the one before."""
    import cv2

    path = folder / "a clip, drawn (1).avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), _RATE, (64, 48))
    for number in range(frames):
        writer.write(np.full((48, 64, 3), 20 * number, np.uint8))
    writer.release()
    return path


@dataclass(frozen=True, eq=False)
class _Read:
    """A whole video."""

    info: VideoInfo
    times: list[float]
    frames: list[np.ndarray]
    report: VideoReport


def check_video_frames(reader: VideoReader, sample: Path | None = None) -> None:
    """(H, W, 3) uint8 frames of the size that ``info`` states, at finite seconds that never decrease."""
    name = type(reader).__name__
    assert isinstance(reader, VideoReader), f"{name} has no method open"
    with _clip(sample) as path:
        video = _whole(reader, path)
    info, times = video.info, np.array(video.times)
    assert info.width >= 1 and info.height >= 1 and info.rotation in (0, 90, 180, 270), (
        f"{name}: info is {info}, expected a size above zero and a rotation of quarter turns"
    )
    assert info.fps is None or info.fps > 0, f"{name}: fps is {info.fps}; None where the file does not say"
    for frame in video.frames:
        assert isinstance(frame, np.ndarray) and frame.dtype == np.uint8, f"{name}: a frame is no uint8 array"
        assert frame.shape == (info.height, info.width, 3), (
            f"{name}: a frame has the shape {frame.shape}, expected (H, W, 3) of info: "
            f"({info.height}, {info.width}, 3)"
        )
    assert np.isfinite(times).all() and (times >= 0).all() and (np.diff(times) >= 0).all(), (
        f"{name}: times are {times[:5]} …, expected finite seconds from the start that never decrease"
    )
    if sample is None:
        bright = [float(frame.mean()) for frame in video.frames]
        assert np.allclose(bright, 20.0 * np.arange(len(bright)), atol=5), (
            f"{name}: frames of growing brightness have the means {bright}; a frame that was handed out is "
            "not written over"
        )
        assert np.allclose(np.diff(times), 1 / _RATE, atol=1e-3), (
            f"{name}: times {times[:3]} … of a video of {_RATE:g} frames/s; they are seconds, from the file"
        )


def check_video_report(reader: VideoReader, sample: Path | None = None) -> None:
    """The report counts the frames that were handed out, and is complete at the end of a whole video only."""
    name = type(reader).__name__
    with _clip(sample) as path:
        video = _whole(reader, path)
        with reader.open(path, VideoLimits()) as begun:
            next(iter(begun), None)
            early = begun.report
    report = video.report
    assert report.frames_read == len(video.frames), (
        f"{name}: report.frames_read is {report.frames_read} after {len(video.frames)} frames"
    )
    assert report.complete and report.damaged == 0, (
        f"{name}: the report of an undamaged video is not complete: {report}"
    )
    assert not early.complete, f"{name}: the report says complete before the video was read to its end"
    assert video.info.reader and video.info.reader == report.reader, (
        f"{name}: reader is {video.info.reader!r} in info and {report.reader!r} in report, expected its name"
    )


def check_video_again(reader: VideoReader, sample: Path | None = None) -> None:
    """The same file gives the same frames, also while another one is open."""
    name = type(reader).__name__
    with _clip(sample) as path:
        first = _whole(reader, path)
        with reader.open(path, VideoLimits()) as other:
            next(iter(other), None)
            again = _whole(reader, path)
    assert first.info == again.info and first.times == again.times, f"{name}: info or times differ"
    assert all(np.array_equal(a, b) for a, b in zip(first.frames, again.frames, strict=True)), (
        f"{name}: the same file gives other frames the second time"
    )


def check_video_limits(reader: VideoReader, sample: Path | None = None) -> None:
    """What exceeds a limit is a MediaError; what just keeps it is read."""
    name = type(reader).__name__
    with _clip(sample) as path:
        whole = _whole(reader, path)
        pixels, frames, end = whole.info.width * whole.info.height, len(whole.frames), whole.times[-1]
        _whole(reader, path, VideoLimits(max_pixels=pixels, max_frames=frames, max_seconds=max(end, 1e-3)))
        tight = [VideoLimits(max_pixels=pixels - 1)]
        if end > 0:
            tight += [VideoLimits(max_frames=frames - 1), VideoLimits(max_seconds=end / 2)]
        for limits in tight:
            with suppress(MediaError):
                _read(reader, path, limits)
                raise AssertionError(
                    f"{name} reads {frames} frames of {pixels} pixels and {end:.2f} s under {limits}, "
                    "expected a MediaError"
                )


def check_video_damage(reader: VideoReader, sample: Path | None = None) -> None:
    """What is cut, damaged, missing or no video is a MediaError or is not called complete, nothing else."""
    name = type(reader).__name__
    noise = np.random.default_rng(0)
    with _clip(sample) as path, TemporaryDirectory() as place:
        frames, whole = len(_whole(reader, path).frames), path.read_bytes()
        file = Path(place, path.name)
        assert _outcome(reader, file) is None, f"{name} reads a file that is not there"
        assert _outcome(reader, file.parent) is None, f"{name} reads a folder"
        for what, content in {"no bytes": b"", "text": b"no video\n", "noise": noise.bytes(4096)}.items():
            file.write_bytes(content)
            assert _outcome(reader, file) is None, f"{name} reads a file of {what}"
        for share in (0.01, 0.3, 0.6, 0.9):
            file.write_bytes(whole[: int(share * len(whole))])
            report = _outcome(reader, file)
            assert not report or report.frames_read == frames or not report.complete, (
                f"{name}: a file of which {share:.0%} is left counts as complete, with "
                f"{report.frames_read} of {frames} frames"
            )
        for _ in range(20):
            damaged = bytearray(whole)
            for at in noise.integers(0, len(whole), 20):
                damaged[at] = noise.integers(256)
            file.write_bytes(bytes(damaged))
            _outcome(reader, file)


@contextmanager
def _clip(sample: Path | None) -> Iterator[Path]:
    """The sample, or a drawn one."""
    with TemporaryDirectory() as folder:
        yield sample or draw_video(Path(folder))


def _whole(reader: VideoReader, path: Path, limits: VideoLimits | None = None) -> _Read:
    """All of an undamaged video."""
    name = type(reader).__name__
    try:
        video = _read(reader, path, limits)
    except (GestureError, OSError) as error:
        raise AssertionError(f"{name} refuses an undamaged video: {error}") from error
    assert video.frames, f"{name} gives no frame of an undamaged video"
    return video


def _read(reader: VideoReader, path: Path, limits: VideoLimits | None = None) -> _Read:
    """All of a video that may be refused; anything but a GestureError or an OSError breaks the contract."""
    try:
        with reader.open(path, limits or VideoLimits()) as video:
            pairs = [(seconds, frame) for seconds, frame in video]
            return _Read(video.info, [at for at, _ in pairs], [frame for _, frame in pairs], video.report)
    except (GestureError, OSError):
        raise
    except Exception as error:
        raise AssertionError(f"{type(reader).__name__} raises {type(error).__name__}: {error}") from error


def _outcome(reader: VideoReader, path: Path) -> VideoReport | None:
    """The report of a file that may be damaged, or None where it was refused as it should be."""
    try:
        return _read(reader, path).report
    except (GestureError, OSError):
        return None


VIDEO_CHECKS: tuple[VideoCheck, ...] = (
    check_video_frames,
    check_video_report,
    check_video_again,
    check_video_limits,
    check_video_damage,
)
"""The suite of video readers."""
