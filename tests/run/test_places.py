"""A run is the same from any folder, and what is named and holds nothing is said."""

from __future__ import annotations

import json
import shutil
import sqlite3
import sys
import warnings
from pathlib import Path

import pytest
from distributions import gesture
from troubles import write_clip

from gesture_core import classify_archive
from gesture_core.cli.main import run as command
from gesture_core.errors import ConfigError, MissingDependencyError
from gesture_core.report.run_rows import read_rows
from gesture_core.run.addresses import entries
from gesture_core.run.explain import explain
from gesture_core.run.pipeline import RunSummary


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(tmp_path / "home" / "examples" / label / "1.npz", 40, joint)
        write_clip(tmp_path / "home" / "videos" / f"{label}.npz", 30, joint, seed=1)
    (tmp_path / "away" / "deep").mkdir(parents=True)
    return tmp_path


def classify(videos: str, examples: str, out: str, **options) -> RunSummary:  # type: ignore[no-untyped-def]
    return classify_archive(videos, examples, out, "paper", classify__kernel="numpy", **options)


def test_the_same_run_from_another_folder_has_nothing_to_do(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder / "home")
    first = classify("videos", "examples", "run")
    monkeypatch.chdir(folder / "away")
    again = classify("../home/videos", "../home/examples", "../home/run")
    assert again.done_now == 0 and again.fingerprint == first.fingerprint
    assert [row.input for row in again.rows()] == ["videos/left.npz", "videos/right.npz"], "as typed first"
    assert explain("../home/run", "left").explanation.nearest.example == "examples/left/1.npz"
    page = read_rows(Path("../home/run"), folder / "clips", previews=False)
    assert all(page.details), "what is fitted has the names that the run knows the examples by"
    shutil.move(folder / "home" / "examples", folder / "away" / "deep" / "moved")
    write_clip(folder / "home" / "videos" / "more.npz", 30, 4, seed=2)
    moved = classify("../home/videos", "deep/moved", "../home/run")
    assert moved.done_now == 1 and moved.fingerprint == first.fingerprint, "examples are known by content"
    write_clip(folder / "away" / "deep" / "moved" / "left" / "2.npz", 30, 7, seed=5)
    with pytest.raises(ConfigError) as caught:
        classify("../home/videos", "deep/moved", "../home/run")
    assert "example deep/moved/left/2.npz: (absent) -> left (" in str(caught.value)
    assert str(caught.value).count("example deep") == 1


def test_a_copy_of_an_example_is_another_example(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "home")
    classify("videos", "examples", "run")
    shutil.copy("examples/left/1.npz", "examples/left/2.npz")
    with pytest.raises(ConfigError, match=r"example examples/left/2.npz: \(absent\) -> left"):
        classify("videos", "examples", "run")


def test_a_run_is_explained_from_any_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "home")
    classify("videos", "examples", "run")
    monkeypatch.chdir(folder / "away" / "deep")
    found = explain("../../home/run", "right.npz")
    assert found.row.input == "videos/right.npz" and found.explanation.nearest.label == "right"
    # A run of an earlier version has no places of its examples: their names count, from here.
    database = sqlite3.connect(folder / "home" / "run" / "run.db")
    with database:
        (text,) = database.execute("SELECT value FROM meta WHERE key = 'configuration'").fetchone()
        tree = json.loads(text)
        for known in tree["examples"].values():
            del known["path"], known["member"]
        database.execute("UPDATE meta SET value = ? WHERE key = 'configuration'", (json.dumps(tree),))
    database.close()
    monkeypatch.chdir(folder / "home")
    assert explain("run", "right.npz").explanation.nearest.label == "right"


def test_two_colons_in_a_name_are_a_part_of_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "home")
    shutil.move("videos/left.npz", "videos/to::the::left.npz")
    classify("videos", "examples", "run")
    assert explain("run", "videos/to::the::left.npz").explanation.nearest.label == "left"


def test_an_archive_that_moved_with_its_run_is_explained_beside_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder / "home")
    classify("videos", "examples", "run")
    monkeypatch.chdir(folder)
    shutil.move(folder / "home", folder / "elsewhere")
    monkeypatch.chdir(folder / "elsewhere")
    assert explain("run", "left.npz").explanation.nearest.label == "left"


def test_an_empty_folder_among_several_is_said(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "home")
    Path("empty", "inside").mkdir(parents=True)
    with pytest.warns(UserWarning, match="holds nothing to read: empty"):
        classify_archive(["videos", "empty"], "examples", "run", "paper", classify__kernel="numpy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a folder that was looked into before is not empty
        classify_archive(["videos", "videos"], "examples", "run", "paper", classify__kernel="numpy")
    done = gesture(
        "classify", "videos", "empty", "--examples", "examples", "--out", "piped", "--preset", "paper"
    )
    events = [json.loads(line) for line in done.stderr.splitlines()]
    assert {"event": "warning", "message": "holds nothing to read: empty"} in events


def test_examples_of_one_label_are_said_through_a_pipe(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "home")
    shutil.rmtree("examples/left")
    done = gesture("classify", "videos", "--examples", "examples", "--out", "run", "--preset", "paper")
    last = json.loads(done.stderr.splitlines()[-1])
    assert last["warnings"] == ["all examples have one label: every input that is near enough gets it"]


def test_a_pattern_of_label_folders(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "home")
    Path("examples/up").mkdir()
    Path("examples/notes.md").touch()
    options = ["--out", "run", "--preset", "paper", "--kernel", "numpy", "--quiet"]
    named = sorted(str(path) for path in Path("examples").iterdir())
    with pytest.warns(UserWarning, match=r"holds nothing to read: examples/up"):
        assert command(["classify", "videos", "--examples", *named, *options]) == 3, "up is lost"
    with sqlite3.connect("run/run.db") as database:
        found = dict(database.execute("SELECT input, label FROM rows WHERE role = 'query'"))
    assert found == {"videos/left.npz": "left", "videos/right.npz": "right"}


def test_an_absent_package_is_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fsspec")
    for module in ("s3fs", "gcsfs"):
        monkeypatch.setitem(sys.modules, module, None)
    for address, extra in (("s3://bucket/x", "s3"), ("gs://bucket/x", "gcs")):
        with pytest.raises(MissingDependencyError, match=rf'pip install "gesture-core\[{extra}\]"'):
            list(entries(address))
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(MissingDependencyError, match="pip install"):
        list(entries("s3://bucket/x"))
    monkeypatch.undo()
    with pytest.raises(MissingDependencyError, match="nothing reads nonsense://"):
        list(entries("nonsense://bucket/x"))


@pytest.mark.skipif(sys.platform == "win32", reason="a colon is no part of a name")
def test_a_run_folder_is_no_address(folder: Path) -> None:
    with pytest.raises(ConfigError, match="is an address") as failed:
        classify(f"{folder}/home/videos", f"{folder}/home/examples", Path("s3://bucket/run"))  # type: ignore[arg-type]
    assert failed.value.code == "E_OUT"
    assert not Path("s3:").exists()
