"""Videos through the whole run: a tiny network that sees coloured dots, and the awkward media files."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from distributions import gesture
from tiny_networks import FIGURE, dot_network, dot_picture

COMMON = ("--preset", "paper", "--kernel", "numpy")
ODD_NAMES = (
    b" a b .mp4",
    b"q'\"uote.mp4",
    b"-dash.mp4",
    b"new\nline.mp4",
    b"\xff\xfe.mp4",
    b"%d.mp4",
    b"a:b.mp4",
)


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dot_network(tmp_path_factory.mktemp("net") / "dots.onnx")


def film(path: Path, moving: int, frames: int = 40) -> Path:
    """A clip in which joint ``moving`` of the dotted figure swings."""
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20, (96, 96))
    for t in range(frames):
        joints = FIGURE * 80 + 8
        joints[moving] += [14 * np.sin(t / 3), 10 * np.cos(t / 3)]
        writer.write(dot_picture((96, 96), joints, 3))
    writer.release()
    return path


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("examples")
    film(folder / "right" / "1.avi", 4)
    film(folder / "left" / "1.avi", 7)
    return folder


def rows(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


@pytest.mark.parametrize("backend", ["onnx", "opencv-dnn"])
def test_pixels_become_labels(network: Path, examples: Path, tmp_path: Path, backend: str) -> None:
    film(tmp_path / "videos" / "a.avi", 4, 50)
    film(tmp_path / "videos" / "b.avi", 7, 33)
    done = gesture(
        "classify", tmp_path / "videos", "--examples", examples, "--out", tmp_path / "run", *COMMON,
        "--model", network, "--pose", backend,
    )  # fmt: skip
    found = rows(done.stdout)
    assert [row["label"] for row in found] == ["right", "left"], done.stderr
    assert [row["frames_read"] for row in found] == [50, 33]
    assert [row["frames_looked_at"] for row in found] == [50, 33]
    assert found[0]["seconds"] == pytest.approx(49 / 20, abs=0.02)
    assert done.returncode == 0


def test_a_row_says_how_many_frames_were_looked_at(network: Path, tmp_path: Path) -> None:
    film(tmp_path / "videos" / "a.avi", 4, 50)
    for rate, count in (("5", 13), ("none", 50), ("10", 25)):
        done = gesture("extract", tmp_path / "videos", "--out", tmp_path / rate, "--model", network,
                       "--set", f"pose.rate={rate}")  # fmt: skip
        (row,) = rows(done.stdout)
        assert (row["frames_read"], row["frames_looked_at"], row["frames_with_pose"]) == (50, count, count)
        assert row["seconds"] == pytest.approx(49 / 20, abs=0.001), (
            "as long as the video, not as what was seen"
        )


def test_a_cut_video_is_degraded_and_says_so(network: Path, examples: Path, tmp_path: Path) -> None:
    whole = film(tmp_path / "videos" / "cut.avi", 4, 60)
    data = whole.read_bytes()
    whole.write_bytes(data[: len(data) * 6 // 10])
    done = gesture(
        "classify", tmp_path / "videos", "--examples", examples, "--out", tmp_path / "run", *COMMON,
        "--model", network,
    )  # fmt: skip
    (row,) = rows(done.stdout)
    assert row["status"] in ("degraded", "error"), row
    assert row["code"].startswith("E_MEDIA")
    assert done.returncode == 3


@pytest.mark.skipif(os.name != "posix", reason="other systems have no such names")
@pytest.mark.parametrize("reader", ["pyav", "opencv"])
def test_odd_names_and_nasty_media_are_one_row_each(
    shared: Path, network: Path, examples: Path, tmp_path: Path, reader: str
) -> None:
    source = tmp_path / "source"
    shutil.copytree(shared / "nasty_media", source)
    (source / "MANIFEST.csv").chmod(0o644)
    healthy = film(tmp_path / "healthy.avi", 4).read_bytes()
    for name in ODD_NAMES:
        (source / os.fsdecode(name)).write_bytes(healthy)
        nasty = (source / "corrupted.mp4").read_bytes()
        (source / os.fsdecode(b"nasty" + name)).write_bytes(nasty)
    done = gesture(
        "classify", source, "--examples", examples, "--out", tmp_path / "run", *COMMON,
        "--model", network, "--set", f"pose.reader={reader}", "--set", "limits.seconds=60",
    )  # fmt: skip
    found = rows(done.stdout)
    assert len(found) == len({row["input"] for row in found}) == 24 + 2 * len(ODD_NAMES), done.stderr
    assert "Traceback" not in done.stderr
    healthy_rows = [row for row in found if row["label"] == "right" and row["status"] == "ok"]
    assert len(healthy_rows) == len(ODD_NAMES)
    assert not [row for row in found if row["code"].startswith("E_WORKER")]


@pytest.mark.parametrize("damage", ["text", "cut", "flip", "external"])
def test_a_bad_model_is_fatal_before_the_archive_is_touched(
    network: Path, examples: Path, tmp_path: Path, damage: str
) -> None:
    import onnx

    data = network.read_bytes()
    bad = tmp_path / "bad.onnx"
    if damage == "external":
        model = onnx.load(network)
        onnx.save(model, bad, save_as_external_data=True, location="weights.bin", size_threshold=0)
    else:
        bad.write_bytes({"text": b"hello", "cut": data[: len(data) // 2], "flip": data[::-1]}[damage])
    done = gesture(
        "classify", film(tmp_path / "a.avi", 4), "--examples", examples, "--out", tmp_path / "run", *COMMON,
        "--model", bad,
    )  # fmt: skip
    assert done.returncode == 1, done.stdout
    assert done.stderr.startswith("E_MODEL") and "Traceback" not in done.stderr
