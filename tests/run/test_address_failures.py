"""Stores that fail, cut off, or change while they are read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from test_addresses import classify, folder, memory, results

from gesture_core.errors import InputError
from gesture_core.files import content_sha256
from gesture_core.run import addresses
from gesture_core.run.addresses import fetch, look, sha256_of

__all__ = ["folder", "memory"]


def test_a_listing_that_fails_changes_nothing(
    folder: Path, memory: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = results(classify("memory://videos", "memory://examples", folder / "far"))
    ls = type(memory).ls

    def failing(self: Any, path: str, *arguments: Any, **options: Any) -> Any:
        if "day1" in path:
            raise OSError("503 slow down")
        return ls(self, path, *arguments, **options)

    monkeypatch.setattr(type(memory), "ls", failing)
    with pytest.raises(InputError, match="503 slow down") as caught:
        classify("memory://videos", "memory://examples", folder / "far")
    assert caught.value.code == "E_READ"
    monkeypatch.undo()
    monkeypatch.setenv("GESTURE_CACHE", str(folder / "cache"))
    again = classify("memory://videos", "memory://examples", folder / "far")
    assert again.done_now == 0 and results(again) == before
    with pytest.raises(InputError, match="no such object"):
        classify("memory://nowhere", "memory://examples", folder / "other")


class Cut:
    """Reads of a file system of which the first are cut off."""

    def __init__(self, system: Any, times: int) -> None:
        self._whole, self.left = type(system).get_file, times

    def __call__(self, system: Any, source: str, target: str, **options: Any) -> None:
        self._whole(system, source, target, **options)
        if self.left > 0:
            self.left -= 1
            data = Path(target).read_bytes()
            Path(target).write_bytes(data[: len(data) // 2])


@pytest.mark.parametrize(("times", "code"), [(1, ""), (9, "E_READ")])
def test_what_is_cut_off_is_read_again(
    memory: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, times: int, code: str
) -> None:
    cut = Cut(memory, times)
    monkeypatch.setattr(type(memory), "get_file", lambda self, *a, **o: cut(self, *a, **o))
    monkeypatch.setattr("gesture_core.run.addresses.time.sleep", lambda seconds: None)
    entry = look("memory://videos/day0/left.npz")
    if code:
        with pytest.raises(InputError, match="bytes could be read") as caught:
            fetch(entry, tmp_path / "clip.npz")
        assert caught.value.code == code and not (tmp_path / "clip.npz").exists()
    else:
        fetch(entry, tmp_path / "clip.npz")
        assert (tmp_path / "clip.npz").stat().st_size == entry.size


def test_an_object_that_is_replaced_while_it_is_read_is_said(memory: Any, tmp_path: Path) -> None:
    entry = look("memory://videos/day0/left.npz")
    memory.pipe("/videos/day0/left.npz", memory.cat("/videos/day0/right.npz"))
    with pytest.raises(InputError) as caught:
        fetch(entry, tmp_path / "clip.npz")
    assert caught.value.code == "E_CHANGED"


def test_an_etag_counts_only_once_it_was_seen_to_be_the_hash(memory: Any, tmp_path: Path) -> None:
    entry = look("memory://videos/day0/left.npz")
    wrong = replace(entry, md5="0" * 32)
    fetch(wrong, tmp_path / "clip.npz")
    assert sha256_of(wrong) == ""
    right = replace(entry, md5=addresses._md5(tmp_path / "clip.npz"))
    (tmp_path / "clip.npz").unlink()
    fetch(right, tmp_path / "clip.npz")
    assert sha256_of(right) == content_sha256(tmp_path / "clip.npz")
    for odd in (b"../../elsewhere", b"\xff", b"0" * 65):
        addresses._known(right).write_bytes(odd)
        assert sha256_of(right) == "", "what a shared cache says is no path"
