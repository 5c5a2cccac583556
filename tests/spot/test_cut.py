"""Events as clips: exactly their frames, by label, readable as examples, one bad input for itself."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from streams import strung
from test_spot_runs import save

from gesture_core import classify_archive, cut_events, load_poses, load_settings, spot_archive
from gesture_core.cli.main import run as gesture
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import ConfigError, GestureError
from gesture_core.files import content_sha256
from gesture_core.run.inputs import Input
from gesture_core.run.results import Results, open_results
from gesture_core.types import Row
from gesture_core.video import open_video
from gesture_core.video.writer import VideoWriter

pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.fixture(scope="module")
def recordings(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings of six clips each, as keypoints."""
    folder = tmp_path_factory.mktemp("long")
    poses = load_poses(drawn.video_keypoints, workers=1)
    save(folder / "one.npz", strung(poses[:6])[0])
    save(folder / "two.npz", strung(poses[6:])[0])
    return folder


@pytest.fixture(scope="module")
def spotted(drawn: DemoArchive, recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("spotted") / "run"
    spot_archive(recordings, drawn.example_keypoints, out, engine="inline", spot__tempos=())
    return out


def a_run(folder: Path, rows: list[Row], place: Path, *changes: str) -> Path:
    """A run folder with these rows, all about the file ``place``."""
    settings = load_settings(None, changes, environment={})
    folder.mkdir()
    with Results(folder, create=True) as results:
        results.set({"configuration": {"settings": settings.as_dict()}})
        by_input: dict[str, list[Row]] = {}
        for row in rows:
            by_input.setdefault(row.input, []).append(row)
        for name, some in by_input.items():
            results.commit(Input(place.parent / Path(name).name, name, "video"), some)
    return folder


def test_clips_of_keypoints_hold_the_events_and_serve_as_examples(
    drawn: DemoArchive, recordings: Path, spotted: Path, tmp_path: Path
) -> None:
    clips = cut_events(spotted, tmp_path / "clips")
    with open_results(spotted) as results:
        rows = [row for row in results.rows() if row.event]
    assert [(c.input, c.event, c.start, c.end, c.label) for c in clips] == [
        (r.input, r.event, r.start, r.end, r.label) for r in rows
    ]
    assert {clip.status for clip in clips} == {"written"}
    whole = {pose.source: pose for pose in load_poses(recordings, workers=1)}
    for clip in clips:
        assert clip.file.parent == tmp_path / "clips" / clip.label
        (part,) = load_poses(clip.file, workers=1)
        pose = whole[clip.input]
        inside = (pose.times >= clip.start - 1e-6) & (pose.times <= clip.end + 1e-6)
        np.testing.assert_allclose(part.keypoints, pose.keypoints[inside])
        np.testing.assert_allclose(part.times, pose.times[inside] - pose.times[inside][0], atol=1e-6)
    names = [clip.file.name for clip in clips if clip.label == clips[0].label]
    assert names == sorted(names)
    again = cut_events(spotted, tmp_path / "clips")
    assert {clip.status for clip in again} == {"there"}
    summary = classify_archive(tmp_path / "clips", tmp_path / "clips", tmp_path / "run", engine="inline")
    assert all(row.label == Path(row.input).parent.name for row in summary.rows())
    found = classify_archive(drawn.video_keypoints, tmp_path / "clips", tmp_path / "other", engine="inline")
    assert {row.status for row in found.rows()} <= {"ok", "rejected"} and found.counts["ok"] > 6


def test_only_one_label_and_a_margin(spotted: Path, tmp_path: Path) -> None:
    plain = cut_events(spotted, tmp_path / "plain")
    label = plain[0].label
    clips = cut_events(spotted, tmp_path / "wide", label=label, margin=0.3)
    assert {clip.label for clip in clips} == {label}
    narrow = {(c.input, c.event): c.frames for c in plain}
    assert all(clip.frames > narrow[clip.input, clip.event] for clip in clips)
    with pytest.raises(GestureError, match="has the label 'nothing'"):
        cut_events(spotted, tmp_path / "none", label="nothing")


@pytest.mark.parametrize("margin", [-1.0, float("nan"), float("inf")])
def test_a_margin_is_a_time(spotted: Path, tmp_path: Path, margin: float) -> None:
    with pytest.raises(ConfigError, match="margin"):
        cut_events(spotted, tmp_path / "clips", margin=margin)
    assert not (tmp_path / "clips").exists()


def test_what_is_gone_or_changed_costs_itself(
    recordings: Path, spotted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two = recordings / "one.npz", recordings / "two.npz"
    kept = one.read_bytes()
    try:
        one.unlink()
        clips = cut_events(spotted, tmp_path / "clips")
        assert {(Path(c.input).name, c.status, c.code) for c in clips} == {
            ("one.npz", "error", "E_NOT_FOUND"),
            ("two.npz", "written", ""),
        }
        shutil.copy(two, one)
        clips = cut_events(spotted, tmp_path / "clips")
        assert {(Path(c.input).name, c.status, c.code) for c in clips} == {
            ("one.npz", "error", "E_CHANGED"),
            ("two.npz", "there", ""),
        }
        assert gesture(["cut", str(spotted), "--out", str(tmp_path / "clips"), "--workers", "1"]) == 3
        assert '"status": "error E_CHANGED"' in capsys.readouterr().out
        for damaged in (b"", b"no keypoints", kept[:200]):
            one.write_bytes(damaged)
            clips = cut_events(spotted, tmp_path / "clips")
            assert {c.status for c in clips if Path(c.input).name == "one.npz"} == {"error"}, damaged
            assert all(c.code and c.message for c in clips if c.status == "error")
    finally:
        one.write_bytes(kept)


@pytest.fixture
def numbered(tmp_path: Path) -> Path:
    """A video of 60 frames, 25 a second, that show their numbers as six black or white bars."""
    pytest.importorskip("av")
    path = tmp_path / "numbered.mp4"
    with VideoWriter(path, quality=1) as writer:
        for number in range(60):
            bars = [255 * (number >> bit & 1) for bit in range(5, -1, -1)] + [255] * 6
            writer.add(
                number / 25, np.repeat(np.array(bars, np.uint8), 8)[None, :, None].repeat(48, 0).repeat(3, 2)
            )
    return path


def shown(frame: np.ndarray) -> int:
    """The number that a frame shows."""
    return int("".join(str(int(frame[20, 8 * bar + 4, 0] > 127)) for bar in range(6)), 2)


def event(number: int, start: float, end: float, path: Path, **changes: object) -> Row:
    row = Row(str(path), content_sha256(path), label="wave", status="ok", start=start, end=end, event=number)
    return replace(row, **changes)  # type: ignore[arg-type]


def test_clips_of_a_video_have_exactly_the_frames_of_the_event(numbered: Path, tmp_path: Path) -> None:
    rows = [
        event(1, 0.0, 0.4, numbered),
        event(2, 0.2, 1.0, numbered),
        event(3, 1.0, 2.36, numbered, label="../up"),
        event(4, 5.0, 6.0, numbered),
    ]
    clips = cut_events(a_run(tmp_path / "run", rows, numbered), tmp_path / "clips")
    assert [(clip.status, clip.code, clip.frames) for clip in clips] == [
        ("written", "", 11),
        ("written", "", 21),
        ("written", "", 35),
        ("error", "E_MEDIA_NO_FRAMES", 0),
    ]
    for clip, first in zip(clips, (0, 5, 25), strict=False):
        with open_video(clip.file) as video:
            frames = list(video)
        assert [round(time * 25) for time, _ in frames] == list(range(clip.frames))
        assert [shown(frame) for _, frame in frames] == list(range(first, first + clip.frames))
    assert clips[2].file.parent == tmp_path / "clips" / "_up"
    assert "stands for" in clips[2].note
    assert not [path for path in (tmp_path / "clips").rglob("*") if path.name.startswith(".")]


def test_several_people_are_cut_apart(numbered: Path, tmp_path: Path) -> None:
    left, right = (0.0, 0.0, 10.0, 40.0), (60.0, 0.0, 90.0, 40.0)
    rows = [
        event(1, 0.0, 0.4, numbered, box=left),
        event(1, 0.0, 0.4, numbered, box=right, person=1),
    ]
    one, two = cut_events(a_run(tmp_path / "run", rows, numbered), tmp_path / "clips")
    assert one.file != two.file
    with open_video(one.file) as video:
        assert (video.info.width, max(float(frame.mean()) for _, frame in video) < 60) == (16, True)
    with open_video(two.file) as video:
        assert min(float(frame.mean()) for _, frame in video) > 200


def test_a_video_that_breaks_half_way_keeps_the_clips_before(numbered: Path, tmp_path: Path) -> None:
    rows = [event(1, 0.0, 0.4, numbered), event(2, 1.6, 2.0, numbered)]
    run = a_run(tmp_path / "run", rows, numbered, "limits.frames=30")
    first, second = cut_events(run, tmp_path / "clips")
    assert (first.status, second.status, second.code) == ("written", "error", "E_MEDIA_LIMIT")
    assert not second.file.exists()


def test_the_sound_comes_along(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    rate, source = 48_000, tmp_path / "loud.mp4"
    tone = np.sin(np.arange(2 * rate) * 2 * np.pi * 440 / rate).astype(np.float32)
    tone[:rate] = 0  # silent for a second, then a tone

    def samples() -> Iterator[Any]:
        for start in range(0, len(tone), 1024):
            part = np.repeat(tone[None, start : start + 1024], 2, axis=0)
            frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(part), "fltp", "stereo")
            frame.sample_rate, frame.pts = rate, start
            yield frame

    with VideoWriter(source, sound=samples()) as writer:
        for number in range(50):
            writer.add(number / 25, np.full((48, 64, 3), number, np.uint8))
    rows = [event(1, 0.5, 1.5, source)]
    run = a_run(tmp_path / "run", rows, source)
    (clip,) = cut_events(run, tmp_path / "clips", sound=True)
    assert (clip.status, clip.note, clip.frames) == ("written", "", 25)
    with av.open(str(clip.file)) as opened:
        heard = np.concatenate([f.to_ndarray()[0] for f in opened.decode(audio=0)])
    assert abs(len(heard) / rate - 1.0) < 0.06
    loud = np.abs(heard) > 0.3
    assert abs(np.flatnonzero(loud)[0] / rate - 0.5) < 0.05
    (quiet,) = cut_events(run, tmp_path / "quiet")
    with av.open(str(quiet.file)) as opened:
        assert not opened.streams.audio


def test_a_long_name_in_any_script_leaves_room_for_the_times(drawn: DemoArchive, tmp_path: Path) -> None:
    (pose,) = load_poses(sorted(drawn.video_keypoints.iterdir())[0], workers=1)
    place = tmp_path / f"{'手' * 80}.npz"
    save(place, pose)
    rows = [event(1, float(pose.times[0]), float(pose.times[-1]), place, label="振" * 90)]
    folder = tmp_path / "run"
    with Results(a_run(folder, [], place), create=True) as results:
        results.commit(Input(place, str(place), "keypoints"), rows)
    (clip,) = cut_events(folder, tmp_path / "clips")
    assert (clip.status, clip.message) == ("written", "")
    assert clip.file.stem.startswith("手手手") and "stands for" in clip.note
