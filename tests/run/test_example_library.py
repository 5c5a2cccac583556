"""What is odd in an example library is said, counted, and never decides quietly."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributions import gesture
from trouble_plugin import FIGURE
from troubles import write_clip

from gesture_core import classify_archive, load_poses
from gesture_core.cli.output import print_reasons
from gesture_core.errors import ConfigError, InputError
from gesture_core.run.pipeline import RunSummary

pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """``examples`` of right and left, and one clip of each in ``videos``."""
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(tmp_path / "examples" / label / "1.npz", 40, joint)
        write_clip(tmp_path / "videos" / f"{label}.npz", 30, joint, seed=1)
    return tmp_path


def run(folder: Path, out: str = "run", **options) -> RunSummary:  # type: ignore[no-untyped-def]
    return classify_archive(
        folder / "videos", folder / "examples", folder / out, "paper", classify__kernel="numpy", **options
    )


def labels_of(summary: RunSummary) -> dict[str, str | None]:
    return {Path(row.input).stem: row.label for row in summary.rows()}


def test_examples_that_nobody_reads_are_failed_examples(folder: Path) -> None:
    for name in ("dance/clip.rmvb", "jump/one.json", "right/2.rmvb", "right/notes.txt", "left/Thumbs.db"):
        (folder / "examples" / name).parent.mkdir(exist_ok=True)
        (folder / "examples" / name).write_text("{}")
    (folder / "examples" / "readme.md").touch()  # has no label, so it is no example
    for _ in range(2):  # the second run has nothing to do and must not forget it
        summary = run(folder)
        assert [Path(row.input).name for row in summary.failed_examples] == [
            "clip.rmvb", "one.json", "2.rmvb",
        ]  # fmt: skip
        assert {row.code for row in summary.failed_examples} == {"E_NOT_AN_INPUT"}
        assert summary.lost_classes == ("dance", "jump")
        assert summary.exit_code == 3
        assert labels_of(summary) == {"right": "right", "left": "left"}
    said = gesture("explain", folder / "run", "right.npz")
    assert said.returncode == 0 and json.loads(said.stdout)["label"] == "right", said.stderr


def test_a_library_that_nobody_reads_is_no_library(folder: Path) -> None:
    for file in (folder / "examples").glob("*/*.npz"):
        file.rename(file.with_suffix(".rmvb"))
    with pytest.raises(InputError, match="holds no example"):
        run(folder)


def test_the_remedy_is_said_once_where_no_example_can_be_used(folder: Path) -> None:
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(folder / "examples" / label / "1.npz", 2, joint)
    with pytest.raises(InputError, match=r"E_EXAMPLES no example .*E_POSE_SHORT") as caught:
        run(folder)
    assert str(caught.value).count("try: ") == 1


def test_frames_as_pictures_are_told_to_become_videos(folder: Path) -> None:
    (folder / "videos" / "0001.JPG").touch()
    (row,) = [row for row in run(folder).rows() if row.status == "skipped"]
    assert "try: a video of the frames, if it is one of them (ffmpeg -framerate 25 -i" in row.message
    for file in (folder / "examples").glob("*/*.npz"):
        file.rename(file.with_suffix(".png"))
    with pytest.raises(InputError, match=r"holds no example.*; try: .*a video of the frames"):
        run(folder, "other")


def test_a_rejected_row_says_what_to_look_at(folder: Path) -> None:
    (left, _) = run(folder, classify__reject=1e-6).rows()
    assert left.code == "E_REJECTED" and "above 1e-06; try: a clip of one gesture" in left.message


def test_a_score_that_is_too_low_asks_for_no_larger_distance(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = list(run(folder, classify__neighbors=0, classify__min_score=1.0).rows())
    assert {row.code for row in rows} == {"E_REJECTED"}
    assert all(row.score is not None and f"score of {row.score:.4g}, below" in row.message for row in rows)
    print_reasons([*rows, *rows])
    said = capsys.readouterr().out.splitlines()[0]
    for text in (said, *(row.message for row in rows)):
        assert text.count("try: ") == 1
        assert text.endswith("; try: more examples of it, or a lower --set classify.min_score=…")


def test_a_stranger_counts_as_no_neighbour(folder: Path) -> None:
    (folder / "examples" / "right" / "2.rmvb").touch()
    done = gesture(
        "classify", folder / "videos", "--examples", folder / "examples", "--out", folder / "run",
        "--preset", "paper", "--neighbors", "3",
    )  # fmt: skip
    assert done.returncode == 2 and "3 neighbours of 2 examples" in done.stderr


def test_load_poses_warns_of_what_it_leaves_out(folder: Path) -> None:
    (folder / "videos" / "clip.rmvb").touch()
    with pytest.warns(UserWarning, match=r"neither video nor keypoints: .*clip\.rmvb"):
        assert len(load_poses(folder / "videos", "paper")) == 2


def test_a_manifest_with_one_clip_under_two_labels_is_refused(folder: Path) -> None:
    clips = [(folder / "examples" / label / "1.npz", label) for label in ("right", "left")]
    lines = [f"{path},{label}" for path, label in [*clips, (clips[0][0], "right"), (clips[0][0], "up")]]
    (folder / "list.csv").write_text("path,label\n" + "\n".join(lines))
    with pytest.raises(InputError, match=r"E_CONTRADICTION.*is listed as right and as up"):
        classify_archive(folder / "videos", folder / "list.csv", folder / "run", "paper")


def test_one_clip_under_two_labels_decides_nothing(folder: Path) -> None:
    write_clip(folder / "examples" / "left" / "2.npz", 36, 7, seed=2)
    twin = folder / "examples" / "right" / "twin.npz"
    shutil.copy(folder / "examples" / "left" / "1.npz", twin)
    shutil.copy(twin, twin.with_name("twice.npz"))
    for _ in range(2):
        summary = run(folder)
        assert [Path(row.input).name for row in summary.failed_examples] == ["1.npz", "twice.npz", "twin.npz"]
        assert {row.code for row in summary.failed_examples} == {"E_CONTRADICTION"}
        assert "is called left, and " in summary.failed_examples[0].message
        assert summary.lost_classes == () and summary.exit_code == 3
        assert labels_of(summary) == {"right": "right", "left": "left"}
    twin.unlink()
    twin.with_name("twice.npz").rename(folder / "examples" / "left" / "twice.npz")
    assert run(folder, "other").exit_code == 0, "two copies under one label agree"


def test_sequences_of_one_file_are_told_apart_by_their_names(folder: Path) -> None:
    moved = {f"{name}_1": np.tile(FIGURE * 200 + 50, (30, 1, 1)) for name in ("up", "down")}
    moved["up_1"][:, 4, 1] -= np.linspace(0, 150, 30)
    moved["down_1"][:, 7, 1] += np.linspace(0, 150, 30)
    clips: dict[str, Any] = dict(moved)
    np.savez(folder / "examples.npz", **clips)
    shutil.copy(folder / "examples.npz", folder / "copy.npz")
    summary = classify_archive(
        folder / "videos",
        [folder / "examples.npz", folder / "copy.npz"],
        folder / "run",
        "paper",
        labels="^(?P<label>[a-z]+)_",
    )
    assert summary.failed_examples == ()


def test_what_files_do_not_say_is_counted_as_assumed(folder: Path) -> None:
    for path in (folder / "videos" / "right.npz", folder / "examples" / "left" / "1.npz"):
        np.savez(path, keypoints=np.load(path)["keypoints"])
    assert run(folder).assumed == {"order=coco18, axes=xy, unit=pixels, fps=30": 2}
    assert run(folder, "again", keypoints__fps=20.0).assumed == {"order=coco18, axes=xy, unit=pixels": 2}
    (folder / "videos" / "right.npz").unlink()
    done = gesture(
        "classify", folder / "videos", "--examples", folder / "examples", "--out", folder / "third"
    )
    assert json.loads(done.stderr.splitlines()[-1])["assumed"] == {
        "order=coco18, axes=xy, unit=pixels, fps=30": 1
    }


def test_the_same_movement_in_another_file_under_another_label_is_said(folder: Path) -> None:
    with np.load(folder / "examples" / "right" / "1.npz") as data:
        (folder / "examples" / "up").mkdir()
        np.savez_compressed(folder / "examples" / "up" / "copy.npz", **data)
    summary = run(folder)
    assert [(row.code, Path(row.input).name) for row in summary.failed_examples] == [
        ("E_CONTRADICTION", "copy.npz")
    ]
    assert summary.exit_code == 3 and labels_of(summary) == {"right": "right", "left": "left"}


def test_rows_of_one_run_are_decided_by_the_same_examples(folder: Path) -> None:
    """An example that was too long for the limits is not, once the limit is gone; its hash is the same."""
    write_clip(folder / "examples" / "right" / "long.npz", 60, 4, seed=3)
    (failed,) = run(folder, limits__frames=50).failed_examples
    assert failed.code == "E_KEYPOINTS_LIMIT"
    write_clip(folder / "videos" / "third.npz", 30, 4, seed=5)
    with pytest.raises(ConfigError, match=r"E_CONFIG_CHANGED.*other examples"):
        run(folder)
    summary = run(folder, overwrite=True)
    assert not summary.failed_examples and len(list(summary.rows())) == 3
