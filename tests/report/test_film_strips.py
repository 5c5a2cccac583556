"""What an explanation shows of a run: strips of the input and of both examples, or why there is none."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from test_run_page import classified

from gesture_core.cli.main import run
from gesture_core.colours import GROUND
from gesture_core.demo.archive import DemoArchive
from gesture_core.report.film_strips import PICTURES, film_strips
from gesture_core.run.archive import classify_archive
from gesture_core.run.explain import explain

pytestmark = pytest.mark.usefixtures("in_this_process")

__all__ = ["classified"]


def test_figures_are_drawn_at_even_times_on_one_scale(classified: tuple[Path, Path]) -> None:
    found = explain(classified[0], "clip_05")
    strips = film_strips(found)
    assert not strips.missing and list(strips.pictures) == ["query", "nearest", "runner_up"]
    near, far = found.explanation.nearest, found.explanation.runner_up
    assert far is not None
    seconds = {"query": near.query.times, "nearest": near.signals.times, "runner_up": far.signals.times}
    lengths = {which: float(times[-1] - times[0]) for which, times in seconds.items()}
    ground = np.array([int(GROUND[i : i + 2], 16) for i in (1, 3, 5)])
    for which, strip in strips.pictures.items():
        high, wide, _ = strip.shape
        assert wide == high * int(PICTURES * lengths[which] / max(lengths.values()) + 1e-6)
        figures = np.split(strip, wide // high, axis=1)
        assert all(
            0.005 < (np.abs(one - ground.astype(int)).max(axis=2) > 40).mean() < 0.5 for one in figures
        )


def test_a_video_has_its_pictures_and_what_is_gone_says_so(
    drawn: DemoArchive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    shutil.copy(drawn.videos / "clip_01.mp4", "clip.mp4")
    examples = shutil.copytree(drawn.example_keypoints, "examples")
    classify_archive("clip.mp4", examples, "run")
    strips = film_strips(explain("run", "clip.mp4"))
    edges = {which: strip[0].std() for which, strip in strips.pictures.items()}
    assert edges["query"] > 1 and edges["nearest"] == edges["runner_up"] < edges["query"], "it has a room"
    shutil.rmtree(examples)
    capsys.readouterr()
    assert run(["explain", "run", "clip.mp4", "--out", "why.png"]) == 0
    said = capsys.readouterr().err
    assert "no pictures of the nearest example and the runner-up: is not where the run found it" in said
    assert "no pictures of the input" not in said
