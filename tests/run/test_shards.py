"""An archive in shards: merged, it is what one run would have written; what does not fit is refused."""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from hypothesis import given, strategies
from troubles import write_clip

from gesture_core.cli.main import run as gesture
from gesture_core.errors import ConfigError, GestureError, RunFolderError
from gesture_core.run.inputs import Input
from gesture_core.run.results import open_results
from gesture_core.run.shards import Merged, Shard, merge_runs

QUICK = ("--engine", "inline", "--quiet", "--preset", "paper", "--kernel", "numpy")
COUNT = 3


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Examples of right and left; 14 clips, one of which nobody can read, and a note beside them."""
    folder = tmp_path_factory.mktemp("shards")
    for joint, label in ((4, "right"), (7, "left")):
        for seed in range(2):
            write_clip(folder / "examples" / label / f"{seed}.npz", 40, joint, seed=seed)
    for number in range(12):
        write_clip(folder / "videos" / f"{number // 6}" / f"{number}.npz", 30, (4, 7)[number % 2], number)
    (folder / "videos" / "broken.npz").write_bytes(b"PK\3\4 and no more")
    (folder / "videos" / "note.txt").write_text("not a clip")
    (folder / "videos" / "film.mp4").write_bytes(b"no film")
    return folder


def command(archive: Path, kind: str, out: Path, *more: str) -> int:
    """Run a command over the archive as a user types it."""
    flags: Sequence[str] = QUICK
    if kind == "extract":
        flags = QUICK[:-2]
    examples = () if kind == "extract" else ("--examples", str(archive / "examples"))
    return gesture([kind, str(archive / "videos"), *examples, "--out", str(out), *flags, *more])


def shards_of(archive: Path, kind: str, out: Path, count: int = COUNT, *more: str) -> list[Path]:
    runs = [out / f"run-{number}" for number in range(1, count + 1)]
    for number, folder in enumerate(runs, 1):
        command(archive, kind, folder, "--shard", f"{number}/{count}", *more)
    return runs


def edit(run: Path, query: str) -> None:
    db = sqlite3.connect(run / "run.db")
    db.execute(query)
    db.commit()
    db.close()


def exported(run: Path, format: str = "csv") -> bytes:
    assert gesture(["export", str(run), "--format", format]) == 0
    return (run / f"results.{format}").read_bytes()


@pytest.fixture(scope="module")
def runs(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return shards_of(archive, "classify", tmp_path_factory.mktemp("runs"))


@given(strategies.sets(strategies.text(min_size=1), max_size=30), strategies.integers(1, 40))
def test_every_input_is_in_one_shard_whatever_lies_beside_it(names: set[str], count: int) -> None:
    shards = [Shard(number, count) for number in range(1, count + 1)]
    for name in names:
        assert sum(shard.holds(Input(Path(name), name, "video")) for shard in shards) == 1


def test_a_name_keeps_its_shard() -> None:
    """Machines of other versions take part in one run: these are the parts of today."""
    names = ("videos/a.mp4", "videos/b.mp4", "videos/tänzer.npz::2", "c")
    found = [
        next(n for n in range(1, 17) if Shard(n, 16).holds(Input(Path(name), name, "video")))
        for name in names
    ]
    assert found == [6, 10, 15, 3]


@pytest.mark.parametrize(
    ("kind", "more"),
    [("classify", ()), ("classify", ("--neighbors", "0")), ("extract", ()), ("spot", ())],
)
def test_merged_shards_are_one_run(archive: Path, tmp_path: Path, kind: str, more: tuple[str, ...]) -> None:
    code = command(archive, kind, tmp_path / "one", *more)
    runs = shards_of(archive, kind, tmp_path, COUNT, *more)
    merged = merge_runs(runs, tmp_path / "run")
    assert (code, merged.exit_code, merged.missing) == (3, 0, ())
    for format in ("csv", "jsonl"):
        assert exported(tmp_path / "run", format) == exported(tmp_path / "one", format)
    if kind == "extract":
        files = [
            {path.relative_to(run): path.read_bytes() for path in (run / "keypoints").rglob("*.parquet")}
            for run in (tmp_path / "run", tmp_path / "one")
        ]
        assert files[0] == files[1] and len(files[0]) == 12
    # It goes on like any run: nothing is left to do, and a new clip is one more row.
    before = exported(tmp_path / "run")
    assert command(archive, kind, tmp_path / "run", *more) == 3
    assert exported(tmp_path / "run") == before


def test_what_is_missing_is_said_and_merged_later(
    archive: Path, runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert gesture(["merge", *map(str, runs[:2]), "--out", str(tmp_path / "run")]) == 3
    assert f'"missing": ["{COUNT}/{COUNT}"]' in capsys.readouterr().err
    assert merge_runs(runs, tmp_path / "run").exit_code == 0
    first = exported(tmp_path / "run")
    assert merge_runs(runs[::-1], tmp_path / "run").counts == merge_runs(runs, tmp_path / "run").counts
    assert exported(tmp_path / "run") == first
    with pytest.raises(ConfigError, match="in none of the runs"):
        merge_runs(runs[:1], tmp_path / "run")
    assert exported(tmp_path / "run") == first
    assert merge_runs(runs[:1], tmp_path / "run", overwrite=True).missing == ("2/3", "3/3")


def test_a_shard_that_has_not_ended_is_said(runs: list[Path], tmp_path: Path) -> None:
    shutil.copytree(runs[0], tmp_path / "killed")
    edit(tmp_path / "killed", "DELETE FROM rows WHERE input = (SELECT MIN(input) FROM rows)")
    merged = merge_runs([tmp_path / "killed", *runs[1:]], tmp_path / "run")
    (have, planned) = merged.unfinished[str(tmp_path / "killed")]
    assert (planned - have, merged.exit_code) == (1, 3)


def test_a_keypoint_file_that_is_not_there_yet_is_missed_only_by_its_row(
    archive: Path, tmp_path: Path
) -> None:
    (run,) = shards_of(archive, "extract", tmp_path, 1)
    next((run / "keypoints").rglob("3.npz.parquet")).unlink()
    with pytest.raises(RunFolderError, match=r"lacks the keypoint file 0/3\.npz\.parquet; kept"):
        merge_runs([run], tmp_path / "out")
    # Ended between the name of the file and the file: there is no row either.
    edit(run, "DELETE FROM rows WHERE input LIKE '%/3.npz'")
    merged = merge_runs([run], tmp_path / "out")
    assert (merged.exit_code, len(merged.unfinished)) == (3, 1)
    assert command(archive, "extract", tmp_path / "out") == 3
    assert len(list((tmp_path / "out" / "keypoints").rglob("*.parquet"))) == 12
    (tmp_path / "other.parquet").write_bytes(b"x")
    edit(run, "UPDATE published SET file = '../../other.parquet' WHERE rowid = 1")
    with pytest.raises(RunFolderError, match=r"names a file '\.\./\.\./other"):
        merge_runs([run], tmp_path / "deep" / "out")


def test_keypoint_files_of_rows_that_go_are_put_aside(archive: Path, tmp_path: Path) -> None:
    runs, out = shards_of(archive, "extract", tmp_path, 2), tmp_path / "out"
    merge_runs(runs, out)
    merge_runs(runs[:1], out, overwrite=True)
    first, second = ({path.name for path in (run / "keypoints").rglob("*.parquet")} for run in runs)
    assert {path.name for path in (out / "keypoints").rglob("*.parquet")} == first
    assert {path.name for path in (out / "removed").rglob("*.parquet")} == second != set()


def contradictions(archive: Path, runs: list[Path], folder: Path) -> dict[str, tuple[list[Path], str]]:
    """Runs that are no parts of one, by what is wrong with them."""
    command(archive, "classify", folder / "other", "--shard", "2/3", "--set", "variance.t_var=0.05")
    command(archive, "classify", folder / "fourth", "--shard", "2/4")
    command(archive, "classify", folder / "whole")
    more = folder / "more"
    shutil.copytree(archive / "examples", more / "examples")
    write_clip(more / "examples" / "left" / "9.npz", 44, 7, seed=9)
    (more / "videos").symlink_to(archive / "videos")
    command(more, "classify", folder / "taught", "--shard", "2/3")
    shutil.copytree(runs[0], folder / "twin")
    return {
        "settings": ([runs[0], folder / "other"], r"variance\.t_var: 0\.1 -> 0\.05"),
        "examples": ([runs[0], folder / "taught"], r"example .*9\.npz"),
        "twice": ([runs[0], runs[1], folder / "twin"], "both are shard 1/3"),
        "division": ([runs[0], folder / "fourth"], "1/3 and 2/4"),
        "doubled": ([runs[0], folder / "whole"], "is in both"),
    }


def test_contradictions_are_refused_with_both_named(archive: Path, runs: list[Path], tmp_path: Path) -> None:
    for what, (some, message) in contradictions(archive, runs, tmp_path).items():
        with pytest.raises(ConfigError, match=message) as caught:
            merge_runs(some, tmp_path / "run")
        assert caught.value.code == "E_MERGE", what
        assert str(some[0]) in str(caught.value) and str(some[-1]) in str(caught.value), what
        assert not (tmp_path / "run").exists(), what


def test_a_merge_that_is_ended_has_changed_nothing(
    runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    merge_runs(runs[:2], tmp_path / "run")
    before = exported(tmp_path / "run")
    connect = sqlite3.connect

    class Ended(sqlite3.Connection):
        def executemany(self, query: str, values: Any, /) -> sqlite3.Cursor:
            def some() -> Any:
                for number, value in enumerate(values):
                    if number == 3 and "rows" in query:
                        raise KeyboardInterrupt
                    yield value

            return super().executemany(query, some())

    with monkeypatch.context() as patch:
        patch.setattr(
            "gesture_core.run.results.sqlite3.connect", lambda *a, **k: connect(*a, factory=Ended, **k)
        )
        with pytest.raises(KeyboardInterrupt):
            merge_runs(runs, tmp_path / "run")
    assert exported(tmp_path / "run") == before
    assert merge_runs(runs, tmp_path / "run").exit_code == 0


def test_a_folder_is_that_of_one_shard(archive: Path, runs: list[Path], tmp_path: Path) -> None:
    shutil.copytree(runs[0], tmp_path / "run")
    assert command(archive, "classify", tmp_path / "run", "--shard", "2/3") == 2
    assert command(archive, "classify", tmp_path / "run") == 2
    assert command(archive, "classify", tmp_path / "run", "--overwrite") == 3
    with pytest.raises(RunFolderError, match="holds no run"):
        merge_runs([runs[0], tmp_path / "nothing"], tmp_path / "out")
    with pytest.raises(ConfigError, match="one of the runs"):
        merge_runs(runs, runs[0])


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b", "1/0", "-1/3", "1/3/5"])
def test_a_wrong_shard_is_a_wrong_option(text: str) -> None:
    with pytest.raises(GestureError, match="1/N to N/N"):
        Shard.parse(text)


def test_a_shard_may_be_empty(archive: Path, tmp_path: Path) -> None:
    runs = shards_of(archive, "classify", tmp_path, 20)
    with open_results(runs[0]) as results:
        assert results.get("part")
    assert min(len(list(open_results(run).rows())) for run in runs) == 0
    merged: Merged = merge_runs(runs, tmp_path / "run")
    assert (merged.missing, sum(merged.counts.values())) == ((), 15)


def shell_parts() -> dict[str, str]:
    """The shell part of the jobs that the documentation shows."""
    text = (ROOT / "docs" / "howto" / "clusters.md").read_text("utf-8")
    slurm, kubernetes = (re.findall(rf"```{kind}\n(.*?)```", text, re.DOTALL)[0] for kind in ("bash", "yaml"))
    yaml = pytest.importorskip("yaml", reason="PyYAML comes with MkDocs, which is not installed")
    (container,) = yaml.safe_load(kubernetes)["spec"]["template"]["spec"]["containers"]
    (argument,) = container["args"]
    assert container["command"] == ["bash", "-c"]
    return {"slurm": slurm, "kubernetes": argument}


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize("system", ["slurm", "kubernetes"])
def test_the_jobs_of_the_documentation_give_each_task_its_shard(tmp_path: Path, system: str) -> None:
    """A sample of the slow test below: the shells alone, with a command that only notes how it is called."""
    script, notes = shell_parts()[system], tmp_path / "notes"
    command = tmp_path / "bin" / "gesture"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\necho "$@" >> "{notes}"\n')
    command.chmod(0o755)
    for index in range(2):
        variables = {
            "SLURM_ARRAY_TASK_ID": str(index + 1), "SLURM_ARRAY_TASK_COUNT": "16",
            "JOB_COMPLETION_INDEX": str(index), "PATH": f"{command.parent}:{os.environ['PATH']}",
        }  # fmt: skip
        subprocess.run(["bash", "-c", script], env=os.environ | variables, cwd=tmp_path, check=True)
    found = re.findall(r"--shard (\S+)", notes.read_text())
    assert found == ["1/16", "2/16"]


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.slow
@pytest.mark.parametrize("system", ["slurm", "kubernetes"])
def test_the_jobs_of_the_documentation_run_in_plain_shells(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, system: str
) -> None:
    script = shell_parts()[system].replace("/16", "/2")
    for name in ("videos", "examples"):
        (tmp_path / name).symlink_to(archive / name)
    flags = " ".join(QUICK[:2] + QUICK[3:])
    command = tmp_path / "bin" / "gesture"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -P -m gesture_core "$@" {flags}\n')
    command.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    for index in range(2):
        variables = {
            "SLURM_ARRAY_TASK_ID": str(index + 1), "SLURM_ARRAY_TASK_COUNT": "2",
            "JOB_COMPLETION_INDEX": str(index), "PATH": f"{command.parent}:{os.environ['PATH']}",
        }  # fmt: skip
        done = subprocess.run(
            ["bash", "-c", script], env=os.environ | variables, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
    runs = sorted((tmp_path / "runs").glob("run-*"))
    assert gesture(["merge", *map(str, runs), "--out", "merged"]) == 0
    assert gesture(["classify", "videos/", "--examples", "examples/", "--out", "one", *QUICK]) == 3
    assert exported(Path("merged")) == exported(Path("one"))
