"""Query by example: exact distances, the nearest first, whatever a bound rules out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from streams import strung
from test_spot_runs import save

from gesture_core import find, load_poses, load_settings
from gesture_core.cli.main import run as gesture
from gesture_core.demo.archive import DemoArchive
from gesture_core.dtw.subsequence import reference_subsequences
from gesture_core.errors import GestureError
from gesture_core.spot.find import STRETCH, Query
from gesture_core.spot.signals import stream_chain
from gesture_core.types import PoseSequence

pytestmark = pytest.mark.usefixtures("in_this_process")

SETTINGS = load_settings(None, ["spot.tempos="], environment={})


@pytest.fixture(scope="module")
def poses(drawn: DemoArchive) -> list[PoseSequence]:
    return load_poses(drawn.video_keypoints, workers=1)


def still(pose: PoseSequence, frames: int) -> PoseSequence:
    """A recording in which the person of ``pose`` stands still, then does what they do, and stands again."""
    step = float(np.median(np.diff(pose.times)))
    first, last = np.repeat([0], frames), np.repeat([len(pose) - 1], frames)
    order = np.concatenate([first, np.arange(len(pose)), last])
    times = step * np.arange(len(order))
    return replace(pose, keypoints=pose.keypoints[order], scores=pose.scores[order], times=times)


def test_the_distances_are_those_of_the_reference(poses: list[PoseSequence]) -> None:
    query = Query(poses[0], SETTINGS, 5)
    signals = stream_chain(SETTINGS)(strung(poses[:3])[0].onto("coco18"))
    found = query.candidates(signals)
    (series,) = query._examples.series
    used = series.mask & series.present & signals.present  # type: ignore[operator]
    expected, _ = reference_subsequences(signals.values[:, used], series.values[:, used], SETTINGS.spot.floor)
    best = min(found, key=lambda one: one.distance)
    assert best.distance == pytest.approx(np.nanmin(expected), rel=1e-3, abs=1e-5)


def test_bounds_rule_out_what_stands_still_and_change_nothing(poses: list[PoseSequence]) -> None:
    recordings = [replace(still(pose, 1500), source=str(n)) for n, pose in enumerate(poses[:4])]
    bounded, plain = Query(poses[0], SETTINGS, 3), Query(poses[0], SETTINGS, 10_000)
    for recording in recordings:
        bounded.search(recording)
        plain.search(recording)
    assert [(h.input, h.start, h.end) for h in bounded.hits] == [
        (h.input, h.start, h.end) for h in plain.hits[:3]
    ]
    np.testing.assert_allclose(
        [hit.distance for hit in bounded.hits], [hit.distance for hit in plain.hits[:3]], rtol=1e-4, atol=1e-6
    )
    assert bounded.frames == plain.frames
    assert bounded.warped < 0.7 * plain.warped
    assert bounded.warped > STRETCH


def test_it_finds_the_clip_itself_and_then_its_like(
    drawn: DemoArchive, poses: list[PoseSequence], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, marks = strung(poses)
    (tmp_path / "long").mkdir()
    save(tmp_path / "long" / "all.npz", whole)
    (tmp_path / "long" / "bad.parquet").write_bytes(b"PAR1 and nothing else")
    (tmp_path / "long" / "other.dat").write_bytes(b"nothing")
    clip = Path(poses[2].source)
    with pytest.warns(UserWarning, match="left out, neither video nor keypoints: .*other.dat"):
        found = find(clip, tmp_path / "long", SETTINGS, top=4, workers=1)
    assert [hit.distance for hit in found.hits] == sorted(hit.distance for hit in found.hits)
    best, (start, end) = found.hits[0], marks[2]
    assert min(best.end, end) - max(best.start, start) > 0.7 * (end - start)
    assert len(found.hits) == 4 and found.inputs == 1
    assert [Path(name).name for name in found.failed] == ["bad.parquet"]
    words = ["find", str(clip), str(tmp_path / "long" / "all.npz"), "--top", "2", "--workers", "1"]
    assert gesture([*words, "--set", "spot.tempos="]) == 0
    done = capsys.readouterr()
    lines = [json.loads(line) for line in done.out.splitlines()]
    assert [line["start"] for line in lines] == [hit.start for hit in found.hits[:2]]
    assert json.loads(done.err.splitlines()[-1])["places"] == 2


def test_a_run_folder_can_be_searched(drawn: DemoArchive, tmp_path: Path) -> None:
    from gesture_core import spot_archive

    out = tmp_path / "run"
    more = tmp_path / "more"
    more.mkdir()
    (more / "other.dat").write_bytes(b"nothing")
    np.savez(more / "nobody.npz", keypoints=np.full((20, 18, 3), np.nan), times=np.arange(20) / 20)
    sources = [drawn.video_keypoints, more]
    spot_archive(sources, drawn.example_keypoints, out, engine="inline", spot__tempos=())
    first = sorted(drawn.video_keypoints.iterdir())[0]
    found = find(first, out, top=3, workers=1)
    assert Path(found.hits[0].input).name == first.name and found.hits[0].distance < 1e-6
    assert found.inputs == 12 and not found.failed
    assert {Path(name).name: note for name, note in found.notes.items()} == {"nobody.npz": "nobody was found"}


def test_what_cannot_be_looked_for_is_refused(drawn: DemoArchive, tmp_path: Path) -> None:
    with pytest.raises(GestureError, match="holds 12 inputs"):
        find(drawn.video_keypoints, drawn.video_keypoints, SETTINGS)
    with pytest.raises(GestureError, match="no such file"):
        find(tmp_path / "none.mp4", drawn.video_keypoints, SETTINGS)
    (tmp_path / "day.csv").write_text("time,acc_x\n" + "".join(f"{n / 10},{n % 3}\n" for n in range(30)))
    with (
        pytest.warns(UserWarning, match="left out"),
        pytest.raises(GestureError, match=r"holds no recording: .*day\.csv: .*--preset sensors"),
    ):
        find(tmp_path / "day.csv", tmp_path / "day.csv", SETTINGS)
