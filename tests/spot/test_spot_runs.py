"""Runs over long recordings: rows, resume, annotations, and what classify says of such inputs."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from streams import strung

from gesture_core import classify_archive, evaluate_events, explain, load_poses, spot_archive
from gesture_core.cli.classify import say_summary
from gesture_core.cli.main import run as gesture
from gesture_core.demo.archive import DemoArchive
from gesture_core.dtw.subsequence import reference_subsequences
from gesture_core.errors import PluginError
from gesture_core.report.run_page import write_report
from gesture_core.run.pipeline import RunSummary
from gesture_core.run.rows import nearer
from gesture_core.settings import load_settings
from gesture_core.spot import spotter
from gesture_core.spot.explanation import EventExplainer, subsequence_path
from gesture_core.types import Event, PoseSequence

pytestmark = pytest.mark.usefixtures("in_this_process")

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


def test_what_was_too_far_is_counted_and_the_remedy_named(
    drawn: DemoArchive,
    recordings: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(spotter, "_SUREST", 10.0)  # drawn gestures are too alike to be refused narrowly
    changes = CHANGES | {"spot__threshold": 0.01}
    run = spot_archive(
        recordings / "six.npz", drawn.example_keypoints, tmp_path / "run", engine="inline", **changes
    )
    (row,) = run.rows()
    assert row.code == "E_NO_EVENT"
    number = int(row.message.partition(" farther than")[0].rpartition(" ")[2])
    assert number > 3 and "--calibrate" not in row.message and "tolerance" not in row.message
    times = float(row.message.partition("the nearest ")[2].partition(" times as far")[0])
    wide = changes | {"spot__threshold": 0.01 * times * 1.01}
    let_in = spot_archive(
        recordings / "six.npz", drawn.example_keypoints, tmp_path / "wide", engine="inline", **wide
    )
    assert 1 <= let_in.counts["ok"] < number, "so many times the threshold lets in the nearest"
    hint = nearer((1.5, 2.0, 1.25, 9.0), load_settings(None, ["spot.tolerance=0.5"], environment={}).spot)
    assert hint.startswith("--set spot.tolerance=1, which would let 3 more in") and "--calibrate" in hint
    fixed = load_settings(None, ["spot.threshold=0.3"], environment={}).spot
    assert nearer((1.234,), fixed) == "--set spot.threshold=0.38, which would let 1 more in"
    assert not nearer((3.5,), fixed) and not nearer((), fixed)
    assert not nearer((1.5,), replace(fixed, threshold=0.0)), "a larger one is no multiple of nothing"
    for counts in ({"ok": 3}, {"ok": 4}, {"rejected": 1}, {"rejected": 2}):  # one row says it itself
        say_summary(RunSummary(tmp_path, counts, refused=(1.5, 2.0, 1.25), nearer=hint))
        said = f"3 candidates farther than the thresholds; try: {hint}" in capsys.readouterr().err
        assert said == (counts in ({"ok": 3}, {"rejected": 2}))


def test_limits_on_the_labels_of_clips_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["spot", str(tmp_path), "--examples", "no", "--out", str(tmp_path / "run")]
    for text in ("reject=0.5", "reject_sd=3", "margin=0.1", "min_score=0.2", "confidence=0.5"):
        assert gesture([*words, "--set", f"classify.{text}"]) == 2
        said = capsys.readouterr().err
        assert f"--set classify.{text.partition('=')[0]}=none" in said and "spot.tolerance" in said
    assert not any(tmp_path.iterdir())


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
    assert first.exit_code == 0 and "spot.tolerance" not in quiet.message
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
        pytest.raises((PluginError, Stopped)),
    ):
        classify_archive(tmp_path / "long.mp4", drawn.examples, tmp_path / "run", listener=First())


def test_an_event_is_explained_by_its_example(
    drawn: DemoArchive, recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    spotted = spot_archive(recordings / "six.npz", drawn.example_keypoints, out, engine="inline", **CHANGES)
    rows = [row for row in spotted.rows() if row.event]
    for row in rows[:2]:
        found = explain(out, "six.npz", event=row.event)
        near, far = found.explanation.nearest, found.explanation.runner_up
        assert found.row == row
        assert (near.example, near.label) == row.neighbors[0][:2]
        assert near.distance == pytest.approx(row.distance, rel=1e-3)
        assert near.costs.sum() == pytest.approx(row.distance, rel=1e-3)
        assert row.start is not None and row.end is not None
        assert abs(near.query.times[0] - row.start) < 0.06 and abs(near.query.times[-1] - row.end) < 0.06
        assert far is None or (far.label != row.label and far.distance > near.distance)
    assert gesture(["explain", str(out), "six.npz", "--event", "2"]) == 0
    why = json.loads(capsys.readouterr().out)
    assert (why["label"], why["event"]) == (rows[1].label, 2)
    assert [why[key] for key in ("start", "end", "score")] == [rows[1].start, rows[1].end, rows[1].score]
    assert len(list(out.glob("explain-*event2*.png"))) == 1
    assert gesture(["explain", str(out), "six.npz", "--event", "99"]) == 2
    assert f"--event 1 to {len(rows)}" in capsys.readouterr().err
    page = write_report(out, tmp_path / "page", previews=False).page.parent
    assert (page / "details" / "0.js").read_text("utf-8").count('"channels":[{') == len(rows)


def test_the_path_of_an_event_is_that_of_its_distance() -> None:
    rng = np.random.default_rng(0)
    example = rng.normal(size=(9, 3)).cumsum(axis=0)
    stream = rng.normal(size=(40, 3)).cumsum(axis=0)
    stream[20:33] = example[np.linspace(0, 8, 13).round().astype(int)] + rng.normal(0, 0.1, (13, 3))
    distances, lengths = reference_subsequences(stream, example, 0.01)
    end = int(np.nanargmin(distances))
    part = stream[end + 1 - lengths[end] : end + 1]
    path, paid = subsequence_path(part, example)
    size = np.sqrt((part.var(axis=0).sum() + 0.01) * (example.var(axis=0).sum() + 0.01))
    assert paid.sum() / len(example) / size == pytest.approx(distances[end])
    assert path[0][0] <= 1 and tuple(path[-1]) == (len(part) - 1, len(example) - 1)
    assert set(path[:, 1].tolist()) == set(range(len(example)))


def test_thresholds_that_no_example_gives_are_said_to_be_a_guess(
    drawn: DemoArchive, recordings: Path, tmp_path: Path
) -> None:
    source, library = recordings / "six.npz", drawn.example_keypoints  # one example of each
    with pytest.warns(UserWarning, match=r"no gesture has two examples.*--set spot\.tolerance"):
        spot_archive(source, library, tmp_path / "guessed", engine="inline", spot__tempos=())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        spot_archive(
            source, library, tmp_path / "told", engine="inline", spot__tempos=(), spot__threshold=1.0
        )


def test_channels_are_refused_live_before_anything_is_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["spot", str(tmp_path), "--examples", "no", "--out", str(tmp_path / "run"), "--preset", "sensors"]
    assert gesture([*words, "--set", "spot.live=true"]) == 2
    assert "in the movements of people alone" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_an_example_is_shown_at_its_own_time_whatever_the_tempo_at_which_it_fits(drawn: DemoArchive) -> None:
    """The recording is an example at 1.6 times its length."""
    clips = [load_poses(drawn.example_keypoints / name / "1")[0] for name in ("wave", "clap")]
    slow = replace(clips[0], times=clips[0].times * 1.6)
    event = Event("slow", 0, 0.0, float(slow.times[-1]), "wave", 1.0, 0.0, "wave/1")
    found = EventExplainer(clips, ["wave", "clap"], ["wave/1", "clap/1"], load_settings(environment={}))
    near = found(event, slow).nearest
    assert near.distance < 0.05
    assert near.query.times[-1] - near.query.times[0] == pytest.approx(slow.times[-1], abs=0.2)
    assert near.signals.times[-1] == pytest.approx(clips[0].times[-1], abs=0.1)
