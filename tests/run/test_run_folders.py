"""Run folders among videos and examples: they are no inputs, and no input is looked for where one is made."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from troubles import write_clip

from gesture_core.errors import ConfigError, RunFolderError
from gesture_core.run.inputs import discover
from gesture_core.run.pipeline import RunSummary, run_archive
from gesture_core.run.plan import RunRequest
from gesture_core.run.results import open_results
from gesture_core.settings import load_settings


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """``examples`` of right and left, and one clip in ``videos``."""
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(tmp_path / "examples" / label / "1.npz", 40, joint)
    write_clip(tmp_path / "videos" / "clip.npz", 30, 4, seed=1)
    return tmp_path


def run(folder: Path, out: str) -> RunSummary:
    settings = load_settings("paper", classify__kernel="numpy")
    places = (str(folder / "videos"),), folder / out, settings, (str(folder / "examples"),)
    return run_archive(RunRequest(*places, engine="inline"))


def test_what_a_run_leaves_is_neither_an_input_nor_an_example(folder: Path) -> None:
    for out in ("examples/run", "videos/run"):
        run(folder, out)
    assert [Path(item.name).name for item in discover([folder / "videos"])] == ["clip.npz"]
    summary = run(folder, "third")
    assert (summary.failed_examples, summary.lost_classes, summary.exit_code) == ((), (), 0)


def test_a_folder_of_runs_is_told_from_a_run(folder: Path) -> None:
    run(folder, "runs/first")
    with pytest.raises(RunFolderError, match=r"holds no run; try: .*such as .*runs/first$"):
        open_results(folder / "runs")
    with pytest.raises(RunFolderError, match=r"gesture classify wrote$"):
        open_results(folder / "videos")


def test_rows_that_go_with_their_inputs_are_counted(folder: Path) -> None:
    write_clip(folder / "videos" / "other.npz", 30, 7, seed=2)
    assert run(folder, "run").gone == 0
    (folder / "videos" / "other.npz").unlink()
    assert [run(folder, "run").gone for _ in range(2)] == [1, 0]


@pytest.mark.parametrize("out", ["videos", "examples", "videos/../videos"])
def test_a_run_folder_is_not_the_folder_of_the_clips(folder: Path, out: str) -> None:
    with pytest.raises(ConfigError, match=r"E_OUT .*holds the inputs or examples; try: a folder of its own"):
        run(folder, out)
    assert not list(folder.rglob("run.*"))


def test_classes_are_counted_and_folders_of_none_are_lost(folder: Path) -> None:
    shutil.copy(folder / "examples" / "left" / "1.npz", folder / "examples" / "left" / "2.npz")
    (folder / "examples" / "empty").mkdir()
    (folder / "examples" / ".hidden").mkdir()
    (folder / "examples" / "picture").mkdir()
    (folder / "examples" / "picture" / "1.png").touch()
    for _ in range(2):
        summary = run(folder, "run")
        assert summary.classes == {"left": 2, "right": 1}
        assert summary.lost_classes == ("empty", "picture") and summary.exit_code == 3
        assert summary.inputs_among_examples == 0
    shutil.copy(folder / "examples" / "left" / "1.npz", folder / "videos" / "copy.npz")
    with np.load(folder / "examples" / "right" / "1.npz") as data:
        np.savez_compressed(folder / "videos" / "packed.npz", **data)  # another file, the same movement
    assert run(folder, "run").inputs_among_examples == 2
