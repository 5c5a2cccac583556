"""Packed files of one's own form: read where they are whole, refused before they fill the memory."""

from __future__ import annotations

import bz2
import gzip
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from gesture_pose_files.arrays import ArrayReader
from gesture_pose_files.arrow_table import ArrowTableReader
from gesture_pose_files.csv_table import CsvReader
from gesture_pose_files.matlab import MatlabReader
from gesture_pose_files.result_list import ResultListReader
from tables import COCO17, FRAMES, flat, named, same, save
from test_files_own_forms import NAMES, POINTS, SCORED

from gesture_core.errors import KeypointError


@pytest.mark.parametrize(("suffix", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress)])
def test_packed_files_are_what_they_hold(tmp_path: Path, suffix: str, pack: Callable[[bytes], bytes]) -> None:
    table = save(tmp_path / "k.csv", named(COCO17.joints), flat(POINTS))
    np.save(tmp_path / "k.npy", SCORED)
    frames = enumerate(SCORED.reshape(FRAMES, -1).tolist())
    result = [{"image_id": f"{n}.jpg", "keypoints": frame, "score": 1} for n, frame in frames]
    (tmp_path / "k.json").write_text(json.dumps(result))
    for name, reader in (("k.csv", CsvReader()), ("k.npy", ArrayReader()), ("k.json", ResultListReader())):
        packed = tmp_path / f"{name}{suffix}"
        packed.write_bytes(pack((tmp_path / name).read_bytes()))
        assert reader.accepts(packed)
        same(reader.read(packed)[0], POINTS, COCO17.joints)
        packed.write_bytes(packed.read_bytes()[:-40])
        with pytest.raises(KeypointError) as caught:
            reader.read(packed)
        assert caught.value.code == "E_KEYPOINTS_BROKEN" and caught.value.subject
    assert table.exists()


def test_what_unpacks_to_too_much_is_refused_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gesture_pose_files.csv_table.MAX_CSV_BYTES", 1 << 20)
    (tmp_path / "k.csv.gz").write_bytes(
        gzip.compress(",".join(named(COCO17.joints)).encode() + (b"\n1" + b",2" * 33) * (1 << 15))
    )
    with pytest.raises(KeypointError) as caught:
        CsvReader().read(tmp_path / "k.csv.gz")
    assert caught.value.code == "E_KEYPOINTS_LIMIT"


def test_what_the_variables_of_matlab_unpack_to_is_limited_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "clip.mat"
    scipy.io.savemat(path, {f"a{n}": np.zeros((1000, 100)) for n in range(4)}, do_compression=True)
    monkeypatch.setattr("gesture_pose_files.mat5.MAX_LIST_BYTES", 2_000_000)
    with pytest.raises(KeypointError) as caught:
        MatlabReader().read(path)
    assert caught.value.code == "E_KEYPOINTS_LIMIT"


@pytest.mark.parametrize("suffix", [".parquet", ".feather"])
@pytest.mark.parametrize("what", ["lists", "texts"])
def test_what_a_table_unpacks_to_is_known_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, what: str
) -> None:
    import pyarrow as pa
    import pyarrow.feather
    import pyarrow.parquet

    path = tmp_path / f"clip{suffix}"
    more = [np.zeros(500_000)] * 3 if what == "lists" else ["x" * 1_000_000] * 3
    table = pa.table({name: [1.0, 2.0, 3.0] for name in NAMES} | {"more": more})
    if suffix == ".parquet":
        pa.parquet.write_table(table, path)
    else:
        pa.feather.write_feather(table, path, compression="zstd")
    monkeypatch.setattr("gesture_pose_files.arrow_table.MAX_ARRAY_BYTES", 2_000_000)
    with pytest.raises(KeypointError) as caught:
        ArrowTableReader().read(path)
    assert caught.value.code == "E_KEYPOINTS_LIMIT"


@pytest.mark.parametrize(
    "data", [b"hello", gzip.compress(b"0," * 1000, mtime=0)[:-9]], ids=["no gzip", "cut off"]
)
def test_a_packed_file_that_is_damaged_is_none_of_another_kind(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "clip.csv.gz"
    path.write_bytes(data)
    with pytest.raises(KeypointError) as caught:
        CsvReader().accepts(path)
    assert caught.value.code == "E_KEYPOINTS_BROKEN"
