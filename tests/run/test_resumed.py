"""What a run folder is asked for later: other networks, renamed examples, older formats, lost patterns."""

from __future__ import annotations

import json
import shutil
import sqlite3
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trouble_plugin import FIGURE
from troubles import write_clip, write_video

from gesture_core import classify_archive, explain, load_poses
from gesture_core.cli.main import run
from gesture_core.errors import ConfigError, InputError
from gesture_core.pose.models import CARD, known_models
from gesture_core.records import COLUMNS
from gesture_core.run import results
from gesture_core.run.pipeline import RunSummary
from gesture_core.run.results import open_results


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """``examples`` of right and left, and two clips in ``videos``."""
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(tmp_path / "examples" / label / "1.npz", 40, joint)
        write_clip(tmp_path / "videos" / f"{label}.npz", 30, joint, seed=1)
    return tmp_path


def classify(folder: Path, *sources: Any, **options: Any) -> RunSummary:
    options = {"classify__kernel": "numpy", **options}
    places = [*sources] or [folder / "videos"]
    return classify_archive(places, folder / "examples", folder / "run", "paper", engine="inline", **options)


def install(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stronger network than those that were there."""
    known = known_models()["blazepose"]
    assert known.contract is not None
    (folder / "models" / "blazepose").mkdir(parents=True)
    card = {"file": "model.tflite", "sha256": known.sha256[0], "contract": known.contract.as_table()}
    (folder / "models" / "blazepose" / CARD).write_text(json.dumps(card))
    (folder / "models" / "blazepose" / "model.tflite").write_bytes(b"")
    monkeypatch.setenv("GESTURE_MODELS", str(folder / "models"))


def test_a_new_network_is_no_change_where_no_input_is_a_video(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = classify(folder)
    install(folder, monkeypatch)
    after = classify(folder)
    assert after.done_now == 0 and after.fingerprint == before.fingerprint


def test_a_video_among_keypoint_files_is_an_input_like_any_other(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    classify(folder)
    write_video(folder / "videos" / "bar.mp4", 160, 20)
    assert classify(folder, pose__model="compact").done_now == 1
    # The network that its row was made by stays, while no video is asked for, and is asked for again.
    files = [folder / "videos" / f"{label}.npz" for label in ("left", "right")]
    assert classify(folder, *files, pose__model="another").done_now == 0
    assert classify(folder, pose__model="compact").done_now == 0
    shutil.move(folder / "examples", folder / "away")  # what was fitted explains the first rows, too
    assert explain(folder / "run", "left.npz").explanation.nearest.label == "left"
    shutil.move(folder / "away", folder / "examples")
    with pytest.raises(ConfigError, match=r"pose\.score"):
        classify(folder, pose__model="compact", pose__score=0.3)


def test_a_renamed_example_has_its_new_name_in_new_rows(folder: Path) -> None:
    classify(folder)
    (folder / "examples" / "left" / "1.npz").rename(folder / "examples" / "left" / "other.npz")
    write_clip(folder / "videos" / "new.npz", 33, 7, seed=2)
    (new,) = [row for row in classify(folder).rows() if row.input.endswith("new.npz")]
    assert new.neighbors[0][0].endswith("left/other.npz")


class Interrupted(sqlite3.Connection):
    """A connection on which statement number `at` is the last one that its process sends."""

    at = 0

    def execute(self, *arguments: Any) -> sqlite3.Cursor:
        self._count()
        return super().execute(*arguments)

    def executescript(self, script: str) -> sqlite3.Cursor:
        self._count()
        return super().executescript(script)

    def _count(self) -> None:
        Interrupted.at -= 1
        if Interrupted.at == 0:
            raise KeyboardInterrupt


def test_an_older_format_becomes_this_one_whole_or_not_at_all(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = classify(folder).rows()
    out = folder / "run"
    new = {"note", "start", "end", "box", "frames_looked_at", "event", "score"}
    kept = ", ".join(f"`{name}`" for name in ("key", "place", "role", *COLUMNS) if name not in new)
    db = sqlite3.connect(out / "run.db")
    db.executescript(
        f"CREATE TABLE old AS SELECT {kept} FROM rows; DROP TABLE rows; ALTER TABLE old RENAME TO rows;"
    )
    db.close()
    connect, opened = sqlite3.connect, list[sqlite3.Connection]()

    def connect_and_note(*arguments: Any, **options: Any) -> sqlite3.Connection:
        opened.append(connect(*arguments, factory=Interrupted, **options))
        return opened[-1]

    monkeypatch.setattr("gesture_core.run.results.sqlite3.connect", connect_and_note)
    for last in range(1, 100):
        copy = folder / f"copy_{last}"
        shutil.copytree(out, copy)
        Interrupted.at = last
        try:
            with results.Results(copy, create=True):
                break
        except KeyboardInterrupt:
            for db in opened:  # as the end of a process closes them
                db.close()
        Interrupted.at = 0
        db = connect(copy / "run.db")
        columns = {row[1] for row in db.execute("PRAGMA table_info(rows)")}
        db.close()
        assert columns & new in (set(), new), f"half migrated after {last} statements"
        with results.Results(copy, create=True) as found:
            assert [row.label for row in found.rows()] == [row.label for row in expected]
    assert last > 5


def test_a_pattern_that_matches_nothing_costs_its_own_row(folder: Path) -> None:
    lost = folder / "videos" / "*.mp4"
    summary = classify(folder, lost, folder / "videos" / "*.npz")
    rows = {Path(row.input).name: row for row in summary.rows()}
    assert (rows["*.mp4"].status, rows["*.mp4"].code) == ("error", "E_NOT_FOUND")
    assert "nothing matches" in rows["*.mp4"].message
    assert (rows["left.npz"].label, rows["right.npz"].label, summary.exit_code) == ("left", "right", 3)
    shutil.copy(folder / "videos" / "left.npz", folder / "videos" / "left.mp4.npz")
    assert "*.mp4" not in {Path(row.input).name for row in classify(folder).rows()}
    with pytest.raises(InputError, match="nothing matches"):
        classify(folder, lost, folder / "videos" / "*.avi")
    with pytest.raises(InputError, match="no such file"):
        classify(folder, folder / "videos", folder / "clips")
    with pytest.raises(InputError, match="nothing matches"), warnings.catch_warnings():
        load_poses([folder / "videos", lost], "paper")


def test_a_pattern_of_examples_that_matches_nothing_is_a_lost_example(folder: Path) -> None:
    examples = [folder / "examples", folder / "more" / "*"]
    summary = classify_archive(
        folder / "videos", examples, folder / "run", "paper", engine="inline", classify__kernel="numpy"
    )
    (failed,) = summary.failed_examples
    assert failed.code == "E_NOT_FOUND" and summary.exit_code == 3


def test_frames_that_cannot_be_read_are_not_kept(tmp_path: Path) -> None:
    for number in range(12):
        person = {"pose_keypoints_2d": [v for x, y in FIGURE * 200 + 50 for v in (x + number, y, 0.9)]}
        text = "{" if number == 5 else json.dumps({"people": [person]})
        (tmp_path / "clip").mkdir(exist_ok=True)
        (tmp_path / "clip" / f"clip_{number:012d}_keypoints.json").write_text(text)
    assert run(["extract", str(tmp_path / "clip"), "--out", str(tmp_path / "run"), "--engine", "inline"]) == 3
    with open_results(tmp_path / "run") as found:
        (row,) = found.rows()
    assert row.message.count("1 of 12 frames cannot be read") == 1
    assert "kept: 11 frames" in row.message and (row.frames_read, row.frames_looked_at) == (11, 11)


def test_nobody_is_no_reason_to_render(tmp_path: Path) -> None:
    nobody = np.full((20, 18, 2), np.nan)
    np.savez(
        tmp_path / "empty.npz",
        keypoints=nobody,
        scores=np.zeros((20, 18)),
        times=np.arange(20) / 20,
        skeleton=np.array("coco18"),
    )
    write_clip(tmp_path / "somebody.npz", 30, 4)
    run(["extract", str(tmp_path), "--out", str(tmp_path / "run"), "--engine", "inline", "--quiet"])
    with open_results(tmp_path / "run") as found:
        row = next(row for row in found.rows() if row.input.endswith("empty.npz"))
    assert (
        row.code == "E_NO_PERSON" and "render" not in row.message and "--set pose.score=none" in row.message
    )
