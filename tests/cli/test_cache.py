"""What is kept to save work: shown, deleted, left aside; and not used for a plugin whose code is another."""

from __future__ import annotations

import json
import sqlite3
import textwrap
from pathlib import Path

import numpy as np
import pytest
from distributions import gesture, make_distribution

READER = """
import numpy as np
from gesture_core import PoseSequence, hookimpl

class Reader:
    def accepts(self, path): return path.suffix == ".mine"
    def members(self, path): return [""]
    def read(self, path, member=""):
        {first}
        points = np.random.default_rng(0).normal({place}, 1, (30, 18, 2))
        return [PoseSequence(points, np.ones((30, 18)), np.arange(30) / 30)]

@hookimpl
def register_keypoint_readers(register):
    register("mine", "mine:Reader", suffixes=(".mine",))
"""


@pytest.fixture
def site(tmp_path: Path) -> Path:
    (tmp_path / "clips").mkdir()
    (tmp_path / "clips" / "a.mine").write_text("a")
    return make_distribution(tmp_path / "site", "mine", READER.format(first="pass", place=100))


def middle(site: Path, out: str, *more: str) -> float:
    """Where the keypoints are that a run extracts."""
    import pyarrow.parquet as pq

    folder = site.parent
    done = gesture(
        "extract",
        folder / "clips",
        "--out",
        folder / out,
        *more,
        path=site,
        GESTURE_CACHE=str(folder / "cache"),
    )
    assert done.returncode == 0, done.stderr
    (file,) = (folder / out / "keypoints").rglob("*.parquet")
    return float(np.mean(pq.read_table(file).column("nose_x").to_numpy()))


def test_a_plugin_that_is_edited_gets_no_keypoints_of_yesterday(site: Path) -> None:
    assert middle(site, "one") == pytest.approx(100, abs=1)
    (site / "mine.py").write_text(textwrap.dedent(READER.format(first="pass", place=700)))
    assert middle(site, "two") == pytest.approx(700, abs=1)
    done = gesture(
        "extract",
        site.parent / "clips",
        "--out",
        site.parent / "one",
        path=site,
        GESTURE_CACHE=str(site.parent / "cache"),
    )
    assert done.returncode == 2 and "keypoints readers mine origin" in done.stderr, done.stderr


def test_the_cache_is_shown_left_aside_and_deleted(site: Path) -> None:
    place = str(site.parent / "cache")
    assert middle(site, "one") == pytest.approx(100, abs=1)
    (where,) = (
        json.loads(line)
        for line in gesture("cache", GESTURE_CACHE=place).stdout.splitlines()
        if "keypoints" in line
    )
    assert where["files"] == "1" and where["folder"] == str(Path(place) / "keypoints")
    (stored,) = (Path(place) / "keypoints").rglob("*.parquet")
    before = stored.stat().st_mtime_ns
    middle(site, "two")
    assert stored.stat().st_ino and stored.read_bytes()
    first = stored.stat().st_ino
    middle(site, "two", "--no-cache")
    assert stored.stat().st_ino != first, "extracted again, and put into its place"
    with sqlite3.connect(site.parent / "two" / "run.db") as db:
        assert db.execute("SELECT COUNT(*) FROM rows").fetchone() == (1,)
    assert before
    done = gesture("cache", "clear", GESTURE_CACHE=place)
    assert done.returncode == 0 and "deleted 1 file" in done.stderr and not stored.exists()


@pytest.mark.parametrize("flags", [("--traceback",), ("--engine", "inline"), ()])
def test_the_lines_of_a_plugin_that_raised_are_shown_where_they_are_asked_for(
    site: Path, flags: tuple[str, ...]
) -> None:
    (site / "mine.py").write_text(textwrap.dedent(READER.format(first="self.frobnicate()", place=0)))
    out = site.parent / "run"
    done = gesture(
        "extract",
        site.parent / "clips",
        "--out",
        out,
        *flags,
        path=site,
        GESTURE_CACHE=str(site.parent / "cache"),
    )
    assert done.returncode == 3
    assert json.loads(done.stdout)["code"] == "E_PLUGIN_RAISED"
    assert ("self.frobnicate()" in done.stderr and "mine.py" in done.stderr) == bool(flags)
