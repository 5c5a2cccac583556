"""Video readers of third parties: what `VideoDecoder` does for them, and how one is named and blamed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from distributions import gesture, make_distribution
from tiny_networks import FIGURE, dot_network, dot_picture

from gesture_core.errors import MediaError, MissingDependencyError, PluginError
from gesture_core.plugin import registry
from gesture_core.plugin.interfaces import Video, VideoInfo, VideoLimits, VideoReader
from gesture_core.plugin.registry import Origin, Registration
from gesture_core.video import VideoDecoder, open_video, reader_name

STAMPS = (0.0, 0.04, None, 0.01, 0.05)
"""Of five pictures, one without a stamp, and one whose stamp runs backwards."""


@dataclass(frozen=True)
class StripesReader:
    """Draws its pictures, and fails where it is told to."""

    rotation: float = 0.0
    fails: str = ""

    def __post_init__(self) -> None:
        if self.fails == "make":
            raise MissingDependencyError("video reader 'stripes' needs stripes 2 or later")

    def open(self, path: Path, limits: VideoLimits) -> Video:
        return StripesVideo(path, limits, self)


class StripesVideo(VideoDecoder):
    name = "stripes"
    released: list[str] = []  # noqa: RUF012 - for the tests

    def __init__(self, path: Path, limits: VideoLimits, reader: StripesReader) -> None:
        self._reader = reader
        super().__init__(path, limits)

    def start(self) -> VideoInfo:
        self.resources.callback(self.released.append, str(self.path))
        if self._reader.fails == "open":
            raise KeyError("open")
        self.check_size(8, 4)
        return self.describe(
            width=8, height=4, codec="stripes", declared=5, rates=[1000.0, 25.0],
            rotation=self._reader.rotation, pixel_aspect=(4, 3),
        )  # fmt: skip

    def frames(self) -> Iterator[tuple[float | None, np.ndarray]]:
        for number, stamp in enumerate(STAMPS):
            if number == 2 and self._reader.fails == "read":
                raise KeyError("read")
            self.log.note("drawn")
            if number == 3:
                self.log.damage("stripe with a hole", 2)
            yield stamp, np.full((4 * (1 + number // 4), 8, 3), number, np.uint8)


@pytest.fixture
def clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file that begins as a video, and the reader ``stripes`` installed."""
    origin = Origin("stripes", "stripes-plugin", "1.0")
    entry = Registration("video", "stripes", f"{__name__}:StripesReader", origin)
    monkeypatch.setitem(registry().entries, ("video", "stripes"), [entry])
    StripesVideo.released.clear()
    path = tmp_path / "clip.avi"
    path.write_bytes(b"RIFF\0\0\0\0AVI and so on")
    return path


def test_what_all_readers_share_is_done_for_them(clip: Path) -> None:
    with open_video(clip, "stripes", options={"stripes": {"rotation": 89}}) as video:
        items = list(video)
    assert video.info == VideoInfo(4, 11, 5, 25.0, 90, "stripes", "avi", "stripes")
    np.testing.assert_allclose([seconds for seconds, _ in items], [0, 0.04, 0.08, 0.12, 0.16])
    assert {frame.shape for _, frame in items} == {(11, 4, 3)}
    report = video.report
    assert (report.frames_declared, report.frames_read, report.damaged) == (5, 5, 2)
    assert not report.complete and report.reader == "stripes"
    said = "; ".join(report.notes)
    for clause in (
        "pixels of 4:3 made square: 8 x 4 shown as 11 x 4",
        "placed at 25 frames/s",
        "run backwards",
        "with a hole",
        "into 4 x 11",
        "drawn (5 times)",
    ):
        assert clause in said
    assert StripesVideo.released == [str(clip)]


@pytest.mark.parametrize(("degrees", "turn"), [(-90, 270), (89, 90), (181, 180), (360, 0), (-180, 180)])
def test_any_rotation_is_the_nearest_quarter_turn(clip: Path, degrees: float, turn: int) -> None:
    with open_video(clip, "stripes", options={"stripes": {"rotation": degrees}}) as video:
        assert video.info.rotation == turn


def test_limits_hold_for_them_too(clip: Path) -> None:
    for limits in (VideoLimits(max_pixels=31), VideoLimits(max_frames=4), VideoLimits(max_seconds=0.1)):
        with pytest.raises(MediaError) as caught, open_video(clip, "stripes", limits) as video:
            list(video)
        assert caught.value.code == "E_MEDIA_LIMIT" and caught.value.remedy
    with open_video(clip, "stripes", VideoLimits(max_frames=4)) as video:
        assert video.info.frames_declared is None


def test_files_that_are_no_video_never_reach_them(clip: Path) -> None:
    clip.write_bytes(b"#EXTM3U\n")
    with pytest.raises(MediaError, match="playlist"):
        open_video(clip, "stripes")
    assert not StripesVideo.released


@pytest.mark.parametrize("moment", ["open", "read"])
def test_what_they_raise_names_them_and_releases_the_file(clip: Path, moment: str) -> None:
    options = {"stripes": {"fails": moment}}
    with pytest.raises(PluginError, match=f"(?i)stripes.* raised KeyError: '{moment}'") as caught:  # noqa: SIM117
        with open_video(clip, "stripes", options=options) as video:
            list(video)
    assert caught.value.code == "E_PLUGIN_RAISED"
    assert StripesVideo.released == [str(clip)]


def test_one_that_lacks_something_says_so(clip: Path) -> None:
    with pytest.raises(MissingDependencyError, match="stripes 2 or later"):
        reader_name("stripes", {"stripes": {"fails": "make"}})
    assert reader_name("stripes") == "stripes"


def test_readers_and_videos_fulfil_their_protocols(clip: Path) -> None:
    for name in registry().names("video", usable=True):
        assert isinstance(registry().make("video", name), VideoReader)
    video: Video = StripesReader().open(clip, VideoLimits())
    with video as same:
        assert same is video and not video.report.complete


_THINNED = """
import cv2
from gesture_core import hookimpl
from gesture_core.video import VideoDecoder

class ThinnedReader:
    def __init__(self, keep=1):
        self.keep = keep

    def open(self, path, limits):
        video = ThinnedVideo(path, limits)
        video.keep = self.keep
        return video

class ThinnedVideo(VideoDecoder):
    name = "thinned"

    def start(self):
        self.capture = cv2.VideoCapture(str(self.path))
        self.resources.callback(self.capture.release)
        return self.describe(width=96, height=96, codec="mjpeg", rates=[20.0])

    def frames(self):
        number = 0
        while (found := self.capture.read())[0]:
            if number % self.keep == 0:
                yield number / 20, found[1]
            number += 1

@hookimpl
def register_video_readers(register):
    register("thinned", "thinned_reader:ThinnedReader", needs=("cv2",))
"""


def test_a_run_takes_the_reader_of_a_third_party(tmp_path: Path) -> None:
    site = make_distribution(tmp_path / "site", "thinned-reader", _THINNED)
    for name in ("videos/a", "examples/wave/1"):
        path = tmp_path / f"{name}.avi"
        path.parent.mkdir(parents=True)
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20, (96, 96))
        for t in range(40):
            joints = FIGURE * 80 + 8
            joints[4] += [14 * np.sin(t / 3), 10 * np.cos(t / 3)]
            writer.write(dot_picture((96, 96), joints, 3))
        writer.release()
    network = dot_network(tmp_path / "dots.onnx")
    for keep, frames in ((1, 40), (2, 20)):  # another option is another run, and no stored keypoints serve it
        out = tmp_path / f"run{keep}"
        done = gesture(
            "classify", tmp_path / "videos", "--examples", tmp_path / "examples", "--out", out,
            "--preset", "paper", "--kernel", "numpy", "--model", network,
            "--set", "pose.reader=thinned", "--set", f"thinned.keep={keep}", path=site,
        )  # fmt: skip
        (row,) = (json.loads(line) for line in done.stdout.splitlines())
        assert (row["label"], row["frames_read"]) == ("wave", frames), done.stderr
