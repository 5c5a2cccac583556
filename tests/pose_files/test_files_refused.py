"""What no reader takes: the nearest reader says why, and a run that read nothing does not end with 0."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest
from frames import frame_text, person

from gesture_core.plugin import registry
from gesture_core.run.inputs import discover
from gesture_core.run.pipeline import RunSummary

REFUSED = {
    "a.csv": (b"subject,age\n1,20\n", "csv: its header 'subject,age' names no joints"),
    "b.json": (
        b'{"licence": "x", "files": [1]}',
        "result-list: it is an object with 'licence', 'files', and no",
    ),
    "c.json": (
        frame_text([person(25, (0, 0))]).encode(),
        "openpose-json: it is one frame, and a clip is a folder",
    ),
    "d.pkl": (pickle.dumps({"annotations": []}), "arrays: pickles are not opened, for they can run any code"),
    "e.npy": (b"hello", "arrays: it does not begin as NumPy's files do, but with b'hello'"),
    "f.md": (b"# notes", "neither a video nor a keypoint file"),
    "g.ts": (
        b"# Basic\n@data\n1,2:a\n",
        "a keypoint file, but series of channels, which --preset sensors reads",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_the_nearest_reader_says_why(tmp_path: Path, name: str) -> None:
    data, reason = REFUSED[name]
    (tmp_path / name).write_bytes(data)
    (item,) = discover([tmp_path])
    assert item.kind == "other" and reason in item.fault, item.fault


def test_a_reader_that_lacks_its_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = registry().find("reader", "result-list")
    lacking = type(entry)(**{**vars(entry), "needs": ("a_module_that_is_not_there",), "extra": "lists"})
    monkeypatch.setitem(registry().entries, ("reader", "result-list"), [lacking])
    (tmp_path / "a.json").write_text(json.dumps([{"image_id": "0.jpg", "keypoints": []}]))
    (item,) = discover([tmp_path])
    assert item.kind == "broken" and item.code == "E_MISSING_DEPENDENCY"
    assert "needs a_module_that_is_not_there: pip install 'gesture-core[lists]'" in item.fault


@pytest.mark.parametrize(
    ("counts", "code"),
    [({"skipped": 3}, 3), ({"skipped": 3, "ok": 1}, 0), ({"skipped": 1, "rejected": 1}, 0), ({}, 0)],
)
def test_a_run_that_could_read_nothing_does_not_end_with_0(counts: dict[str, int], code: int) -> None:
    assert RunSummary(Path(), counts).exit_code == code
