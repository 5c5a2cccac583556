"""The same keypoints in each form that the readers take."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gesture_core.plugin.reading import ReadOptions
from gesture_core.plugin.registry import registry

POINTS = np.random.default_rng(0).uniform(10, 400, (5, 18, 2)).round(1).astype(np.float32)


def write(folder: Path, reader: str) -> Path:
    if reader == "csv":
        path = folder / "clip.csv"
        path.write_text("\n".join(",".join(map(str, row)) for row in POINTS.reshape(5, -1)))
        return path
    if reader == "arrays":
        np.save(folder / "clip.npy", POINTS)
        return folder / "clip.npy"
    for number, points in enumerate(POINTS):
        joints = np.column_stack([points, np.full(18, 0.5)]).reshape(-1).tolist()
        frame = {"people": [{"pose_keypoints_2d": joints}]}
        (folder / f"clip_{number:012d}_keypoints.json").write_text(json.dumps(frame))
    return folder


@pytest.mark.parametrize("name", ["csv", "arrays", "openpose-json"])
def test_every_form_gives_the_same_keypoints(name: str, tmp_path: Path) -> None:
    path = write(tmp_path, name)
    reader = registry().make("reader", name, options=ReadOptions(fps=10.0))
    assert reader.accepts(path) and reader.members(path) == [""]
    (pose,) = reader.read(path)
    np.testing.assert_allclose(pose.keypoints, POINTS, rtol=1e-6)
    np.testing.assert_allclose(pose.times, np.arange(5) / 10)
    assert pose.skeleton == "coco18" and pose.provenance["reader"] == name


@pytest.mark.parametrize("name", ["csv", "arrays", "openpose-json"])
def test_what_a_reader_may_be_asked_about_is_announced(name: str, tmp_path: Path) -> None:
    path, entry = write(tmp_path, name), registry().find("reader", name)
    inside = {file.suffix for file in tmp_path.iterdir()}
    assert entry.folders == path.is_dir() and inside & set(entry.suffixes)
