"""`gesture demo` draws, classifies and says how many labels are right and what to look at next."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest

from gesture_core.cli.main import run
from gesture_core.demo import archive


def test_the_demonstration_ends_with_its_accuracy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = functools.partial(archive.write_archive, queries=1, examples=1)
    monkeypatch.setattr(archive, "write_archive", small)
    out = tmp_path / "two words"
    arguments = ["demo", "--keypoints", "--out", str(out), "--preset", "paper", "--kernel", "numpy"]
    assert run(arguments) == 0
    said = capsys.readouterr()
    right, of = said.out.splitlines()[-1].split(" labels")[0].split(" of ")
    assert int(of) == 6 and int(right) >= 4
    assert "wave/1" in said.out
    assert f"why: gesture explain '{out}/run' clip_01" in said.err
    (tmp_path / "mine.txt").touch()
    assert run(["demo", "--out", str(tmp_path)]) == 2
    assert "holds something else" in capsys.readouterr().err
