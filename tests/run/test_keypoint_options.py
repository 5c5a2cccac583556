"""What keypoint files leave open: said in the row, set once for all readers, refused where it cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gesture_core import classify_archive
from gesture_core.run.pipeline import RunSummary
from gesture_core.skeletons import COCO17, COCO18
from gesture_core.testing import draw_pose

pytestmark = pytest.mark.usefixtures("in_this_process")

PICK = [COCO18.index(joint) for joint in COCO17.joints]


def movement(hand: str) -> np.ndarray:
    """(T, 18, 2) pixels of somebody who waves one hand."""
    points = draw_pose(frames=40).keypoints.astype(np.float64).copy()
    points[:, COCO18.index(f"{hand}_wrist"), 1] -= 60 * np.sin(np.arange(40) / 5) ** 2
    return points


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Examples in our own archives; an input with y before x, as shares, without a word."""
    for hand in ("left", "right"):
        (tmp_path / "examples" / hand).mkdir(parents=True)
        facts: dict[str, Any] = {
            "scores": np.ones((40, 18)),
            "times": np.arange(40) / 30,
            "skeleton": "coco18",
        }
        np.savez(tmp_path / "examples" / hand / "a.npz", keypoints=movement(hand), **facts)
    (tmp_path / "inputs").mkdir()
    shares = movement("right")[:, PICK] / [1280, 720]
    np.save(tmp_path / "inputs" / "movenet.npy", shares[..., ::-1])
    header = ",".join(f"{joint}_{axis}" for joint in COCO17.joints for axis in "xy")
    rows = "\n".join(",".join(map(str, row)) for row in movement("left")[:, PICK].reshape(40, -1))
    (tmp_path / "inputs" / "named.csv").write_text(f"{header}\n{rows}")
    return tmp_path


def run(folder: Path, name: str, **changes: Any) -> RunSummary:
    return classify_archive(
        folder / "inputs", folder / "examples", folder / name, "paper", engine="inline", **changes
    )


def test_what_was_assumed_is_in_the_row_and_what_cannot_be_is_refused(folder: Path) -> None:
    summary = run(folder, "one")
    array, table = summary.rows()
    assert (array.status, array.code) == ("error", "E_KEYPOINTS_IMPLAUSIBLE")
    assert "lies on its side in 40 of 40 frames" in array.message and "keypoints.axes=yx" in array.message
    assert (table.status, table.label, table.note) == ("ok", "left", "assumed: unit=pixels, fps=30")
    assert summary.assumed == {"unit=pixels, fps=30": 1}


def test_one_option_holds_for_all_readers_and_not_against_what_files_say(folder: Path) -> None:
    first = run(folder, "one", keypoints__axes="yx", keypoints__frame_size="1280x720")
    array, table = first.rows()
    assert (array.label, table.label) == ("right", "left")
    assert array.note == "assumed: order=coco17, unit=shares, fps=30"
    second = run(folder, "two", keypoints__axes="yx", keypoints__frame_size="1280x721")
    assert second.fingerprint != first.fingerprint
