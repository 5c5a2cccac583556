"""`gesture render RUN INPUT`: what the run says of an input, over the video that it was."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_networks import FIGURE

from gesture_core.cli import render as command
from gesture_core.cli.main import run as gesture
from gesture_core.files import content_sha256, stamp
from gesture_core.pose.overlay import Tag
from gesture_core.records import Row
from gesture_core.run.inputs import Input
from gesture_core.run.results import Results
from gesture_core.settings import Settings
from gesture_core.types import PoseSequence
from gesture_core.video.writer import write_video

overlay = importlib.import_module("gesture_core.pose.overlay")
LABELLED = Row("film.mp4", status="ok", label="wave", margin=0.25)
EVENTS = [replace(LABELLED, event=n, label=f"g{n}", start=n, end=n + 0.5, score=0.5) for n in (1, 2)]
REJECTED = replace(LABELLED, label=None, status="rejected", code="E_FAR")


@pytest.mark.parametrize(
    ("rows", "time", "text"),
    [
        ([LABELLED], 9.0, "0  wave  margin 0.25"),
        ([REJECTED], 0.0, "0  E_FAR  margin 0.25"),
        ([replace(LABELLED, person=1)], 0.0, "0"),
        (EVENTS, 0.5, "0"),
        (EVENTS, 1.0, "0  g1  score 0.50"),
        (EVENTS, 2.5, "0  g2  score 0.50"),
    ],
)
def test_above_a_person_stands_what_the_run_says_then(rows: Sequence[Row], time: float, text: str) -> None:
    assert command._tag(0, rows)(time) == text


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of a film and of a file of keypoints, as it stands in its file."""
    pytest.importorskip("av", reason="PyAV is not installed: pip install 'gesture-core[video]'")
    write_video(((n / 10, np.full((120, 160, 3), 90, np.uint8)) for n in range(5)), tmp_path / "film.mp4")
    np.save(tmp_path / "points.npy", np.zeros((5, 18, 3)))
    (tmp_path / "run").mkdir()
    with Results(tmp_path / "run", create=True) as results:
        results.set({"configuration": {"settings": Settings().as_dict()}})
        for name, kind in (("film.mp4", "video"), ("points.npy", "keypoints")):
            path = tmp_path / name
            item = Input(path, str(path), kind, stamp=stamp(path))
            results.commit(item, [replace(LABELLED, input=item.name, sha256=content_sha256(path))])
    return tmp_path / "run"


def test_an_input_of_a_run_is_drawn_with_its_label_or_refused_with_a_remedy(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tags: list[str] = []
    drawn_over = overlay.overlay

    def noting(frames: object, found: object, tagged: Sequence[Tag] = ()) -> object:
        tags.extend(tag(0.2) for tag in tagged)
        return drawn_over(frames, found, tagged)

    points = np.broadcast_to(FIGURE * 80 + (20, 20), (5, 18, 2))
    pose = PoseSequence(points, np.ones((5, 18)), np.arange(5) / 10)
    monkeypatch.setattr(overlay, "overlay", noting)
    monkeypatch.setattr(command, "_people", lambda video, settings: [pose])
    assert gesture(["render", str(run), "film", "--out", str(tmp_path / "seen.png")]) == 0
    assert tags == ["0  wave  margin 0.25"] and (tmp_path / "seen.png").stat().st_size > 500

    def refused(*words: str) -> str:
        assert gesture(["render", *words, "--out", str(tmp_path / "not.png")]) != 0
        assert not (tmp_path / "not.png").exists()
        return capsys.readouterr().err

    assert "is no video" in refused(str(run), "points")
    assert "no input of the run is 'nobody'" in refused(str(run), "nobody")
    assert "gesture render RUN INPUT" in refused(str(run))
    with Results(tmp_path, create=True):
        pass  # which has not begun
    assert "no input of the run" in refused(str(tmp_path), "film")
    with (tmp_path / "film.mp4").open("ab") as film:
        film.write(b"more")
    assert "E_CHANGED" in refused(str(run), "film")
    (tmp_path / "film.mp4").unlink()
    assert "is not where the run found it" in refused(str(run), "film")
