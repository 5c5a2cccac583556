"""Thresholds from annotated recordings: chosen, said, stored; what is tested is not used in silence."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from streams import strung

from gesture_core import load_poses, spot_archive
from gesture_core.cli.main import run as gesture
from gesture_core.demo.archive import DemoArchive
from gesture_core.run.calibrate import choose_tolerance
from gesture_core.run.results import open_results
from gesture_core.spot.evaluation import Annotation, score_events
from gesture_core.types import Event

pytestmark = pytest.mark.usefixtures("in_this_process")

QUICK = ("--engine", "inline", "--kernel", "numpy", "--set", "spot.tempos=[]",
         "--set", "spot.verify=false")  # fmt: skip


def event(start: float, needed: float, label: str = "wave") -> Event:
    return Event("a", 0, start, start + 1, label, 1 - needed / 3, needed, "x")


def test_the_tolerance_with_the_best_f1_is_chosen() -> None:
    marks = [Annotation("a", start, start + 1, "wave") for start in (0.0, 10.0, 20.0)]
    events = [event(0, 0.5), event(10, 0.7), event(20, 1.1), event(30, 0.9), event(40, 1.2), event(50, 1.3)]
    chosen = choose_tolerance(events, marks, 60)
    assert 1.1 < chosen < 1.2
    kept = [one for one in events if 3 * (1 - one.score) <= chosen]
    assert score_events(kept, marks, 60).f1[0.5] == pytest.approx(6 / 7)
    assert 0.7 < choose_tolerance(events, marks[:2], 60) < 0.9
    assert choose_tolerance([], marks, 60) == 3.0


@pytest.fixture(scope="module")
def annotated(drawn: DemoArchive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("annotated")
    poses = load_poses(drawn.video_keypoints, workers=1)
    with drawn.truth.open(encoding="utf-8", newline="") as file:
        known = {Path(row["path"]).stem: row["label"] for row in csv.DictReader(file)}
    for name, some in (("known", poses[:5]), ("new", poses[5:9])):
        whole, marks = strung(some)
        points = np.concatenate([whole.keypoints, whole.scores[..., None]], axis=2)
        np.savez(folder / f"{name}.npz", keypoints=points, times=whole.times)
        labels = [known[Path(one.source).name.partition("::")[0]] for one in some]
        lines = [f"{name}.npz,{a},{b},{label}" for (a, b), label in zip(marks, labels, strict=True)]
        (folder / f"{name}.csv").write_text("\n".join(["input,start,end,label", *lines]), "utf-8")
    return folder


def test_what_was_chosen_is_said_and_stored(
    drawn: DemoArchive, annotated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    command = ["spot", str(annotated / "new.npz"), "--examples", str(drawn.example_keypoints),
               "--out", str(out), "--calibrate", str(annotated / "known.csv"), *QUICK]  # fmt: skip
    assert gesture(command) == 0
    said = capsys.readouterr().err
    assert "spot.tolerance=" in said and "marks in 1 recordings" in said and "says little" not in said
    chosen = json.loads((out / "calibration" / "chosen.json").read_text("utf-8"))
    with open_results(out) as results:
        configuration = json.loads(results.get("configuration") or "")
    assert configuration["settings"]["spot"]["tolerance"] == chosen["tolerance"]
    assert chosen["sha256"].keys() == {"known.csv"} and len(chosen["contents"]) == 1
    assert gesture([*command[:1], str(annotated / "known.npz"), *command[2:], "--overwrite"]) == 0
    assert "1 input chose the tolerance" in capsys.readouterr().err


def test_wrong_annotations_are_said(drawn: DemoArchive, annotated: Path, tmp_path: Path) -> None:
    def failure(text: str) -> str:
        with pytest.raises(Exception, match="E_") as caught:
            spot_archive(annotated / "new.npz", drawn.example_keypoints, tmp_path / "run", engine="inline",
                         calibrate=text, spot__tempos=(), spot__verify=False,
                         classify__kernel="numpy")  # fmt: skip
        return str(caught.value)

    (tmp_path / "lone.vtt").write_text("WEBVTT\n", "utf-8")
    assert "0 recordings beside it" in failure(str(tmp_path / "lone.vtt"))
    assert "E_NOT_FOUND" in failure(str(tmp_path / "none.eaf"))
    (tmp_path / "other.csv").write_text(f"input;start;end;label\n{annotated / 'known.npz'};1,5;2;nothing\n")
    assert "no annotation has a label of the run" in failure(str(tmp_path / "other.csv"))
    (tmp_path / "gone.csv").write_text("input,start,end,label\ngone.npz,1,2,nothing\n")
    assert "gone.npz is not there" in failure(str(tmp_path / "gone.csv"))
