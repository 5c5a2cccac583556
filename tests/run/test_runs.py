"""The main job: one row for every input, nothing done twice, nothing lost."""

from __future__ import annotations

import csv
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from distributions import gesture, make_distribution

from gesture_core import classify_archive, load_poses
from gesture_core.classify.recognizer import Recognizer
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import ConfigError, GestureError, InputError, RunFolderError
from gesture_core.files import TEMPORARY
from gesture_core.run.extract import Listener
from gesture_core.run.pipeline import RunSummary
from gesture_core.run.results import open_results, run_lock
from gesture_core.types import Row


def classify(drawn: DemoArchive, out: Path, **options) -> RunSummary:  # type: ignore[no-untyped-def]
    options = {"settings": "paper", "classify__kernel": "numpy", **options}
    return classify_archive(drawn.video_keypoints, drawn.example_keypoints, out, **options)


def truth(drawn: DemoArchive) -> dict[str, str]:
    with drawn.truth.open(newline="") as file:
        return {Path(row["path"]).stem: row["label"] for row in csv.DictReader(file)}


class Count(Listener):
    def __init__(self) -> None:
        self.names: list[str] = []

    def extracted(self, name: str, cached: bool) -> None:
        self.names.append(name)


def test_every_input_gets_its_label(drawn: DemoArchive, tmp_path: Path) -> None:
    summary = classify(drawn, tmp_path / "run")
    rows = summary.rows()
    expected = truth(drawn)
    assert len(rows) == len(expected) == 12
    assert sum(row.label == expected[Path(row.input).name] for row in rows) >= 11
    for row in rows:
        if row.status == "ok":
            assert row.distance is not None and row.distance >= 0
            assert row.margin is not None and row.margin >= 0
            assert row.neighbors[0][1] == row.label
            assert row.selected and len(row.sha256) == 64 and len(row.fingerprint) == 16
            assert row.frames_with_pose == row.frames_read > 0 and row.seconds > 0
    assert summary.exit_code == 0


def test_the_second_run_does_nothing(drawn: DemoArchive, tmp_path: Path) -> None:
    first = classify(drawn, tmp_path / "run")
    listener = Count()
    second = classify(drawn, tmp_path / "run", listener=listener)
    assert (second.done_now, listener.names) == (0, [])
    assert second.rows() == first.rows()


def test_other_settings_reuse_the_keypoints_and_need_a_decision(drawn: DemoArchive, tmp_path: Path) -> None:
    classify(drawn, tmp_path / "run")
    with pytest.raises(ConfigError, match=r"t_var: 0\.1 -> 0\.05") as caught:
        classify(drawn, tmp_path / "run", variance__t_var=0.05)
    assert caught.value.code == "E_CONFIG_CHANGED"
    again = classify(drawn, tmp_path / "run", variance__t_var=0.05, overwrite=True)
    assert again.done_now == 12 and again.frames == 0, "keypoints were extracted twice"
    assert len(again.rows()) == 12


def test_what_changed_is_said_in_the_words_of_the_settings(drawn: DemoArchive, tmp_path: Path) -> None:
    classify(drawn, tmp_path / "run")
    with pytest.raises(ConfigError) as caught:
        classify(drawn, tmp_path / "run", signals__filters="median,center", dtw__window=0.1)
    first, *lines = str(caught.value).split("\n")
    assert "holds a run made with other settings" in first and "--overwrite" in first
    assert lines == [
        "  dtw.window: None -> 0.1",
        "  signals.filters: ['gaussian', 'center'] -> ['median', 'center']",
    ]


def test_an_example_more_is_no_other_setting(drawn: DemoArchive, tmp_path: Path) -> None:
    examples = tmp_path / "examples"
    shutil.copytree(drawn.example_keypoints, examples)
    one = replace(drawn, example_keypoints=examples)
    classify(one, tmp_path / "run")
    shutil.copytree(next(examples.glob("*/*")), examples / "new" / "1")
    with pytest.raises(ConfigError, match="holds a run made with other examples") as caught:
        classify(one, tmp_path / "run")
    assert "(absent) -> new" in str(caught.value)


def test_settings_that_touch_no_keypoint_change_no_extraction(drawn: DemoArchive, tmp_path: Path) -> None:
    from gesture_core.run.pipeline import run_archive
    from gesture_core.run.plan import RunRequest
    from gesture_core.settings import load_settings

    for preset, done in (("paper", 12), ("modern", 0)):
        settings = load_settings(preset, environment={}, pose__rate=0.0)
        request = RunRequest((str(drawn.video_keypoints),), tmp_path / "run", settings)
        assert run_archive(request).done_now == done
    assert not list((tmp_path / "run").glob("run.db-*")), "the database is one file"


def test_a_new_example_changes_the_configuration(drawn: DemoArchive, tmp_path: Path) -> None:
    examples = tmp_path / "examples"
    shutil.copytree(drawn.example_keypoints, examples)
    classify_archive(drawn.video_keypoints, examples, tmp_path / "run", "paper", classify__kernel="numpy")
    shutil.copytree(drawn.video_keypoints / "clip_01", examples / "new" / "clip_01")
    with pytest.raises(ConfigError, match=r"example .*clip_01: \(absent\) -> new"):
        classify_archive(drawn.video_keypoints, examples, tmp_path / "run", "paper", classify__kernel="numpy")


def test_new_and_changed_inputs_are_all_that_is_done(drawn: DemoArchive, tmp_path: Path) -> None:
    source = tmp_path / "source"
    shutil.copytree(drawn.video_keypoints, source)
    shutil.move(source / "clip_03", tmp_path / "clip_03")

    def run(listener: Listener | None = None) -> RunSummary:
        return classify_archive(
            source,
            drawn.example_keypoints,
            tmp_path / "run",
            "paper",
            classify__kernel="numpy",
            listener=listener,
        )

    before = {row.input: row for row in run().rows()}
    shutil.move(tmp_path / "clip_03", source / "clip_03")
    (source / "clip_05" / "clip_05_000000000003_keypoints.json").unlink()
    listener = Count()
    summary = run(listener)
    assert summary.done_now == 2
    after = {row.input: row for row in summary.rows()}
    changed = {Path(name).name for name in after if after[name] != before.get(name)}
    assert changed == {"clip_03", "clip_05"}


def test_a_resumed_run_fits_nothing(
    drawn: DemoArchive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(inputs: list[str], out: str) -> dict[str, Row]:
        chosen = [drawn.video_keypoints / name for name in inputs]
        summary = classify_archive(
            chosen, drawn.example_keypoints, tmp_path / out, engine="inline", classify__kernel="numpy"
        )
        return {Path(row.input).name: row for row in summary.rows()}

    both = run(["clip_01", "clip_02"], "both")
    run(["clip_01"], "run")
    with monkeypatch.context() as patch:
        patch.setattr(Recognizer, "fit", None)
        assert run(["clip_01", "clip_02"], "run") == both
    (tmp_path / "run" / "run.fitted").write_bytes(b"damaged")
    (tmp_path / "run" / "run.distances").unlink()
    assert run(["clip_01", "clip_02", "clip_03"], "run")["clip_02"] == both["clip_02"]


def test_bad_inputs_are_rows_and_lose_nothing_else(drawn: DemoArchive, tmp_path: Path) -> None:
    source = tmp_path / "source"
    shutil.copytree(drawn.video_keypoints / "clip_01", source / "clip_01")
    shutil.copytree(drawn.video_keypoints / "clip_02", source / "clip_02")
    (source / "clip_02" / "clip_02_000000000000_keypoints.json").write_text("{")
    (source / "readme.md").write_text("no gesture")
    (source / "=cmd.npy").write_bytes(b"\x93NUMPY no")
    summary = classify_archive(
        source, drawn.example_keypoints, tmp_path / "run", "paper", classify__kernel="numpy"
    )
    rows = {Path(row.input).name: row for row in summary.rows()}
    assert {name: row.status for name, row in rows.items()} == {
        "clip_01": "ok", "clip_02": "degraded", "readme.md": "skipped", "=cmd.npy": "error",
    }  # fmt: skip
    assert summary.exit_code == 3
    for row in rows.values():
        if row.status in ("error", "skipped"):
            assert row.label is None and row.code.startswith("E_") and row.input in row.message
            assert "try: " in row.message
    assert rows["clip_02"].label and "1 of " in rows["clip_02"].note + rows["clip_02"].message
    unchanged = classify_archive(
        source,
        drawn.example_keypoints,
        tmp_path / "run",
        "paper",
        classify__kernel="numpy",
        retry_errors=True,
    )
    assert unchanged.done_now == 1


def test_a_broken_example_is_said_and_the_rest_classifies(drawn: DemoArchive, tmp_path: Path) -> None:
    examples = tmp_path / "examples"
    shutil.copytree(drawn.example_keypoints, examples)
    for file in (examples / "wave" / "1").iterdir():
        file.write_text("{")
    summary = classify_archive(
        drawn.video_keypoints, examples, tmp_path / "run", "paper", classify__kernel="numpy"
    )
    assert summary.lost_classes == ("wave",)
    assert [row.status for row in summary.failed_examples] == ["error"]
    assert summary.exit_code == 3
    assert {row.label for row in summary.rows()} - {None} <= set(truth(drawn).values()) - {"wave"}
    shutil.rmtree(tmp_path / "examples" / "clap")
    for label in ("circle", "flap", "raise-arms", "swipe"):
        shutil.rmtree(examples / label)
    with pytest.raises(InputError, match="no example can be used"):
        classify_archive(
            drawn.video_keypoints, examples, tmp_path / "other", "paper", classify__kernel="numpy"
        )


def test_one_run_at_a_time(drawn: DemoArchive, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with run_lock(tmp_path / "run"):
        done = gesture(
            "classify",
            drawn.video_keypoints,
            "--examples",
            drawn.example_keypoints,
            "--out",
            tmp_path / "run",
        )
    assert done.returncode == 11
    assert "another run holds this folder" in done.stderr


def test_a_damaged_journal_is_said(drawn: DemoArchive, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.db").write_bytes(b"not a database" * 100)
    with pytest.raises(RunFolderError, match="cannot be used"):
        classify(drawn, tmp_path / "run")
    with pytest.raises(RunFolderError, match="holds no run"):
        open_results(tmp_path)


def test_a_damaged_keypoint_file_is_extracted_again(drawn: DemoArchive, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setenv("GESTURE_CACHE", str(tmp_path / "cache"))
    before = classify(drawn, tmp_path / "a").rows()
    for path in (tmp_path / "cache").rglob("*.parquet"):
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 0xFF
        path.write_bytes(data)
    after = classify(drawn, tmp_path / "b").rows()
    assert [(r.label, r.distance) for r in after] == [(r.label, r.distance) for r in before]


def test_load_poses_gives_sequences_or_the_first_error(drawn: DemoArchive, tmp_path: Path) -> None:
    poses = load_poses(drawn.video_keypoints / "clip_01", "paper")
    assert [pose.skeleton for pose in poses] == ["coco18"]
    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY no")
    with pytest.raises(GestureError, match=r"bad\.npy"):
        load_poses(tmp_path / "bad.npy")


def canonical(folder: Path) -> list[Row]:
    with open_results(folder) as journal:
        return sorted(journal.rows(), key=lambda row: (row.input, row.person))


@pytest.mark.skipif(os.name != "posix", reason="kill -9")
@pytest.mark.parametrize("seed", range(2))
def test_a_killed_run_resumes_to_the_same_table(drawn: DemoArchive, tmp_path: Path, seed: int) -> None:
    clean = classify(drawn, tmp_path / "clean").rows()
    out = tmp_path / "run"
    command = [sys.executable, "-m", "gesture_core", "classify", str(drawn.video_keypoints), "--quiet"]
    command += ["--examples", str(drawn.example_keypoints), "--out", str(out), "--preset", "paper"]
    command += ["--kernel", "numpy", "--workers", "2"]
    rng = random.Random(seed)
    environment = os.environ | {"GESTURE_CACHE": str(tmp_path / "cache")}
    for _ in range(10):
        process = subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            process.wait(timeout=rng.uniform(0.2, 3.0))
            break
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
    subprocess.run(command, env=environment, check=True, capture_output=True)
    assert canonical(out) == clean
    whole = [path for path in (tmp_path / "cache").rglob("*.parquet") if TEMPORARY not in path.name]
    assert len(whole) == 18, "what a killed run was writing has another name"


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_says_how_to_resume(
    drawn: DemoArchive, tmp_path: Path, number: signal.Signals, code: int
) -> None:
    path = make_distribution(
        tmp_path / "site",
        "slow-engine",
        """
        import time
        from gesture_core import hookimpl

        class Slow:
            def __init__(self, workers, limits): ...
            def run(self, job, tasks, on_frames):
                time.sleep(60)
                yield from ()

        @hookimpl
        def register_engines(register):
            register("slow", "slow_engine:Slow")
        """,
    )
    command = [sys.executable, "-m", "gesture_core", "classify", str(drawn.video_keypoints)]
    command += [
        "--examples",
        str(drawn.example_keypoints),
        "--out",
        str(tmp_path / "run"),
        "--engine",
        "slow",
    ]
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(path)},
        # a shell that starts the suite in the background lets it ignore interrupts, and children inherit that
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )
    assert process.stderr is not None
    assert json.loads(process.stderr.readline())["event"] == "planned"
    started = time.monotonic()
    process.send_signal(number)
    _, errors = process.communicate(timeout=20)
    assert time.monotonic() - started < 5
    assert process.returncode == code
    assert "resume with: gesture classify" in errors
