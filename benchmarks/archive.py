"""How many hours of video an hour and a core extract, and where the time goes.

    python benchmarks/archive.py --seconds 20 --rounds 3

Videos of a drawn person, H.264, 640 x 480 and 1920 x 1080, 30 and 60 frames a second, are made by PyAV. The
file is taken to keypoints in the store as a worker does it, with one thread, in this process; beside that is
decoding alone (PyAV, and ffmpeg where it is installed), and the bare network on what it is given. Rounds
alternate, the least CPU time of each counts: the seconds are of one core, whatever else the machine does.
`overhead` is what all of it costs above the larger of decoding and network, where one could run beside the
other; `one core` is above the sum of both, which is the least that one core can do.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from typing import Any

import numpy as np
from environment import header, one_thread

one_thread()

from gesture_core.files import content_sha256  # noqa: E402 - threads come first
from gesture_core.run.store import write_keypoints  # noqa: E402
from gesture_core.run.workers.engines import KEPT_MEMORY  # noqa: E402
from gesture_core.settings import Settings, load_settings  # noqa: E402

SIZES = ((640, 480), (1920, 1080))
RATES = (30, 60)


def draw(path: Path, width: int, height: int, rate: int, seconds: float) -> None:
    """Somebody who waves before a noisy wall, as H.264 of the quality of a camera."""
    import av

    from gesture_core.demo.archive import write_archive

    with tempfile.TemporaryDirectory() as folder:
        clip = write_archive(Path(folder), queries=1, examples=1, seed=7).videos / "clip_01.mp4"
        with av.open(str(clip)) as container:
            frames = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
    import cv2

    side = min(height, width)
    large = [cv2.resize(frame, (side, side), interpolation=cv2.INTER_CUBIC) for frame in frames]
    noise = np.random.default_rng(0).normal(0, 4, (height, width, 3)).astype(np.int16)
    left = (width - side) // 2
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": "23", "preset": "medium"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for number in range(int(seconds * rate)):
            picture = np.full((height, width, 3), 96, np.int16)
            turn = number * 25 // rate % (2 * len(large) - 2)
            picture[:side, left : left + side] = large[min(turn, 2 * len(large) - 2 - turn)]
            picture += np.roll(noise, number * 7, axis=0)
            frame = av.VideoFrame.from_ndarray(picture.clip(0, 255).astype(np.uint8), format="bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


class Clock:
    """CPU seconds of parts, each without those inside it."""

    def __init__(self) -> None:
        self.parts: dict[str, float] = {}
        self._open: list[float] = []

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """What the block costs counts as ``name``."""
        started = time.process_time()
        self._open.append(0.0)
        try:
            yield
        finally:
            took = time.process_time() - started
            inside = self._open.pop()
            self.parts[name] = self.parts.get(name, 0.0) + took - inside
            if self._open:
                self._open[-1] += took

    def called(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """``function``, whose calls count as ``name``."""

        def timed(*arguments: Any, **options: Any) -> Any:
            with self.part(name):
                return function(*arguments, **options)

        return timed

    def each(self, name: str, stream: Iterator[Any]) -> Iterator[Any]:
        """``stream``, whose steps count as ``name``."""
        while True:
            with self.part(name):
                item = next(stream, None)
            if item is None:
                return
            yield item


def extracted(path: Path, settings: Settings, backend: Any, clock: Clock, store: Path) -> int:
    """One video to keypoints in the store, as a worker does it; the frames that were looked at."""
    from gesture_core.pose.extract import extract_poses
    from gesture_core.video import at_rate, open_configured, pictures

    with clock.part("read"):
        sha256 = content_sha256(path)
    with clock.part("follow"), open_configured(path, settings) as video:
        passing = clock.each("decode", pictures(video))
        lazily = ((at, clock.called("convert", convert)) for at, convert in passing)
        looked = 0

        def frames() -> Iterator[tuple[float, np.ndarray]]:
            nonlocal looked
            for frame in at_rate(lazily, settings.pose.rate):
                looked += 1
                yield frame

        sequences = extract_poses(frames(), backend, source=path.name)
    with clock.part("write"):
        write_keypoints(store / f"{sha256[:16]}.parquet", sequences, {"notes": []})
    return looked


def pyav(path: Path) -> None:
    """Decode all frames, on one thread."""
    import av

    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type, stream.codec_context.thread_count = "NONE", 1
        for _ in container.decode(stream):
            pass


def ffmpeg(path: Path) -> None:
    """The same by the program."""
    command = ["ffmpeg", "-v", "error", "-threads", "1", "-i", str(path), "-f", "null", "-"]
    subprocess.run(command, check=True)


def cpu(function: Callable[[], Any]) -> float:
    """CPU seconds of a call, those of its processes included."""
    before, children = time.process_time(), getrusage(RUSAGE_CHILDREN)
    function()
    after = getrusage(RUSAGE_CHILDREN)
    return (
        time.process_time()
        - before
        + sum(getattr(after, name) - getattr(children, name) for name in ("ru_utime", "ru_stime"))
    )


def measure(path: Path, settings: Settings, backend: Any, rounds: int, store: Path) -> dict[str, float]:
    """The least CPU seconds of each part over rounds that alternate."""
    best: dict[str, float] = {}
    run = backend.run
    programs = [("pyav", pyav)] + ([("ffmpeg", ffmpeg)] if shutil.which("ffmpeg") else [])
    for _ in range(rounds):
        clock = Clock()
        batches: list[Any] = []

        def kept(batch: Any, into: list[Any] = batches, clock: Clock = clock) -> Any:
            into.append(batch)
            return clock.called("network", run)(batch)

        backend.run = kept
        looked = extracted(path, settings, backend, clock, store)
        backend.run = run
        found = {**clock.parts, "all": sum(clock.parts.values()), "looked": float(looked)}
        found["bare"] = cpu(lambda batches=batches: [run(batch) for batch in batches])
        found |= {name: cpu(lambda program=program: program(path)) for name, program in programs}
        for name, value in found.items():
            best[name] = min(best.get(name, value), value)
    return best


def main() -> None:
    """Print a row for each kind of video."""
    asked = argparse.ArgumentParser()
    asked.add_argument("--seconds", type=float, default=20.0)
    asked.add_argument("--rounds", type=int, default=3)
    asked.add_argument("--model", default="compact")
    asked.add_argument("--rate", default="")
    given = asked.parse_args()
    if not set(KEPT_MEMORY) <= set(os.environ):  # which a worker starts with, and which holds from a start on
        os.execve(sys.executable, [sys.executable, *sys.argv], KEPT_MEMORY | os.environ)
    header()
    settings = load_settings(None, pose__model=given.model)
    if given.rate:
        settings = settings.with_values([("pose.rate", None if given.rate == "none" else float(given.rate))])
    from gesture_core.pose.extract import open_backend

    backend = open_backend(replace(settings, pose=replace(settings.pose, backend="onnx")), 1)
    names = ("read", "decode", "convert", "network", "follow", "write")
    print(f"\n{given.seconds:g} s of video each, pose.rate {settings.pose.rate}\n")
    heads = (
        "video",
        "hours an hour",
        *names,
        "decoding alone",
        "ffmpeg",
        "bare network",
        "overhead",
        "one core",
    )
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    with tempfile.TemporaryDirectory() as folder:
        for width, height in SIZES:
            for rate in RATES:
                path = Path(folder, f"{width}x{height}-{rate}.mp4")
                draw(path, width, height, rate, given.seconds)
                best = measure(path, settings, backend, given.rounds, Path(folder))
                whole, alone, bare = best["all"], best["pyav"], best["bare"]
                cells = [
                    f"{width} x {height}, {rate}/s",
                    f"{given.seconds / whole:.1f}",
                    *(f"{best.get(name, 0.0) / whole:.0%}" for name in names),
                    f"{alone / whole:.0%}",
                    f"{best['ffmpeg'] / whole:.0%}" if "ffmpeg" in best else "-",
                    f"{bare / whole:.0%}",
                    f"{whole / max(alone, bare) - 1:.0%}",
                    f"{whole / (alone + bare) - 1:.0%}",
                ]
                print(f"| {' | '.join(cells)} |", flush=True)
    print("\nShares are of all CPU seconds from the file to the keypoint store.")


if __name__ == "__main__":
    main()
