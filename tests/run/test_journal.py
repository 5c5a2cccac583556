"""What the network said of a long video outlives a killed run, and changes nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from tiny_networks import FIGURE, dot_network, dot_picture

from gesture_core.files import TEMPORARY
from gesture_core.pose.extract import extract_poses
from gesture_core.run.store import read_keypoints
from gesture_core.run.workers.journal import remembering
from gesture_core.types import Person


class Asked:
    """A backend that counts what it is asked, and is killed at some picture."""

    skeleton, batch_size, follow, crop, steady = "coco18", 4, False, 1.2, True

    def __init__(self, killed_at: int = 10**9) -> None:
        self.pictures, self._killed_at = 0, killed_at

    def estimate(self, frames: Sequence[np.ndarray], people: str = "single") -> list[list[Person]]:
        self.pictures += len(frames)
        if self.pictures > self._killed_at:
            raise KeyboardInterrupt
        answer = []
        for frame in frames:
            rng = np.random.default_rng(int(frame[0, 0, 0]))
            peaks = rng.uniform(0, 1, (18, 3, 3)).astype(np.float32)
            peaks[..., :2] += 100 * FIGURE[:, None]
            everybody = [
                Person(peaks[:, 0, :2], rng.uniform(0.5, 1, 18), peaks, 0.9, rng.uniform(size=(2, 2)), 1),
                Person(peaks[:, 1, :2] + 500, rng.uniform(0.5, 1, 18)),
            ]
            answer.append(everybody[: 1 + (people == "multi")] if frame[0, 0, 0] % 5 else [])
        return answer


def frames(count: int = 60) -> list[tuple[float, np.ndarray]]:
    return [(n / 20, np.full((8, 8, 3), n, np.uint8)) for n in range(count)]


@pytest.mark.parametrize("people", ["single", "multi"])
@pytest.mark.parametrize("torn", [0, 7])
def test_what_was_answered_is_not_asked_again(tmp_path: Path, people: str, torn: int) -> None:
    stored = tmp_path / "ab" / "abc.parquet"
    whole = extract_poses(frames(), Asked(), people)
    with pytest.raises(KeyboardInterrupt), remembering(Asked(41), stored) as asked:
        extract_poses(frames(), asked, people)
    (journal,) = stored.parent.glob(f"*{TEMPORARY}*.journal")
    if torn:
        os.truncate(journal, journal.stat().st_size - torn)
    again = Asked()
    with remembering(again, stored) as asked:
        found = extract_poses(frames(), asked, people)
    assert again.pictures == (24 if torn else 20)
    assert len(found) == len(whole) > 0
    for one, other in zip(found, whole, strict=True):
        for name in ("keypoints", "scores", "times"):
            assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
    assert not list(stored.parent.iterdir())


def test_a_journal_of_other_pictures_is_not_believed(tmp_path: Path) -> None:
    stored = tmp_path / "abc.parquet"
    with pytest.raises(KeyboardInterrupt), remembering(Asked(41), stored) as asked:
        extract_poses(frames(), asked)
    again = Asked()
    again.batch_size = 5
    with remembering(again, stored) as asked:
        found = extract_poses(frames(), asked)
    assert again.pictures == 60
    assert np.array_equal(found[0].keypoints, extract_poses(frames(), again)[0].keypoints, equal_nan=True)


def test_two_at_one_video_do_not_mix(tmp_path: Path) -> None:
    stored = tmp_path / "abc.parquet"
    first, second = Asked(), Asked()
    with remembering(first, stored) as one, remembering(second, stored) as other:
        assert other is second and one is not first


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_killed_run_goes_on_inside_a_video(tmp_path: Path) -> None:
    network = dot_network(tmp_path / "dots.onnx")
    (tmp_path / "videos").mkdir()
    writer = cv2.VideoWriter(
        str(tmp_path / "videos" / "a.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 20, (96, 96)
    )
    for t in range(1100):
        joints = FIGURE * 80 + 8
        joints[4] += [14 * np.sin(t / 3), 10 * np.cos(t / 7)]
        writer.write(dot_picture((96, 96), joints, 3))
    writer.release()

    def start(cache: str) -> tuple[subprocess.Popen[bytes], Path]:
        folder = tmp_path / cache
        command = [
            sys.executable, "-m", "gesture_core", "extract", str(tmp_path / "videos"),
            "--out", str(tmp_path / f"run-{cache}"), "--model", str(network), "--set", "pose.rate=none",
        ]  # fmt: skip
        environment: dict[str, Any] = {**os.environ, "GESTURE_CACHE": str(folder)}
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(
            command, env=environment, stdout=quiet, stderr=quiet, start_new_session=True
        )
        return process, folder / "keypoints"

    process, store = start("killed")
    until, size = time.monotonic() + 60, 0
    while size < 8_000 and time.monotonic() < until and process.poll() is None:
        time.sleep(0.01)
        size = max([one.stat().st_size for one in store.glob("*/*.journal")], default=0)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert size >= 8_000
    for cache in ("killed", "whole"):
        process, _ = start(cache)
        assert process.wait(120) == 0
    found, whole = (read_keypoints(next((tmp_path / one / "keypoints").glob("*/*.parquet"))).sequences
                    for one in ("killed", "whole"))  # fmt: skip
    assert np.array_equal(found[0].keypoints, whole[0].keypoints, equal_nan=True)
    assert not list(store.glob("*/*.journal"))
