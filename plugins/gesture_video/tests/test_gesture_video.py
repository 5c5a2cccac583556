"""Both readers on a clip that is written here."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from gesture_core.plugin.registry import registry
from gesture_core.video import open_video

FRAMES, RATE = 20, 10


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A brighter picture ten times a second."""
    path = tmp_path_factory.mktemp("clip") / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE, (64, 48))
    for index in range(FRAMES):
        writer.write(np.full((48, 64, 3), 10 * index, np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize("reader", ["pyav", "opencv"])
def test_a_clip_is_read_whole_upright_and_on_time(clip: Path, reader: str) -> None:
    if missing := registry().find("video", reader).missing:
        pytest.skip(f"not installed: {', '.join(missing)}")
    with open_video(clip, reader) as video:
        times, frames = zip(*video, strict=True)
    assert (video.info.width, video.info.height, video.info.fps) == (64, 48, RATE)
    np.testing.assert_allclose(times, np.arange(FRAMES) / RATE, atol=1e-6)
    np.testing.assert_allclose([frame.mean() for frame in frames], 10 * np.arange(FRAMES), atol=3)
    assert video.report.complete and video.report.reader == reader


@pytest.mark.parametrize("reader", ["pyav", "opencv"])
def test_a_cut_clip_is_not_called_complete(clip: Path, tmp_path: Path, reader: str) -> None:
    if missing := registry().find("video", reader).missing:
        pytest.skip(f"not installed: {', '.join(missing)}")
    data = clip.read_bytes()
    cut = tmp_path / "cut.avi"
    cut.write_bytes(data[: len(data) * 6 // 10])
    with open_video(cut, reader) as video:
        assert 0 < sum(1 for _ in video) < FRAMES
    assert not video.report.complete and video.report.notes
