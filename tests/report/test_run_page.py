"""The page of a run: every row is in it with its clip, truth and alignment, and no name is more than text."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gesture_core.cli.main import run
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import ConfigError, InputError
from gesture_core.report import run_page
from gesture_core.report.run_page import write_report
from gesture_core.run.archive import classify_archive
from gesture_core.run.results import open_results

pytestmark = pytest.mark.usefixtures("in_this_process")

HOSTILE = "<img src=x onerror=alert(1)>"


def data_of(page: Path) -> dict[str, Any]:
    text = (page / "data.js").read_text("ascii")
    assert text.startswith("window.gestureData=") and text.endswith(";\n")
    tree: dict[str, Any] = json.loads(text[len("window.gestureData=") : -2])
    return tree


def rows_of(page: Path) -> list[dict[str, Any]]:
    data = data_of(page)
    return [dict(zip(data["columns"], row, strict=True)) for row in data["rows"]]


@pytest.fixture(scope="module")
def classified(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run over drawn keypoints, one of them with a name that is markup; and the truth about it."""
    place = tmp_path_factory.mktemp("page")
    inputs, truth = place / "inputs", ["path,label"]
    labels = dict(line.split(",") for line in drawn.truth.read_text("utf-8").split()[1:])
    for path, label in sorted(labels.items()):
        stem = Path(path).stem
        name = HOSTILE.replace("/", "") if stem == "clip_01" else stem
        shutil.copytree(drawn.video_keypoints / stem, inputs / name)
        truth.append(f"inputs/{name},{label}")
    (inputs / "broken.mp4").write_bytes(b"no video at all")
    (inputs / "old.csv").write_text("path,label\ngone.mp4,wave\n", "utf-8")  # lists what is not there
    truth += ["inputs/broken.mp4,wave", "inputs/old.csv,wave"]
    (place / "truth.csv").write_text("\n".join(truth) + "\n", "utf-8")
    classify_archive(inputs, drawn.example_keypoints, place / "run")
    return place / "run", place / "truth.csv"


@pytest.fixture(scope="module")
def page(classified: tuple[Path, Path]) -> Path:
    folder, truth = classified
    return write_report(folder, labels=str(truth)).page.parent


def test_a_run_without_previews_names_its_preset(drawn: DemoArchive, tmp_path: Path) -> None:
    for preset in ("paper", "pose"):
        classify_archive(drawn.video_keypoints, drawn.example_keypoints, tmp_path / preset, preset)
        page = write_report(tmp_path / preset, previews=False).page.parent
        assert data_of(page)["preset"] == preset


def test_every_row_is_there_with_its_truth_and_what_it_was_compared_with(
    classified: tuple[Path, Path], page: Path
) -> None:
    with open_results(classified[0]) as results:
        known = {row.input: row for row in results.rows()}
    shown = rows_of(page)
    assert [row["input"] for row in shown] == list(known)
    examples = data_of(page)["examples"]
    for row in shown:
        there = known[row["input"]]
        assert (row["label"], row["status"], row["code"]) == (there.label, there.status, there.code)
        if there.distance is None:
            assert row["distance"] is None
        else:
            assert row["distance"] == pytest.approx(there.distance, rel=1e-5), "else it is rounded twice"
        assert row["truth"] is not None
        if there.label:
            assert row["truth"] == there.label == examples[row["near"]][1]
            assert examples[row["far"]][1] != there.label
            assert (page / "clips" / row["clip"]).stat().st_size > 1000
            assert row["seconds"] == pytest.approx(there.end - there.start, abs=0.001)  # type: ignore[operator]
    (broken,) = (row for row in shown if row["input"].endswith("broken.mp4"))
    assert (broken["status"], broken["clip"]) == ("error", "") and broken["missing"]


def test_alignments_go_through_both_examples_from_beginning_to_end(page: Path) -> None:
    text = (page / "details" / "0.js").read_text("ascii")
    found = [record for record in json.loads(text[len("gesture.details(0,") : -len(");\n")]) if record]
    shown, examples = rows_of(page), data_of(page)["examples"]
    assert len(found) == sum(row["label"] is not None for row in shown)
    lengths = {name: seconds for name, _, _, seconds in examples}
    for record in found:
        assert record["time"][0] == 0 and (np.diff(record["time"]) > 0).all()
        for side in ("near", "far"):
            times = np.array(record[side]["time"])
            assert (np.diff(times) >= 0).all() and len(times) == len(record["time"])
            assert -50 <= times[0] < 300 and times[-1] <= 1000 * lengths[record[side]["example"]] + 50
        assert 1 <= len(record["channels"]) <= 3
        assert all(len(one["query"]) == len(record["time"]) for one in record["channels"])


def test_names_are_data_and_the_page_brings_all_that_it_loads(page: Path) -> None:
    assert any(HOSTILE in row["input"] for row in rows_of(page))
    for script in (page / "data.js", *(page / "details").glob("*.js")):
        assert "<" not in script.read_text("ascii"), "nothing in it could end a script, wherever it is put"
    index = (page / "index.html").read_text("utf-8")
    assert "default-src 'none'" in index and "unsafe" not in index
    for target in re.findall(r"(?:src|href)=\"([^\"#]+)\"", index):
        assert (page / target).is_file(), target
    for asset in sorted(Path(run_page.__file__).with_name("page").iterdir()):
        text = asset.read_text("utf-8")
        assert not re.search(
            r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(|new Function", text
        )
        assert set(re.findall(r"https?://[^\"' )]+", text)) <= {"http://www.w3.org/2000/svg"}, asset.name
        assert len(text.splitlines()) <= 400, asset.name


def test_a_preview_shows_the_person_with_the_times_of_the_input(drawn: DemoArchive, tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    from gesture_core.report.row_previews import RowPreviews
    from gesture_core.run.inputs import discover
    from gesture_core.settings import load_settings

    (item,) = discover([drawn.videos / "clip_01.mp4"])
    previews = RowPreviews(load_settings(), tmp_path / "clips")
    whole = previews.want(item, "content", "", None, 0.0, 60.0)
    part = previews.want(item, "content", "", None, 0.5, 1.25)
    gone = previews.want(item, "content", "", None, 50.0, 51.0)
    assert whole.seconds == 20.0, "a long input is not shown to its end"
    assert previews.make(1) == {gone.name: "there is no frame to show"}
    for preview, most in ((whole, 3.5), (part, 0.8)):
        with av.open(str(tmp_path / "clips" / preview.name)) as container:
            frames = list(container.decode(video=0))
        times = [frame.time for frame in frames]
        assert (frames[0].width, frames[0].height) == (240, 240)
        assert times[0] < 0.07 and times[-1] < most and max(np.diff(times)) < 0.15
        assert min(np.diff(times)) > 0.04, "no more than 15 a second"
    written = (tmp_path / "clips" / part.name).stat().st_ino
    again = RowPreviews(load_settings(), tmp_path / "clips")
    again.want(item, "content", "", None, 0.5, 1.25)
    left = [part.name.replace("mp4", "jpg"), part.name]
    assert again.make(1) == {} and sorted(one.name for one in (tmp_path / "clips").iterdir()) == left
    assert (tmp_path / "clips" / part.name).stat().st_ino == written, "it came out of the cache"


def test_previews_in_the_cache_stay_below_its_limit(
    drawn: DemoArchive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("av")
    from gesture_core.report.row_previews import RowPreviews
    from gesture_core.run.inputs import discover
    from gesture_core.settings import load_settings

    monkeypatch.setenv("GESTURE_CACHE", str(tmp_path / "cache"))
    old = tmp_path / "cache" / "previews" / "00" / "00old.mp4"
    old.parent.mkdir(parents=True)
    old.write_bytes(b"of a report of last year")
    os.utime(old, (1e9, 1e9))
    (item,) = discover([drawn.videos / "clip_01.mp4"])
    for page in ("first", "second"):
        previews = RowPreviews(load_settings(None, ["limits.cache=0"]), tmp_path / page)
        name = previews.want(item, "content", "", None, 0.5, 1.0).name
        kept = tmp_path / "cache" / "previews" / name[:2] / name
        if page == "second":
            os.utime(kept, (1e9, 1e9))
        assert previews.make(1) == {} and not old.exists()
        assert kept.is_file(), "what is used now stays, made now or long ago"


def test_an_input_that_moved_or_changed_has_its_row_without_a_clip(
    drawn: DemoArchive, tmp_path: Path
) -> None:
    inputs = tmp_path / "inputs"
    for name in ("clip_01", "clip_02", "clip_03"):
        shutil.copytree(drawn.video_keypoints / name, inputs / name)
    classify_archive(inputs, drawn.example_keypoints, tmp_path / "run")
    shutil.rmtree(inputs / "clip_01")
    for file in sorted((inputs / "clip_02").iterdir())[-5:]:
        file.unlink()
    done = write_report(tmp_path / "run", tmp_path / "page")
    assert (done.rows, done.previews) == (3, 1)
    assert done.missing == {"is not where the run found it": 1, "has changed since the run": 1}
    (tmp_path / "run" / "run.fitted").unlink()
    done = write_report(tmp_path / "run", tmp_path / "page")
    assert done.previews == 1, "it needs no fitted examples"
    assert len(done.notes) == 1 and "no row is aligned" in done.notes[0]
    assert not list((tmp_path / "page" / "details").iterdir())


def test_the_command_says_where_it_is_and_refuses_what_is_no_report(
    classified: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, truth = classified
    words = ["report", str(folder), "--no-previews", "--out"]
    assert run([*words, str(tmp_path / "page")]) == 0
    assert Path(capsys.readouterr().out.strip()) == tmp_path / "page" / "index.html"
    assert {row["truth"] for row in rows_of(tmp_path / "page")} == {None}
    assert run([*words, str(tmp_path / "page"), "--labels", str(truth)]) == 0, "in the place of the first"
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "letter.txt").write_text("dear", "utf-8")
    assert run([*words, str(mine)]) == 2 and (mine / "letter.txt").is_file()
    assert run([*words, str(mine / "letter.txt")]) == 2
    assert run(["report", str(mine)]) == 2
    other = tmp_path / "other.csv"
    other.write_text(truth.read_text("utf-8").replace(",wave", ",Wave"), "utf-8")
    capsys.readouterr()
    assert run([*words, str(tmp_path / "page"), "--labels", str(other)]) == 0
    assert "no example is called Wave: rows of such a name count as wrong (" in capsys.readouterr().err
    with pytest.raises(InputError, match="something else"):
        write_report(folder, mine)
    (mine / "data.js").write_text("const sales = [];", "utf-8")
    (mine / "clips").mkdir()
    (mine / "clips" / "holiday.mp4").write_bytes(b"mine")
    with pytest.raises(InputError, match="something else"):
        write_report(folder, mine, previews=False)
    assert (mine / "clips" / "holiday.mp4").is_file() and not (mine / "index.html").exists()
    with pytest.raises(ConfigError, match="no label"):
        write_report(folder, tmp_path / "page", labels="^(?P<label>nothing)", previews=False)
