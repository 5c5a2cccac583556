"""Keypoint files: what goes in comes out, and damage is never read as keypoints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gesture_core.errors import KeypointError
from gesture_core.run.store import StoreReader, read_keypoints, write_keypoints
from gesture_core.types import PoseSequence

FACTS = {
    "frames_declared": 5,
    "frames_read": 4,
    "complete": False,
    "notes": ["one packet lost"],
    "seconds": 0.2,
}


def people(skeleton: str = "coco18", joints: int = 18) -> list[PoseSequence]:
    rng = np.random.default_rng(0)
    found = []
    for person, frames in enumerate((5, 3)):
        points = rng.normal(300, 90, (frames, joints, 2)).astype(np.float32)
        points[rng.random((frames, joints)) < 0.2] = np.nan
        scores = rng.random((frames, joints)).astype(np.float32)
        size = (640, 480) if person else None
        times = np.sort(rng.random(frames))
        found.append(PoseSequence(points, scores, times, skeleton, size, person, "a.mp4", {"model": "x"}))
    return found


@pytest.mark.parametrize(("skeleton", "joints"), [("coco18", 18), ("body25", 25), ("blazepose33", 33)])
def test_a_round_trip_is_exact(tmp_path: Path, skeleton: str, joints: int) -> None:
    path, before = tmp_path / "k.parquet", people(skeleton, joints)
    write_keypoints(path, before, FACTS)
    stored = read_keypoints(path, "a.mp4")
    assert stored.facts == FACTS
    for a, b in zip(before, stored.sequences, strict=True):
        np.testing.assert_array_equal(a.keypoints, b.keypoints)
        np.testing.assert_array_equal(a.scores, b.scores)
        np.testing.assert_array_equal(a.times, b.times)
        assert (a.skeleton, a.frame_size, a.person, a.source) == (
            b.skeleton,
            b.frame_size,
            b.person,
            b.source,
        )
        assert a.provenance == b.provenance
    assert StoreReader().accepts(path)


def test_nobody_is_a_valid_file(tmp_path: Path) -> None:
    write_keypoints(tmp_path / "k.parquet", [], FACTS)
    assert read_keypoints(tmp_path / "k.parquet").sequences == []


def test_the_same_keypoints_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_keypoints(tmp_path / name, people(), FACTS)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b"], "a temporary file was left behind"


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_is_a_typed_error_or_changes_nothing(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "k.parquet"
    write_keypoints(path, people(), FACTS)
    raw = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        raw = raw[: data.draw(st.integers(0, len(raw) - 1))]
    else:
        for place in data.draw(st.lists(st.integers(0, len(raw) - 1), min_size=1, max_size=4)):
            raw[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(raw)
    try:
        stored = read_keypoints(path)
    except KeypointError as error:
        assert error.code.startswith("E_")
    else:
        for a, b in zip(people(), stored.sequences, strict=True):
            np.testing.assert_array_equal(a.keypoints, b.keypoints)
            np.testing.assert_array_equal(a.times, b.times)


def test_another_parquet_file_is_refused(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({"a": [1]}), tmp_path / "k.parquet")
    with pytest.raises(KeypointError, match="not a whole keypoint file"):
        read_keypoints(tmp_path / "k.parquet")
