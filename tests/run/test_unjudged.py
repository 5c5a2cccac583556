"""Files of which nobody can say whose they are, because a reader failed at them, are errors."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from distributions import gesture, make_distribution
from troubles import write_archive

from gesture_core.run.inputs import discover
from gesture_core.run.results import open_results
from gesture_core.run.workers.engines import Assistant
from gesture_core.settings import LimitSettings, load_settings
from gesture_core.types import Job, Row

READER = """
    import os
    import numpy as np
    from gesture_core import PoseSequence, hookimpl

    class Fragile:
        def accepts(self, path):
            if path.name in os.environ.get("DEADLY", "").split():
                os._exit(1)
            if path.name in os.environ.get("RAISING", "").split():
                raise RuntimeError("not today")
            return path.suffix == ".fragile"

        def members(self, path): return [""]

        def read(self, path, member=""):
            points = np.cumsum(np.random.default_rng(0).normal(0, 5, (30, 18, 2)), 0) + 200
            return [PoseSequence(points, np.ones((30, 18)), np.arange(30) / 20)]

    @hookimpl
    def register_keypoint_readers(register):
        register("fragile", "fragile:Fragile")
    """


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_distribution(tmp_path_factory.mktemp("site"), "fragile", READER)


def run(site: Path, folder: Path, *options: str, **environment: str) -> tuple[int, dict[str, Row], list[str]]:
    """Exit code, the rows by the names of their inputs, and the examples that were left out."""
    done = gesture(
        "classify", folder / "videos", "--examples", folder / "examples", "--out", folder / "run",
        "--preset", "paper", "--kernel", "numpy", *options, path=site, cwd=None, **environment,
    )  # fmt: skip
    assert "Traceback" not in done.stderr, done.stderr
    with open_results(folder / "run") as journal:
        found = list(journal.rows())
    rows = {Path(row.input).name: row for row in found}
    assert len(rows) == len(found), "an input has two rows"
    end = json.loads(done.stderr.splitlines()[-1])
    return done.returncode, rows, [Path(name).name for name in end["failed_examples"]]


def test_a_reader_that_dies_at_a_file_makes_it_an_error_that_is_tried_again(
    site: Path, tmp_path: Path
) -> None:
    write_archive(tmp_path, 2, ())
    for name in ("a.fragile", "b.fragile", "notes.md"):
        (tmp_path / "videos" / name).touch()
    code, rows, _ = run(site, tmp_path, DEADLY="a.fragile", RAISING="notes.md")
    assert code == 3
    assert {n: row.status for n, row in rows.items() if not n.startswith("healthy")} == {
        "a.fragile": "error", "b.fragile": "ok", "notes.md": "error",
    }  # fmt: skip
    assert rows["a.fragile"].code == "E_WORKER_CRASH" and rows["notes.md"].code == "E_PLUGIN_RAISED"
    for name in ("a.fragile", "notes.md"):
        assert "fragile 1.0" in rows[name].message and "--retry-errors" in rows[name].message
    again, same, _ = run(site, tmp_path)
    assert again == 3 and same == rows, "without --retry-errors nothing is tried again"
    code, rows, _ = run(site, tmp_path, "--retry-errors")
    assert code == 0 and len(rows) == 5
    assert rows["a.fragile"].status == "ok" and rows["notes.md"].status == "skipped"


def test_what_lies_in_a_folder_at_which_a_reader_dies_is_not_passed_over(site: Path, tmp_path: Path) -> None:
    write_archive(tmp_path, 2, ())
    frames = tmp_path / "videos" / "frames"
    frames.mkdir()
    (frames / "1.frame").touch()
    code, rows, _ = run(site, tmp_path, DEADLY="frames")
    assert code == 3 and len(rows) == 3
    assert rows["1.frame"].status == "error" and "of its folder" in rows["1.frame"].message


def test_an_example_at_which_a_reader_dies_is_said(site: Path, tmp_path: Path) -> None:
    write_archive(tmp_path, 2, ())
    (tmp_path / "examples" / "right" / "2.fragile").touch()
    (tmp_path / "examples" / "notes.md").touch()  # has no label, and needs none
    code, rows, left_out = run(site, tmp_path, DEADLY="2.fragile notes.md")
    assert code == 3 and {row.status for row in rows.values()} == {"ok"}
    assert sorted(left_out) == ["2.fragile", "notes.md"]


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
@pytest.mark.parametrize("name", ["k.npz", "k.npy", "k.csv", "k.parquet"])
def test_a_closed_keypoint_file_is_no_stranger(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).write_bytes(b"closed")

    here = Assistant(Job(load_settings(environment={}).as_dict(), ""), LimitSettings(), inline=True)

    def closed(path: os.PathLike[str], *rest: int, **options: int) -> int:
        raise PermissionError(13, os.strerror(13), os.fspath(path))

    (item,) = discover([tmp_path], assistant=here)
    assert item.kind == "other"
    monkeypatch.setattr(os, "open", closed)
    monkeypatch.setattr(Path, "open", closed)
    (item,) = discover([tmp_path], assistant=here)
    assert item.kind == "broken" and "Permission denied" in item.fault
