"""Runs over long recordings: rows, resume, annotations, and what classify says of such inputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from streams import strung

from gesture_core import classify_archive, evaluate_events, load_poses, spot_archive
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import PluginError
from gesture_core.types import PoseSequence

CHANGES: dict[str, Any] = {"spot__tempos": ()}


def save(path: Path, pose: PoseSequence) -> None:
    points = np.concatenate([pose.keypoints, pose.scores[..., None]], axis=2)
    np.savez(path, keypoints=points, times=pose.times)


@pytest.fixture(scope="module")
def recordings(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One recording of six clips, and one in which somebody stands still."""
    folder = tmp_path_factory.mktemp("recordings")
    poses = load_poses(drawn.video_keypoints, workers=1)[:6]
    whole, marks = strung(poses)
    save(folder / "six.npz", whole)
    still = np.repeat(whole.keypoints[:1], 150, axis=0), np.repeat(whole.scores[:1], 150, axis=0)
    save(folder / "still.npz", PoseSequence(*still, np.arange(150) / 15))
    lines = [f"six,{start},{end},any" for start, end in marks]
    (folder / "marks.txt").write_text("\n".join(["input,start,end,label", *lines]) + "\n", "utf-8")
    return folder


def test_a_row_for_every_event_and_one_for_none(drawn: DemoArchive, recordings: Path, tmp_path: Path) -> None:
    sources = [recordings / "six.npz", recordings / "still.npz"]
    out = tmp_path / "run"
    first = spot_archive(sources, drawn.example_keypoints, out, engine="inline", **CHANGES)
    rows = first.rows()
    events = [row for row in rows if row.event]
    assert events and all(row.status == "ok" and row.label and row.score is not None for row in events)
    assert [row.event for row in events] == list(range(1, len(events) + 1))
    assert all(row.start is not None and row.end is not None and row.start < row.end for row in events)
    (quiet,) = [row for row in rows if not row.event]
    assert quiet.input.endswith("still.npz")
    assert (quiet.status, quiet.code, quiet.label) == ("rejected", "E_NO_EVENT", None)
    assert first.exit_code == 0
    again = spot_archive(sources, drawn.example_keypoints, out, engine="inline", **CHANGES)
    assert again.done_now == 0 and again.rows() == rows
    table = tmp_path / "marks.csv"
    table.write_text((recordings / "marks.txt").read_text("utf-8"), "utf-8")
    scores = evaluate_events(out, table)
    assert (scores.annotated, scores.reported) == (6, len(events))


def test_classify_names_what_is_for_long_inputs(drawn: DemoArchive, recordings: Path, tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="gesture spot finds every gesture"):
        classify_archive(
            recordings / "six.npz", drawn.example_keypoints, tmp_path / "run", engine="inline", **CHANGES
        )


def test_classify_names_it_before_a_long_video_is_looked_at(drawn: DemoArchive, tmp_path: Path) -> None:
    pytest.importorskip("av")
    from gesture_core.run.extract import Listener
    from gesture_core.video.writer import write_video

    noise = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)
    write_video([(number / 5, np.roll(noise, number, 1)) for number in range(300)], tmp_path / "long.mp4")

    class Stopped(Exception):
        pass

    class First(Listener):
        def frames(self, name: str, count: int) -> None:
            raise Stopped

        def extracted(self, name: str, cached: bool) -> None:
            raise Stopped

    with (
        pytest.warns(UserWarning, match="long.mp4 lasts 60 s.*gesture spot"),
        pytest.raises(PluginError, match="Stopped"),
    ):
        classify_archive(tmp_path / "long.mp4", drawn.examples, tmp_path / "run", listener=First())
