"""Live: the events of a recording, cameras that are slow, lost or never there, pipes, and what is said."""

from __future__ import annotations

import io
import json
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from streams import examples_of, strung
from test_spot_runs import save

from gesture_core import Spotter, load_poses, load_settings, spot_archive, watch
from gesture_core.cli.main import run as gesture
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.run.watch import source_of
from gesture_core.spot.capture import Capture, Captured, Note
from gesture_core.spot.sources import Frame, Keypoints, piped
from gesture_core.spot.watch import Seen, Watch
from gesture_core.types import Event, PoseSequence
from gesture_core.video import open_video
from gesture_core.video.writer import VideoWriter

pytestmark = pytest.mark.usefixtures("in_this_process")

SETTINGS = load_settings(None, ["spot.tempos="], environment={})


@pytest.fixture(scope="module")
def string(drawn: DemoArchive) -> PoseSequence:
    return strung(load_poses(drawn.video_keypoints, workers=1)[:5])[0]


def facts(events: list[Event]) -> list[tuple[str, float, float, float]]:
    return sorted((event.label, event.start, event.end, event.distance) for event in events)


def test_a_recording_played_as_live_has_the_events_of_spot(
    drawn: DemoArchive, string: PoseSequence, tmp_path: Path
) -> None:
    save(tmp_path / "long.npz", string)
    seen = list(watch(tmp_path / "long.npz", drawn.example_keypoints, SETTINGS))
    assert seen
    summary = spot_archive(
        tmp_path / "long.npz", drawn.example_keypoints, tmp_path / "run", SETTINGS,
        engine="inline", spot__live=True,
    )  # fmt: skip
    rows: list[Any] = [(row.label, row.start, row.end, row.distance) for row in summary.rows() if row.event]
    assert facts(seen) == sorted(rows)


@dataclass
class FakeCamera:
    """A camera whose frames a test makes: each of its lists is one connection, which ends with an error."""

    connections: list[list[Frame]]
    name: str = "fake"
    live: bool = True
    paced: bool = True
    pictures: bool = False
    opened: int = 0
    patient: Capture | None = None
    """Whose queue is empty before the next frame comes: as fast as frames are looked at."""

    def frames(self, say: Callable[[str], None]) -> Iterator[Frame]:
        if self.opened >= len(self.connections):
            return
        mine = self.connections[self.opened]
        self.opened += 1
        if not mine:
            raise InputError("cannot be opened", subject=self.name, code="E_SOURCE")
        for frame in mine:
            yield frame
            while self.patient and self.patient._frames:
                time.sleep(0.001)
        raise InputError("was lost", subject=self.name, code="E_SOURCE")


def frames_of(pose: PoseSequence, start: int, stop: int) -> list[Frame]:
    return [
        (float(pose.times[number]), lambda number=number: pose.part(slice(number, number + 1)))  # type: ignore[misc]
        for number in range(start, stop)
    ]


def everything(capture: Capture) -> tuple[list[Captured], list[Note]]:
    frames, notes = list[Captured](), list[Note]()
    while True:
        try:
            found = capture.next(5)
        except EOFError:
            return frames, notes
        if isinstance(found, Captured):
            frames.append(found)
        elif found:
            notes.append(found)


def test_the_newest_frame_of_a_camera_wins_and_a_file_drops_none(string: PoseSequence) -> None:
    camera = FakeCamera([frames_of(string, 0, 50)])
    with Capture(camera, waits=(0.01,)) as capture:
        time.sleep(0.3)  # nobody looks
        frames, _ = everything(capture)
    assert [frame.seconds for frame in frames] == [string.times[49]]
    assert capture.dropped == 49
    with Capture(Keypoints(string)) as capture:
        time.sleep(0.1)
        frames, notes = everything(capture)
    assert [frame.seconds for frame in frames] == string.times.tolist()
    assert (capture.dropped, notes) == (0, [])


def test_a_lost_camera_is_opened_again_and_said(string: PoseSequence) -> None:
    camera = FakeCamera([frames_of(string, 0, 1), [], [], frames_of(string, 1, 2)])
    with Capture(camera, waits=(0.01, 0.02)) as capture:
        frames, notes = everything(capture)
    assert frames and camera.opened == 4
    texts = [note.text for note in notes]
    assert texts == [
        "fake: was lost; opened again in 0.01 s",
        "fake: cannot be opened; opened again in 0.02 s",
        "fake: cannot be opened; opened again in 0.02 s",
        "fake: is back after 0 s",
        "fake: was lost; opened again in 0.01 s",
    ]
    with Capture(FakeCamera([[]])) as capture, pytest.raises(InputError, match="cannot be opened"):
        everything(capture)


def test_what_waits_is_said_when_the_camera_goes_quiet_and_the_end_is_clean(
    drawn: DemoArchive, string: PoseSequence
) -> None:
    """The camera is lost right after a gesture: its event is not, and latencies are those of the clock."""
    poses, labels = examples_of(drawn)
    spotter = Spotter(poses, labels, SETTINGS, live=True)
    whole = spotter.push(string) + spotter.finish()
    last = int(np.searchsorted(string.times, whole[0].end + 0.12))
    camera = FakeCamera([frames_of(string, 0, last + 1)])
    camera.patient = capture = Capture(camera, waits=(1.2,))
    with capture:
        looking = Watch(capture, spotter, None, gap=0.5)
        found = list(looking)
    seen = [one for one in found if isinstance(one, Seen)]
    lost = next(place for place, one in enumerate(found) if isinstance(one, Note))
    assert found.index(seen[0]) > lost
    assert facts([one.event for one in seen])[0][0] == whole[0].label
    assert looking.summary.events == len(seen)
    assert (looking.summary.frames, looking.summary.dropped) == (last + 1, 0)


def openpose(pose: PoseSequence, number: int) -> dict[str, Any]:
    rows = np.concatenate([pose.keypoints[number], pose.scores[number][:, None]], axis=1).tolist()
    return {
        "time": float(pose.times[number]),
        "keypoints": [None if np.isnan(row[0]) else row for row in rows],
    }


def test_keypoints_through_a_pipe_have_the_same_events(drawn: DemoArchive, string: PoseSequence) -> None:
    poses, labels = examples_of(drawn)
    spotter = Spotter(poses, labels, SETTINGS, live=True)
    expected = spotter.push(string) + spotter.finish()
    lines = [json.dumps(openpose(string, number)) for number in range(len(string))]
    lines.insert(3, "{nonsense")
    lines.insert(5, '{"time": 0, "keypoints": null}')
    lines.insert(7, f'{{"time": 1{"0" * 400}, "keypoints": null}}')
    source = piped(io.BytesIO("\n".join(lines).encode()))
    with Capture(source) as capture:
        looking = Watch(capture, spotter, None, gap=1.0)
        found = [one for one in looking if one]
    events = [one.event for one in found if isinstance(one, Seen)]
    assert [(e.label, e.start, e.end) for e in events] == [(e.label, e.start, e.end) for e in expected]
    said = [one.text for one in found if isinstance(one, Note)]
    assert len(said) == 3 and "line 4 is left out" in said[0] and "before the last one" in said[1]
    assert "line 8 is left out" in said[2]


def test_pictures_through_a_pipe_are_told_apart(tmp_path: Path) -> None:
    pictures = [np.full((40, 60, 3), 50 * number, np.uint8) for number in range(1, 4)]
    data = b"".join(cv2.imencode(".jpg", picture)[1].tobytes() for picture in pictures)
    source = piped(io.BytesIO(data))
    given = [give() for _, give in source.frames(print)]
    assert [round(float(one.mean())) for one in given if isinstance(one, np.ndarray)] == [50, 100, 150]
    assert (source.live, source.pictures) == (True, True)
    with pytest.raises(InputError, match="begins with"):
        piped(io.BytesIO(b"RIFF"))
    with pytest.raises(InputError, match="is empty"):
        piped(io.BytesIO(b""))


def test_sources_that_are_none_are_refused(tmp_path: Path, drawn: DemoArchive) -> None:
    (tmp_path / "note.txt").write_text("nothing", "utf-8")
    assert source_of("0", SETTINGS).name == "camera 0"
    assert source_of("rtsp://me:secret@host/1", SETTINGS).name == "rtsp://host/1"
    assert source_of("rtsp://host/1?token=secret", SETTINGS).name == "rtsp://host/1"
    assert source_of("http://me:secret@host/1;secret?a=secret#secret", SETTINGS).name == "http://host/1"
    assert "cret" not in source_of("rtsp://me:se?cret@host/1", SETTINGS).name
    for source in (tmp_path / "none.mp4", tmp_path / "note.txt", drawn.videos):
        with pytest.raises(GestureError):
            source_of(source, SETTINGS)
    with pytest.raises(ConfigError, match="one person"):
        next(watch(drawn.videos, drawn.example_keypoints, pose__people="multi"))
    with pytest.raises(InputError, match="cannot be opened"):
        next(watch("http://127.0.0.1:9/", drawn.example_keypoints, SETTINGS))


@pytest.fixture(scope="module")
def film(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of three drawn clips, one after the other, with a second of rest between them."""
    pytest.importorskip("av")
    path, now = tmp_path_factory.mktemp("film") / "long.mp4", 0.0
    with VideoWriter(path, quality=12) as writer:
        clips = sorted(drawn.videos.iterdir())
        for clip in (clips[0], clips[2], clips[7]):  # clear ones: clap, wave, raise-arms
            with open_video(clip) as video:
                for at, frame in video:
                    writer.add(now + at, frame)
            for rest in range(1, 20):
                writer.add(now + at + rest / 20, frame)
            now += at + 1.0
    return path


def test_pixels_as_live_have_the_events_of_spot(
    drawn: DemoArchive, film: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the packaged network, whose live keypoints cannot know the frames to come."""
    changes = ["--set", "spot.tempos=", "--set", "spot.live=true"]
    out = tmp_path / "run"
    assert gesture(["spot", str(film), "--examples", str(drawn.examples), "--out", str(out), *changes]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert gesture(["watch", str(film), "--examples", str(drawn.examples), *changes]) == 0
    done = capsys.readouterr()
    seen = [json.loads(line) for line in done.out.splitlines()]
    assert [(one["label"]) for one in seen] == [row["label"] for row in rows if row["event"]] != []
    for one, row in zip(seen, rows, strict=True):
        both = min(one["end"], row["end"]) - max(one["start"], row["start"])
        assert both > 0.8 * (max(one["end"], row["end"]) - min(one["start"], row["start"]))
    summary = json.loads(done.err.splitlines()[-1])
    assert (summary["event"], summary["events"], summary["dropped"]) == ("done", len(seen), 0)
    assert summary["with_pose"] == summary["frames"] > 50


def test_ctrl_c_ends_it_with_what_is_known_and_a_summary(
    drawn: DemoArchive, string: PoseSequence, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    save(tmp_path / "long.npz", string)
    taken, count = Capture.next, len(string) - 3

    def interrupted(capture: Capture, timeout: float) -> Captured | Note | None:
        nonlocal count
        count -= 1
        if count == 0:
            raise KeyboardInterrupt
        return taken(capture, timeout)

    monkeypatch.setattr(Capture, "next", interrupted)
    words = ["watch", str(tmp_path / "long.npz"), "--examples", str(drawn.example_keypoints)]
    assert gesture([*words, "--set", "spot.tempos="]) == 0
    done = capsys.readouterr()
    lines = [json.loads(line) for line in done.out.splitlines()]
    assert lines and {"label", "start", "end", "score", "late", "at"} <= lines[0].keys()
    said = [json.loads(line) for line in done.err.splitlines() if line.startswith("{")]
    assert said[-1]["events"] == len(lines)
    number = len(list(drawn.example_keypoints.glob("*/*")))
    assert (said[0]["event"], said[0]["inputs"], said[0]["examples"]) == ("planned", 1, number)


def test_a_camera_that_cannot_be_opened_is_the_error_and_no_summary(
    drawn: DemoArchive, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["watch", "http://me:secret@127.0.0.1:9/", "--examples", str(drawn.example_keypoints)]
    assert gesture(words) == 1
    said = capsys.readouterr().err
    assert "cannot be opened" in said and "its address and password" in said
    assert "secret" not in said and '"done"' not in said and "0 frames" not in said


def test_the_preview_shows_frames_to_who_knows_its_address(string: PoseSequence) -> None:
    import urllib.error
    import urllib.request

    from gesture_core.report.preview import Preview

    picture = np.full((96, 128, 3), 200, np.uint8)
    with Preview() as preview:
        for address, host in ((preview.address[:-10] + "/", None), (preview.address, "elsewhere.example")):
            request = urllib.request.Request(address, headers={"Host": host} if host else {})
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(request, timeout=10)
        done = threading.Event()

        def frames() -> None:
            while not done.wait(0.01):
                preview.show(picture, string.part(slice(0, 1)))

        camera = threading.Thread(target=frames)
        camera.start()
        try:
            with urllib.request.urlopen(preview.address, timeout=30) as answer:
                got = b""
                while b"\xff\xd9" not in got:
                    got += answer.read1(1 << 16)
        finally:
            done.set()
            camera.join()
        data = got[got.index(b"\xff\xd8") :]
        shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert shown is not None and shown.shape == (96, 128, 3)
    assert picture.min() == 200
