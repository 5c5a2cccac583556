"""``gesture bench`` on drawn series and on a folder of one's own."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from gesture_core.cli.bench import bench
from gesture_core.cli.flags import KernelFlags
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import GestureError
from gesture_core.plugin import registry


def test_own_data_are_timed_and_the_choice_is_printed_and_recorded(
    drawn: DemoArchive, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    out = tmp_path / "bench.json"
    flags = KernelFlags(kernel="numpy", preset="paper")
    assert bench(str(drawn.example_keypoints), flags=flags, series=4, out=out) == 0
    printed = capsys.readouterr().out
    assert "4 series" in printed and "36 channels" in printed and "CPU µs / pair" in printed
    record = json.loads(out.read_text("utf-8"))
    assert f"classify.kernel = auto takes {record['auto']!r}" in printed
    assert record["auto"] in registry().names("kernel", usable=True)
    (timing,) = record["kernels"]
    assert timing["kernel"] == "numpy" and timing["pairs"] == 16 and timing["deviation"] == 0
    assert timing["wall_seconds"] > 0 and timing["cpu_seconds_per_pair"] >= 0


def test_an_approximation_is_named_but_not_timed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert bench(flags=KernelFlags(kernel="fastdtw"), series=3) == 0
    assert "fastdtw" in (printed := capsys.readouterr().out)
    assert "not timed" in printed or "does not compute" in printed
    monkeypatch.setattr(sys.stdout, "isatty", lambda: False)
    assert bench(flags=KernelFlags(kernel="fastdtw"), series=3) == 0
    (one,) = json.loads(capsys.readouterr().out)["kernels"]
    assert one == {"kernel": "fastdtw", "not_timed": "an approximation, not timed"}


def test_a_folder_without_series_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(GestureError):
        bench(str(tmp_path), flags=KernelFlags(kernel="numpy"), series=3)
