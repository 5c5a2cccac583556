"""The keypoint files of a run are those of its rows: nothing stale, nothing lost, nothing swapped."""

from __future__ import annotations

from pathlib import Path

import pytest
from troubles import write_clip

from gesture_core.run.pipeline import RunSummary, run_archive
from gesture_core.run.plan import RunRequest
from gesture_core.run.store import read_keypoints
from gesture_core.settings import load_settings


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, frames in (("one/a", 30), ("one/b", 31), ("two/a", 40)):
        write_clip(tmp_path / f"{name}.npz", frames, 4)
    return tmp_path


def extract(folder: Path, *sources: str, **options) -> RunSummary:  # type: ignore[no-untyped-def]
    places = tuple(str(folder / source) for source in sources)
    settings = load_settings("paper")
    return run_archive(RunRequest(places, folder / "run", settings, engine="inline", **options))


def files(folder: Path) -> dict[str, int]:
    """Frames of each keypoint file."""
    return frames_in(folder / "run" / "keypoints")


def frames_in(place: Path) -> dict[str, int]:
    """Frames of each keypoint file below ``place``."""
    return {
        str(path.relative_to(place)): len(read_keypoints(path).sequences[0])
        for path in sorted(place.rglob("*.parquet"))
    }


def test_files_of_inputs_that_are_gone_or_broken_are_taken_out_and_kept(folder: Path) -> None:
    extract(folder, "one")
    assert files(folder) == {"a.npz.parquet": 30, "b.npz.parquet": 31}
    (folder / "one" / "a.npz").unlink()
    (folder / "one" / "b.npz").write_bytes(b"PK\x03\x04 no archive")
    assert extract(folder, "one").counts == {"error": 1}
    assert files(folder) == {}
    assert frames_in(folder / "run" / "removed") == {"a.npz.parquet": 30, "b.npz.parquet": 31}


def test_files_that_were_deleted_come_back(folder: Path) -> None:
    extract(folder, "one")
    (folder / "run" / "keypoints" / "a.npz.parquet").unlink()
    assert extract(folder, "one").done_now == 1
    assert files(folder) == {"a.npz.parquet": 30, "b.npz.parquet": 31}
    assert extract(folder, "one").done_now == 0


def test_a_second_source_replaces_no_file_of_the_first(folder: Path) -> None:
    extract(folder, "one")
    extract(folder, "two")
    frames = files(folder)
    assert frames["a.npz.parquet"] == 30 and sorted(frames.values()) == [30, 31, 40]
    for _ in range(2):
        extract(folder, "one", "two")
        assert sorted(files(folder).values()) == [30, 31, 40]


def test_other_folders_give_other_names(folder: Path) -> None:
    extract(folder, "one")
    extract(folder, "two", ".")
    assert files(folder) == {"a.npz.parquet": 40, "one/a.npz.parquet": 30, "one/b.npz.parquet": 31}


def test_files_that_are_the_inputs_stay(folder: Path) -> None:
    extract(folder, "one")
    extract(folder, "run/keypoints", overwrite=True)
    assert sorted(files(folder).values()) == [30, 30, 31, 31] or sorted(files(folder).values()) == [30, 31]
    assert extract(folder, "one", overwrite=True).counts == {"ok": 2}
    assert files(folder)["a.npz.parquet"] == 30
