"""Faults that were found by reading and by long runs, each with the input that showed it."""

from __future__ import annotations

import errno
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from distributions import gesture, make_distribution, make_kernel
from troubles import write_archive, write_clip

from gesture_core import classify_archive, load_poses
from gesture_core.errors import RunFolderError
from gesture_core.files import TEMPORARY
from gesture_core.run.inputs import discover
from gesture_core.run.pipeline import run_archive
from gesture_core.run.plan import RunRequest
from gesture_core.run.results import open_results, run_lock
from gesture_core.run.store import SPARED_SECONDS, mark_used, prune
from gesture_core.settings import load_settings
from gesture_core.types import Row


def test_folders_may_be_nested_deeper_than_functions(tmp_path: Path) -> None:
    deepest = tmp_path.joinpath(*["a"] * 200)
    deepest.mkdir(parents=True)
    (deepest / "x.mp4").touch()
    script = "import sys; from gesture_core.run.inputs import discover; sys.setrecursionlimit(150)\n"
    script += "print([item.kind for item in discover([sys.argv[1]])])"
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, timeout=120
    )
    assert done.stdout == "['video']\n", done.stderr


def test_what_cannot_even_be_looked_at_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("closed.mp4", "open.mp4"):
        (tmp_path / name).touch()
    stat = Path.stat

    def refuse(path: Path, **options: bool) -> os.stat_result:
        if path.name == "closed.mp4":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        return stat(path, **options)

    monkeypatch.setattr(Path, "stat", refuse)
    closed, other = discover([tmp_path])
    assert (closed.kind, closed.code) == ("broken", "E_READ") and "Permission denied" in closed.fault
    assert other.kind == "video"


TWINS = """
    import sys
    from gesture_core import PoseSequence, hookimpl
    import numpy as np

    print("noise at import")

    class Twins:
        def accepts(self, path): return path.suffix == ".twins"
        def members(self, path): return [""]
        def read(self, path, member=""):
            points = np.random.default_rng(0).normal(100, 30, (2, 30, 18, 2))
            return [PoseSequence(p, np.ones((30, 18)), np.arange(30) / 20) for p in points]

    @hookimpl
    def register_keypoint_readers(register):
        print("noise in a hook")
        register("twins", "twins:Twins")
    """


def test_two_people_with_one_number_are_two_rows(tmp_path: Path) -> None:
    """They were a key that occurs twice, which ended the run."""
    site = make_distribution(tmp_path / "site", "twins", TWINS)
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "a.twins").touch()
    done = gesture(
        "extract", tmp_path / "videos", "--out", tmp_path / "run", "--set", "pose.people=multi", path=site
    )
    assert done.returncode == 0, done.stderr
    with open_results(tmp_path / "run") as journal:
        assert [row.person for row in journal.rows()] == [0, 1]
    assert "noise" not in done.stdout, "standard output is for results"


@pytest.mark.parametrize(("body", "code"), [("1 / 0", "E_PLUGIN_RAISED"), ("os._exit(0)", "E_WORKER_CRASH")])
def test_a_kernel_that_fails_at_the_examples_ends_the_run_in_words(
    tmp_path: Path, body: str, code: str
) -> None:
    """No input is to blame; it was a traceback."""
    write_archive(tmp_path, 2, ())
    write_clip(tmp_path / "examples" / "left" / "2.npz", 44, 7, 2)
    site = make_kernel(tmp_path / "site", body)
    done = gesture(
        "classify", tmp_path / "videos", "--examples", tmp_path / "examples", "--out", tmp_path / "run",
        "--preset", "paper", "--kernel", "bad", "--set", "classify.representative=true", path=site,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr and "bad-kernel 1.0" in done.stderr
    assert re.search(rf"^{code} ", done.stderr, re.MULTILINE)


def test_the_store_keeps_what_was_used_last(tmp_path: Path) -> None:
    old = time.time() - 2 * SPARED_SECONDS
    for number in range(6):
        path = tmp_path / f"{number:02d}" / f"{number}.parquet"
        path.parent.mkdir()
        path.write_bytes(bytes(400_000))
        os.utime(path, (old + number, old + number))
    left_behind = tmp_path / "00" / f".{TEMPORARY}a.parquet"
    left_behind.touch()
    os.utime(left_behind, (old, old))
    mark_used(tmp_path / "01" / "1.parquet")
    assert prune(tmp_path, 1) == 5, "four of the old ones, and what a killed run left"
    assert sorted(path.stem for path in tmp_path.rglob("*.parquet")) == ["1", "5"]
    assert prune(tmp_path, 0) == 1
    assert [path.stem for path in tmp_path.rglob("*.parquet")] == ["1"], "what was used today stays"
    assert prune(tmp_path / "nothing", 1) == 0


def test_every_extraction_keeps_the_store_below_its_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GESTURE_CACHE", str(tmp_path / "cache"))
    old = tmp_path / "cache" / "keypoints" / "00" / "old.parquet"
    old.parent.mkdir(parents=True)
    old.write_bytes(bytes(2_000_000))
    os.utime(old, (0, 0))
    write_clip(tmp_path / "a.npz", 40, 4)
    assert len(load_poses(tmp_path / "a.npz", "paper", limits__cache=2)) == 1 and old.exists()
    write_clip(tmp_path / "b.npz", 44, 4)
    assert len(load_poses(tmp_path / "b.npz", "paper", limits__cache=1)) == 1 and not old.exists()


def test_the_plugin_is_to_blame_where_it_makes_every_example_fail(tmp_path: Path) -> None:
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(tmp_path / "examples" / label / "1.npz", 40, joint)
    site = make_distribution(
        tmp_path / "site",
        "faulty",
        """
        from gesture_core import hookimpl

        class Faulty:
            def apply(self, signals): raise RuntimeError("not today")

        @hookimpl
        def register_filters(register):
            register("faulty", "faulty:Faulty")
        """,
    )
    done = gesture(
        "classify", tmp_path / "examples", "--examples", tmp_path / "examples", "--out", tmp_path / "run",
        "--preset", "paper", "--set", "filters=faulty", path=site,
    )  # fmt: skip
    assert done.returncode == 1 and "not today" in done.stderr and "faulty 1.0" in done.stderr
    assert "try: another version of that plugin" in done.stderr


def test_an_endless_message_is_cut() -> None:
    record = Row("a.mp4", message="x" * 1_000_000).as_record()
    assert len(record["message"]) < 20_000


def test_a_folder_that_cannot_be_locked_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And not held by the number of a process, which is another one's after a while."""
    if os.name != "posix":
        pytest.skip("locks of POSIX")
    import fcntl

    def unknown(*_: object) -> None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))

    monkeypatch.setattr(fcntl, "flock", unknown)
    with pytest.raises((RunFolderError, OSError)), run_lock(tmp_path):
        pass


def test_a_dead_holder_leaves_no_lock(tmp_path: Path) -> None:
    script = (
        "import sys, os, signal\nfrom pathlib import Path\nfrom gesture_core.run.results import run_lock\n"
    )
    script += "with run_lock(Path(sys.argv[1])):\n    os.kill(os.getpid(), signal.SIGKILL)\n"
    killed = subprocess.run([sys.executable, "-c", script, str(tmp_path)], timeout=60)
    assert killed.returncode == -9
    with run_lock(tmp_path):
        pass


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="a file of the system is needed")
def test_a_link_to_what_the_system_makes_up_is_a_row(tmp_path: Path) -> None:
    write_archive(tmp_path, 2, ())
    (tmp_path / "videos" / "bad sector.mp4").symlink_to("/proc/self/mem")
    summary = classify_archive(
        tmp_path / "videos", tmp_path / "examples", tmp_path / "run", "paper",
        classify__kernel="numpy",
    )  # fmt: skip
    rows = {Path(row.input).name: row for row in summary.rows()}
    assert len(rows) == 3 and summary.exit_code == 3
    assert rows["bad sector.mp4"].code == "E_READ"
    assert "made up by the system" in rows["bad sector.mp4"].message


# Two examples, then two files of what is fitted, and one input, each flushed twice, have been written.
@pytest.mark.parametrize(("least", "code"), [(5, "E_RUN_WRITE"), (11, "E_STORE_WRITE")])
def test_what_cannot_be_flushed_is_fatal_and_leaves_what_was_committed(
    least: int, code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_archive(tmp_path, 3, ())
    monkeypatch.setenv("GESTURE_CACHE", str(tmp_path / "cache"))
    settings = load_settings("paper", environment={}, classify__kernel="numpy")
    fsync, calls = os.fsync, 0

    def broken(descriptor: int) -> None:
        nonlocal calls
        calls += 1
        if calls > least:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        fsync(descriptor)

    def run() -> None:
        sources, examples = (str(tmp_path / "videos"),), (str(tmp_path / "examples"),)
        run_archive(RunRequest(sources, tmp_path / "run", settings, examples, engine="inline"))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", broken)
        with pytest.raises(RunFolderError, match=os.strerror(errno.EIO)) as caught:
            run()
    assert caught.value.code == code and "every committed row" in str(caught.value)
    run()
    with open_results(tmp_path / "run") as journal:
        assert [row.status for row in journal.rows()] == ["ok"] * 3
    assert not list((tmp_path / "cache").rglob(f"*{TEMPORARY}*"))


@pytest.fixture
def tiny_disk(tmp_path: Path):  # type: ignore[no-untyped-def]
    """A file system of 1 MiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    try:
        mounted = subprocess.run(command, capture_output=True, timeout=30).returncode == 0
    except OSError:
        mounted = False
    if not mounted:
        pytest.skip("a small disk cannot be mounted here")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.parametrize("full", ["run", "cache"])
def test_a_disk_without_space_is_fatal_and_leaves_what_was_committed(
    tiny_disk: Path, tmp_path: Path, full: str
) -> None:
    write_archive(tmp_path, 12, ())
    (tiny_disk / "ballast").write_bytes(bytes({"run": 940_000, "cache": 970_000}[full]))
    places = {"run": tmp_path / "run", "cache": tmp_path / "cache"} | {full: tiny_disk / full}
    arguments: list[str | Path] = ["classify", tmp_path / "videos", "--examples", tmp_path / "examples"]
    arguments += ["--out", places["run"]]
    arguments += ["--preset", "paper", "--kernel", "numpy", "--workers", "1"]
    done = gesture(*arguments, GESTURE_CACHE=str(places["cache"]))
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert re.search(r"E_(STORE_WRITE|RUN_WRITE|RUN_DAMAGED|OS) ", done.stderr)
    (tiny_disk / "ballast").unlink()
    again = gesture(*arguments, "--quiet", GESTURE_CACHE=str(tmp_path / "roomy"))
    assert again.returncode in (0, 3), again.stderr
    with open_results(places["run"]) as journal:
        rows = list(journal.rows())
    assert len(rows) == 12 and all(
        row.distance is not None and np.isfinite(row.distance) for row in rows if row.label
    )
