"""What the rows promise: nothing dropped, nothing stale, nothing said twice, nobody left behind."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from distributions import gesture, make_distribution

from gesture_core import classify_archive, load_poses
from gesture_core.demo.archive import DemoArchive, write_archive
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.run.pipeline import RunSummary
from gesture_core.run.store import read_keypoints, write_keypoints
from gesture_core.types import PoseSequence


@pytest.fixture
def examples(drawn: DemoArchive, tmp_path: Path) -> Path:
    for label in ("wave", "circle"):
        shutil.copytree(drawn.example_keypoints / label, tmp_path / "examples" / label)
    return tmp_path / "examples"


@pytest.fixture
def queries(drawn: DemoArchive, tmp_path: Path) -> Path:
    for name in ("clip_01", "clip_02"):
        shutil.copytree(drawn.video_keypoints / name, tmp_path / "queries" / name)
    return tmp_path / "queries"


def run(queries: Path, examples: Path, out: Path, **options) -> RunSummary:  # type: ignore[no-untyped-def]
    return classify_archive(queries, examples, out, "paper", classify__kernel="numpy", **options)


def parquet(path: Path, pose: PoseSequence, complete: bool = True) -> Path:
    facts = {"frames_declared": 90, "frames_read": len(pose), "complete": complete, "seconds": 1.0}
    write_keypoints(path, [pose], facts | {"notes": [] if complete else ["40 frames lost"], "people": 1})
    return path


def test_a_truncated_example_is_a_failed_example(queries: Path, examples: Path, tmp_path: Path) -> None:
    target = examples / "third"
    target.mkdir()
    (pose,) = load_poses(queries / "clip_01", "paper")
    np.savez(target / "1.npz", keypoints=pose.keypoints, scores=pose.scores, times=pose.times)
    data = (target / "1.npz").read_bytes()
    (target / "1.npz").write_bytes(data[: len(data) // 2])
    for _ in range(2):  # the second run has nothing to do and must not forget it
        summary = run(queries, examples, tmp_path / "run")
        assert summary.lost_classes == ("third",)
        assert [row.status for row in summary.failed_examples] == ["error"]
        assert summary.exit_code == 3
    with pytest.raises(GestureError, match=r"1\.npz"):
        load_poses([queries, target])


def test_damage_travels_with_extracted_keypoints(queries: Path, examples: Path, tmp_path: Path) -> None:
    (pose,) = load_poses(queries / "clip_01", "paper")
    still = PoseSequence(np.broadcast_to(pose.keypoints[:1], pose.keypoints.shape), pose.scores, pose.times)
    source = tmp_path / "source"
    source.mkdir()
    parquet(source / "moving.parquet", pose, complete=False)
    parquet(source / "still.parquet", still, complete=False)
    rows = {Path(row.input).stem: row for row in run(source, examples, tmp_path / "run").rows()}
    assert rows["moving"].status == "degraded" and "40 frames lost" in rows["moving"].message
    assert rows["moving"].frames_declared == 90
    assert rows["still"].status == "error" and rows["still"].label is None
    assert rows["still"].code == "E_MEDIA_PARTIAL" and "40 frames lost" in rows["still"].message


def test_rows_of_removed_inputs_go_and_other_sources_stay(
    queries: Path, examples: Path, tmp_path: Path
) -> None:
    def names(source: Path) -> list[str]:
        return [Path(row.input).name for row in run(source, examples, tmp_path / "run").rows()]

    assert names(queries) == ["clip_01", "clip_02"]
    assert names(queries / ".." / "queries") == ["clip_01", "clip_02"], "one input under two spellings"
    assert names(queries / "clip_02") == ["clip_01", "clip_02"], "rows of another source were dropped"
    shutil.rmtree(queries / "clip_01")
    assert names(queries) == ["clip_02"]


def test_a_mistake_leaves_the_folder_as_it_was(queries: Path, examples: Path, tmp_path: Path) -> None:
    before = run(queries, examples, tmp_path / "run").rows()
    for wrong in ({"gaussian__sgima": 3}, {"pose__backend": "nothing"}, {"classify__neighbors": 99}):
        with pytest.raises(GestureError):
            run(queries, examples, tmp_path / "run", overwrite=True, **wrong)
        assert run(queries, examples, tmp_path / "run").rows() == before
    fresh = tmp_path / "fresh"
    with pytest.raises(ConfigError):
        run(queries, examples, fresh, gaussian__sgima=3)
    assert len(run(queries, examples, fresh).rows()) == 2


def test_equal_names_in_two_sources_are_two_files(drawn: DemoArchive, tmp_path: Path) -> None:
    for camera in ("c1", "c2"):
        shutil.copytree(drawn.video_keypoints / "clip_01", tmp_path / camera / "0001")
    done = gesture("extract", tmp_path / "c1", tmp_path / "c2", "--out", tmp_path / "run", "--quiet")
    assert done.returncode == 0, done.stderr
    files = list((tmp_path / "run" / "keypoints").rglob("*.parquet"))
    assert len(files) == 2
    assert all(read_keypoints(file).sequences for file in files)


def test_a_folder_of_keypoint_files_hides_no_video(drawn: DemoArchive, tmp_path: Path) -> None:
    mixed = tmp_path / "mixed"
    shutil.copytree(drawn.video_keypoints / "clip_01", mixed)
    shutil.copy(drawn.videos / "clip_01.mp4", mixed)
    shutil.copytree(drawn.video_keypoints / "clip_02", mixed / "below")
    from gesture_core.run.inputs import discover

    assert sorted(item.kind for item in discover([mixed])) == ["keypoints", "keypoints", "video"]


def test_a_file_that_changes_after_a_run_is_done_again(queries: Path, examples: Path, tmp_path: Path) -> None:
    run(queries, examples, tmp_path / "run")
    frame = queries / "clip_01" / "clip_01_000000000003_keypoints.json"
    frame.rename(frame.with_name("clip_01_000000000903_keypoints.json"))
    assert run(queries, examples, tmp_path / "run").done_now == 1


ENGINES = {
    "lost": "yield from ()",
    "raises": "raise RuntimeError('no engine today'); yield",
}


@pytest.mark.parametrize("kind", ENGINES)
def test_an_engine_that_loses_its_outcomes_is_named(
    queries: Path, examples: Path, tmp_path: Path, kind: str
) -> None:
    source = f"""
        from gesture_core import hookimpl

        class Engine:
            def __init__(self, workers, limits): ...
            def run(self, job, tasks, on_frames):
                {ENGINES[kind]}

        @hookimpl
        def register_engines(register):
            register("odd", "odd_engine:Engine")
        """
    site = make_distribution(tmp_path / "site", "odd-engine", source, "4.2")
    done = gesture("extract", queries, "--out", tmp_path / "run", "--engine", "odd", path=site)
    assert "Traceback" not in done.stderr
    assert done.returncode == (3 if kind == "lost" else 1)
    if kind == "lost":
        rows = [json.loads(line) for line in done.stdout.splitlines()]
        assert [row["code"] for row in rows] == ["E_PLUGIN_CONTRACT"] * 2
        assert all("odd-engine 4.2" in row["message"] for row in rows)
    else:
        assert "odd-engine 4.2" in done.stderr and "no engine today" in done.stderr


TRAP = """
    import os, time
    from gesture_core import hookimpl

    class Trap:
        def accepts(self, path): return path.suffix == ".trap"
        def members(self, path): return [""]
        def read(self, path, member=""):
            if path.stem == "close":
                os.closerange(3, 64)
            time.sleep(600)

    @hookimpl
    def register_keypoint_readers(register):
        register("sleeper", "sleeper:Trap")
    """


@pytest.mark.skipif(os.name != "posix", reason="kill -9")
def test_workers_do_not_outlive_a_killed_parent(tmp_path: Path) -> None:
    site = make_distribution(tmp_path / "site", "sleeper", TRAP)
    (tmp_path / "sleep.trap").touch()
    command = [sys.executable, "-m", "gesture_core", "extract", str(tmp_path / "sleep.trap"), "--out"]
    parent = subprocess.Popen(
        [*command, str(tmp_path / "run")],
        env=os.environ | {"PYTHONPATH": str(site)},
        stderr=subprocess.DEVNULL,
    )
    workers: list[psutil.Process] = []
    deadline = time.monotonic() + 60
    while not workers and time.monotonic() < deadline:
        time.sleep(0.2)
        workers = psutil.Process(parent.pid).children()
    time.sleep(2)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert workers
    _, alive = psutil.wait_procs(workers, timeout=20)
    assert not alive


def test_a_worker_that_closes_its_pipe_and_lives_on_is_ended(tmp_path: Path) -> None:
    site = make_distribution(tmp_path / "site", "sleeper", TRAP)
    (tmp_path / "close.trap").touch()
    started = time.monotonic()
    done = gesture(
        "extract", tmp_path / "close.trap", "--out", tmp_path / "run", "--set", "limits.seconds=60", path=site
    )
    assert done.returncode == 3, done.stderr
    assert json.loads(done.stdout)["code"] == "E_WORKER_CRASH"
    assert time.monotonic() - started < 100


def test_the_demonstration_does_not_write_over_other_things(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").touch()
    with pytest.raises(InputError, match="holds something else"):
        write_archive(tmp_path)


def test_labels_and_names_of_any_bytes_reach_the_table(queries: Path, examples: Path, tmp_path: Path) -> None:
    (examples / "wave").rename(examples / os.fsdecode(b"gr\xfc"))
    rows = run(queries, examples, tmp_path / "run").rows()
    assert {row.label for row in rows} <= {"gr\\xfc", "circle", None}


def test_links_that_lead_nowhere_are_rows(queries: Path, examples: Path, tmp_path: Path) -> None:
    (queries / "gone.mp4").symlink_to(tmp_path / "nothing")
    rows = {Path(row.input).name: row for row in run(queries, examples, tmp_path / "run").rows()}
    assert rows["gone.mp4"].status == "error" and rows["gone.mp4"].code == "E_READ"


def test_none_is_a_value_whatever_names_the_settings(queries: Path, examples: Path, tmp_path: Path) -> None:
    strict = tmp_path / "strict.toml"
    strict.write_text('base = "paper"\n[classify]\nreject = 1e-12\n')
    changes: tuple[tuple[str, dict[str, Any], set[str | None]], ...]
    changes = (("a", {}, {None}), ("b", {"classify__reject": None}, {"wave", "circle"}))
    for name, change, found in changes:
        summary = classify_archive(queries, examples, tmp_path / name, str(strict), workers=1, **change)
        assert {row.label for row in summary.rows()} <= found, name
