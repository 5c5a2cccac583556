"""Keypoint files of every kind, fuzzed: a sequence or a typed error comes back, cheaply.

2,000 frames of JSON altogether; `benchmarks/soak_media.py` does the same with more.
"""

from __future__ import annotations

import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frames import frame_name, frame_text, person
from gesture_pose_files.arrays import ArrayReader
from gesture_pose_files.csv_table import CsvReader
from gesture_pose_files.files import MAX_JSON_BYTES
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from json_fuzz import corpus, fuzz
from outcomes import check, check_frame

# Two seconds of this process's own time are the contract; Hypothesis would count what others take.
FUZZ: dict[str, Any] = {"deadline": None, "suppress_health_check": list(HealthCheck)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


numbers = st.integers(-(10**30), 10**30) | st.floats(allow_nan=True, allow_infinity=True)
anything = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)
values = st.one_of(
    *(st.lists(st.floats(-2e3, 2e3), min_size=n, max_size=n) for n in (45, 54, 75)),
    st.lists(numbers, max_size=80),
    anything,
)
people = st.lists(
    st.dictionaries(
        st.sampled_from(["pose_keypoints_2d", "pose_keypoints", "person_id", "x"]), values, max_size=3
    )
    | anything,
    max_size=4,
)


@given(st.fixed_dictionaries({"people": people}, optional={"version": anything}) | anything)
@settings(max_examples=400, **FUZZ)
def test_any_json(folder: Path, tree: Any) -> None:
    check_frame(folder, json.dumps(tree).encode("utf-8", "replace"))


@given(st.binary(max_size=300) | st.text(max_size=100).map(lambda text: text.encode("utf-8", "replace")))
@settings(max_examples=200, **FUZZ)
def test_any_bytes(folder: Path, data: bytes) -> None:
    check_frame(folder, data)


def test_broken_frames(folder: Path) -> None:
    frames = corpus()
    outcomes = [check_frame(folder, fuzz(frames, f"suite:{number}")) for number in range(1400)]
    assert outcomes.count("ok") > 50 and outcomes.count("ok") < 1300
    assert {"E_KEYPOINTS_JSON", "E_KEYPOINTS_FORMAT", "E_KEYPOINTS_VALUE"} <= set(outcomes)


def test_the_corpus_itself(folder: Path) -> None:
    outcomes = [check_frame(folder, data) for data in corpus()]
    assert outcomes.count("ok") >= 8 and len(set(outcomes)) >= 3


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
def test_the_costliest_frames_are_cheap(tmp_path: Path) -> None:
    """As large as a frame may be, each made to cost a parser most: under 256 MB and 2 s."""
    size = MAX_JSON_BYTES - 64
    costly = {
        "lists": b"[" + b"[]," * (size // 3) + b"[]]",
        "objects": b"[" + b"{}," * (size // 3) + b"{}]",
        "keys": b"{" + b",".join(b'"%x":0' % n for n in range(size // 12)) + b"}",
        "strings": b"[" + b",".join(b'"%x"' % n for n in range(size // 9)) + b"]",
        "floats": b'{"people":[{"pose_keypoints_2d":[' + b"1e1," * (size // 5) + b"1]}]}",
        "people": b'{"people":[' + b'{"pose_keypoints_2d":[]},' * (size // 26) + b"{}]}",
        "digits": b"[0." + b"1" * size + b"]",
        "escaped quotes": b'["' + b'\\"' * (size // 2),
        "quotes": b'"' * size,
        "brackets": b"[" * size,
        "backslashes": b"\\" * size,
        "crowd": frame_text([person(25, (i, 0)) for i in range(1800)]).encode(),
    }
    folders = []
    for name, data in costly.items():
        assert len(data) <= MAX_JSON_BYTES
        (tmp_path / name).mkdir()
        (tmp_path / name / frame_name("f", 0)).write_bytes(data)
        folders.append(str(tmp_path / name))
    script = (
        "import sys, time\nfrom pathlib import Path\n"
        "from gesture_core.errors import KeypointError\n"
        "from gesture_pose_files.openpose_json import OpenPoseJsonReader\n"
        "for name in sys.argv[1:]:\n"
        "    start = time.process_time()\n"
        "    try:\n        OpenPoseJsonReader().read(Path(name)); code = 'ok'\n"
        "    except KeypointError as error:\n        code = error.code\n"
        "    peak = int(open('/proc/self/status').read().split('VmHWM:')[1].split()[0]) // 1024\n"
        "    print(Path(name).name, code, peak, time.process_time() - start, sep='|')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, *folders], capture_output=True, text=True, timeout=120
    )
    lines = [line.split("|") for line in done.stdout.splitlines()]
    assert len(lines) == len(costly), done.stderr
    for name, _, peak, seconds in lines:
        assert int(peak) < 256 and float(seconds) < 2, (name, peak, seconds)


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def _npz(**arrays: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _broken(data: bytes, draw: Any) -> bytes:
    out = bytearray(data)
    for at, value in draw:
        out[at % len(out)] = value
    return bytes(out)


_flips = st.lists(st.tuples(st.integers(0, 1 << 20), st.integers(0, 255)), min_size=1, max_size=12)
_body = np.random.default_rng(0).uniform(0.1, 0.9, (4, 18, 3))


@given(_flips, st.integers(1, 3000), st.booleans())
@settings(max_examples=250, **FUZZ)
def test_broken_npy(folder: Path, flips: Any, keep: int, head: bool) -> None:
    flips = [(at % 128 if head else at, value) for at, value in flips]
    (folder / "x.npy").write_bytes(_broken(_npy(_body), flips)[:keep])
    check(ArrayReader(), folder / "x.npy")


@given(_flips, st.integers(1, 6000))
@settings(max_examples=250, **FUZZ)
def test_broken_npz(folder: Path, flips: Any, keep: int) -> None:
    data = _npz(
        keypoints=_body[..., :2], scores=_body[..., 2], skeleton=np.array("coco18"), times=np.arange(4.0)
    )
    (folder / "x.npz").write_bytes(_broken(data, flips)[:keep])
    check(ArrayReader(), folder / "x.npz")


@given(st.text("{}[]()'<>fiuOUV0123456789,: descrshapfotn_TrueFls", max_size=80))
@settings(max_examples=150, **FUZZ)
def test_any_npy_header(folder: Path, text: str) -> None:
    body = text.encode().ljust(118) + b"\n"
    data = b"\x93NUMPY\x01\x00" + len(body).to_bytes(2, "little") + body + bytes(64)
    (folder / "x.npy").write_bytes(data)
    check(ArrayReader(), folder / "x.npy")
    with zipfile.ZipFile(folder / "y.npz", "w") as archive:
        archive.writestr("a.npy", data)
    check(ArrayReader(), folder / "y.npz")


_cells = st.text("0123456789.eE+-naif \"'=@", max_size=6) | st.floats().map(repr) | st.text(max_size=3)
_heads = st.sampled_from(
    ["time,nose_x,nose_y,neck_x,neck_y,person", "nose_x,nose_y,nose_score,neck_x,neck_y,frame"]
)


@given(
    _heads | st.none(), st.lists(st.lists(_cells, min_size=6, max_size=6), max_size=6), st.binary(max_size=4)
)
@settings(max_examples=250, **FUZZ)
def test_any_named_table(folder: Path, head: str | None, rows: list[list[str]], tail: bytes) -> None:
    text = "\n".join([*([] if head is None else [head]), *(",".join(row) for row in rows)])
    (folder / "x.csv").write_bytes(text.encode("utf-8", "replace") + tail)
    check(CsvReader(people="multi"), folder / "x.csv")


@given(_flips, st.integers(0, 4000))
@settings(max_examples=150, **FUZZ)
def test_broken_bare_table(folder: Path, flips: Any, keep: int) -> None:
    text = "\n".join(",".join(map(str, row)) for row in _body[..., :2].reshape(4, -1).round(3))
    (folder / "x.csv").write_bytes(_broken(text.encode(), flips)[:keep])
    check(CsvReader(), folder / "x.csv")
