"""Large files are told by how they begin, and what they unpack to is known before anything is unpacked."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest
from gesture_pose_files.arrow_table import ArrowTableReader, size_of_feather
from gesture_pose_files.json_table import JsonTableReader
from tables import COCO17, person

from gesture_core.errors import KeypointError

POINTS = person(COCO17.joints)
FRAMES = [
    {joint: {"x": x, "y": y} for joint, (x, y) in zip(COCO17.joints, frame, strict=True)}
    for frame in POINTS.tolist()
]
COLUMNS = {f"{joint}_x": POINTS[:, n, 0].tolist() for n, joint in enumerate(COCO17.joints)} | {
    f"{joint}_y": POINTS[:, n, 1].tolist() for n, joint in enumerate(COCO17.joints)
}


@pytest.mark.parametrize("compression", ["uncompressed", "lz4", "zstd"])
def test_feather_says_what_it_holds(tmp_path: Path, compression: str) -> None:
    import pyarrow as pa
    import pyarrow.feather

    words = pa.array(["a", "b"] * 500).dictionary_encode()
    table = pa.table(
        {"x": np.arange(1000.0), "word": words, "pair": [[1.0, 2.0]] * 1000, "none": pa.nulls(1000)}
    )
    pa.feather.write_feather(table, tmp_path / "k.feather", compression=compression, chunksize=300)
    with (tmp_path / "k.feather").open("rb") as file:
        size, values = size_of_feather(file)
        assert file.tell() == 0
    assert table.nbytes <= size < 1.1 * table.nbytes
    assert values == 2 + 4 * 1000 + 2000


def test_a_small_feather_of_much_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pyarrow as pa

    held = {
        "zeros.feather": pa.array(np.zeros(17_000_000)),
        "nulls.feather": pa.Array.from_buffers(pa.null(), 2**31 - 1, [None]),
    }
    for name, array in held.items():
        schema = pa.schema([("nose_x", array.type)])
        options = pa.ipc.IpcWriteOptions(compression="zstd")
        with pa.ipc.new_file(str(tmp_path / name), schema, options=options) as out:
            out.write_batch(pa.record_batch([array], schema=schema))
        assert (tmp_path / name).stat().st_size < 100_000
    monkeypatch.setattr(pa.ipc, "open_file", lambda *_: pytest.fail("it is unpacked"))
    for name in held:
        with pytest.raises(KeypointError, match="holds more than") as caught:
            ArrowTableReader().read(tmp_path / name)
        assert caught.value.code == "E_KEYPOINTS_LIMIT"
        assert not ArrowTableReader().accepts(tmp_path / name)
        assert "holds more than" in ArrowTableReader().refusal(tmp_path / name)


def test_damaged_feather_is_said_to_be_damaged(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.feather

    path = tmp_path / "k.feather"
    pa.feather.write_feather(pa.table(COLUMNS), path, compression="zstd")
    whole, random = path.read_bytes(), np.random.default_rng(0)
    assert len(ArrowTableReader().read(path)) == 1
    for _ in range(200):
        changed = bytearray(whole)
        for place in len(whole) - 1 - random.integers(0, 2500, 3):
            changed[max(place, 6)] = random.integers(256)
        path.write_bytes(changed[: random.integers(len(whole) // 2, len(whole) + 1)])
        try:
            ArrowTableReader().read(path)
        except KeypointError as error:
            assert error.code.startswith("E_KEYPOINTS"), error


@pytest.mark.parametrize("form", ["list", "frames", "numbers", "lines", "columns"])
def test_a_clip_in_json_is_known_by_how_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    path = tmp_path / ("clip.jsonl" if form == "lines" else "clip.json")
    trees = {
        "list": FRAMES,
        "frames": {"fps": 25, "note": 'a "[{" in a text', "frames": FRAMES},
        "numbers": dict(enumerate(FRAMES)),
        "columns": COLUMNS,
    }
    path.write_text("\n".join(map(json.dumps, FRAMES)) if form == "lines" else json.dumps(trees[form]))
    expected = JsonTableReader().read(path)[0].keypoints
    monkeypatch.setattr("gesture_pose_files.json_text._HEAD_BYTES", path.stat().st_size // 3)
    assert JsonTableReader().accepts(path)
    np.testing.assert_array_equal(JsonTableReader().read(path)[0].keypoints, expected)
    monkeypatch.setattr("gesture_pose_files.json_table.load", lambda *_: pytest.fail("all of it is parsed"))
    if form not in ("lines", "columns"):  # a third of the columns names no body
        assert JsonTableReader().accepts(path)


@pytest.mark.parametrize("name", ["clip.json", "clip.jsonl", "lines.json", "clip.jsonl.gz"])
def test_a_clip_that_is_too_large_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    path = tmp_path / name
    text = json.dumps(FRAMES) if name == "clip.json" else "\n".join(map(json.dumps, FRAMES))
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    monkeypatch.setattr("gesture_pose_files.json_table.MAX_LIST_BYTES", path.stat().st_size - 1)
    assert JsonTableReader().accepts(path)
    with pytest.raises(KeypointError) as caught:
        JsonTableReader().read(path)
    assert caught.value.code == "E_KEYPOINTS_LIMIT" and caught.value.remedy == "split it"
