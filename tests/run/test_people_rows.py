"""Rows of people: where and when each was; several people are checked before the work begins."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from tiny_networks import FIGURE, dot_network, dot_picture

from gesture_core.cli.main import run
from gesture_core.run.extract import Listener, first_person
from gesture_core.run.inputs import discover_readable
from gesture_core.run.results import open_results
from gesture_core.settings import load_settings
from gesture_core.video.writer import write_video

pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    pytest.importorskip("av")
    nobody = np.full((240, 320, 3), 96, np.uint8)
    figure = dot_picture((240, 320), FIGURE * 160 + (60, 40), 6)
    frames = [(t / 10, figure if t >= 4 else nobody) for t in range(16)]
    write_video(frames, tmp_path / "in.mp4", quality=8)
    return tmp_path / "in.mp4"


def test_a_row_says_where_and_when_the_person_was(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    network = dot_network(tmp_path / "dots.onnx")
    arguments = [
        str(clip),
        "--out",
        str(tmp_path / "run"),
        "--model",
        str(network),
        "--set",
        "pose.follow=false",
    ]
    assert run(["extract", *arguments]) == 0
    row = json.loads(capsys.readouterr().out)
    assert row["start"] == pytest.approx(0.4, abs=0.01) and row["end"] == pytest.approx(1.5, abs=0.01)
    assert row["frames_with_pose"] == 12
    box = [float(edge) for edge in row["box"].split()]
    low, high = FIGURE.min(axis=0) * 160 + (60, 40), FIGURE.max(axis=0) * 160 + (60, 40)
    np.testing.assert_allclose(box, [*low, *high], atol=4)
    # A file of the first version of this format has none of the three columns.
    database = tmp_path / "run" / "run.db"
    with sqlite3.connect(database) as db:
        for column in ("start", "end", "box"):
            db.execute(f'ALTER TABLE rows DROP COLUMN "{column}"')
    with open_results(tmp_path / "run") as results:
        (old,) = results.rows()
    assert (old.start, old.end, old.box) == (None, None, ())
    assert run(["extract", *arguments]) == 0


def test_several_people_need_a_network_that_tells_them_apart(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    network = dot_network(tmp_path / "dots.onnx")
    for number in range(3):
        (tmp_path / f"{number}.mp4").write_bytes(clip.read_bytes() + bytes(number))
    arguments = [str(tmp_path), "--out", str(tmp_path / "run"), "--model", str(network), "--quiet"]
    assert run(["extract", *arguments, "--set", "pose.people=multi"]) == 1
    said = capsys.readouterr().err
    assert said.count("E_POSE_PEOPLE") == 1 and "hpe0001" in said
    assert run(["extract", *arguments]) == 0  # nothing had begun


def test_the_network_is_said_only_where_it_is_asked(clip: Path, tmp_path: Path) -> None:
    settings = load_settings(pose__model=str(dot_network(tmp_path / "dots.onnx")))
    items = discover_readable([str(clip)], settings=settings)
    said: list[str] = []

    class Listening(Listener):
        def network(self, text: str) -> None:
            said.append(text)

    for _ in range(2):
        assert not first_person(items[0], settings, listener=Listening())[0].code
    assert len(said) == 1 and "dots.onnx" in said[0], "the second time its keypoints are there"
