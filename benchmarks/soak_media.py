"""Damaged media and broken keypoint files in large numbers: the tests' own generators, let run.

    python benchmarks/soak_media.py --media 10000 --json 100000 --seed 1

Prints a table for each and ends with 1 where anything crashed, hung, came back untyped, lost frames in
silence, or cost more than it may. The same seed makes the same files (the encoders permitting).
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "video"), str(ROOT / "tests" / "pose_files")]

_BATCH = 200
_BAD = ("crash", "hang", "untyped")
_JSON_MIB = 256
# What a run gives a worker without a sign of progress.
_SECONDS = 120.0
# Healthy files of other makers, small enough to decode ten thousand times.
_FOREIGN = (
    "video_90.mov", "bear-vp9-odd-dimensions.webm", "sample_av1.mp4", "h265_10bits.mp4", "portrait.MOV",
    "sample_partially_fragmented.mp4", "sample.flv",
)  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--media", type=int, default=1000, help="mutated media files")
    parser.add_argument("--json", type=int, default=10_000, help="fuzzed keypoint frames")
    parser.add_argument("--seed", default="0")
    parser.add_argument(
        "--shared", type=Path, default=ROOT.parent / "shared", help="folder with data/nasty_media"
    )
    parser.add_argument("--keep", type=Path, help="folder for the files that went wrong")
    options = parser.parse_args()
    print("command:", " ".join(["python", *sys.argv]))
    print("machine:", platform.machine(), platform.system(), "Python", platform.python_version())
    faults = 0
    if options.media:
        faults += soak_media(options)
    if options.json:
        faults += soak_json(options)
    print(f"\n{faults} faults")
    return 1 if faults else 0


def soak_media(options: argparse.Namespace) -> int:
    """Mutate and decode; the number of faults."""
    from decoding import Decoded, decode_all

    started = time.monotonic()
    counts: Counter[tuple[str, str]] = Counter()
    faults: list[tuple[str, Decoded]] = []
    slowest = 0.0
    with tempfile.TemporaryDirectory() as folder:
        clips = list(_clips(Path(folder), options.shared))
        print(f"\nmedia: {options.media} files from {len(clips)} clips, each with both readers")
        for first in range(0, options.media, _BATCH):
            numbers = range(first, min(first + _BATCH, options.media))
            frames = dict(_mutated(Path(folder), clips, options.seed, numbers))
            jobs = [(reader, path) for path in frames for reader in ("pyav", "opencv")]
            for done in decode_all(jobs, limit=_SECONDS):
                slowest = max(slowest, done.seconds)
                short = done.outcome == "complete" and done.frames < frames[done.path]
                outcome = "complete, yet short" if short else done.outcome
                counts[outcome if not outcome.startswith("E_") else "typed error", done.reader] += 1
                if done.outcome in _BAD or (short and done.reader == "pyav"):
                    faults.append((outcome, done))
                    _keep(options.keep, done.path)
            for path in frames:
                path.unlink()
    _table(counts, ("pyav", "opencv"))
    print(f"slowest file {slowest:.1f} s, all {time.monotonic() - started:.0f} s")
    for outcome, done in faults:
        print(f"FAULT {outcome}: {done.reader} {done.path.name} frames {done.frames} {done.detail[:300]}")
    return len(faults)


def _clips(folder: Path, shared: Path) -> Iterator[tuple[str, bytes, int]]:
    """(suffix, bytes, frames) of healthy clips: our own, and those of other makers where present."""
    from clips import make_clips

    from gesture_core.video import open_video

    for clip in make_clips(folder):
        yield f".{clip.container}", clip.data, clip.frames
    for name in _FOREIGN:
        path = shared / "data" / "nasty_media" / name
        if path.is_file():
            with open_video(path, "pyav") as video:
                frames = sum(1 for _ in video)
            yield path.suffix, path.read_bytes(), frames


def _mutated(
    folder: Path, clips: list[tuple[str, bytes, int]], seed: str, numbers: range
) -> Iterator[tuple[Path, int]]:
    from mutations import mutate

    for number in numbers:
        suffix, data, frames = clips[number % len(clips)]
        kind, broken = mutate(data, f"{seed}:{number}")
        path = folder / f"{number}_{kind}{suffix}"
        path.write_bytes(broken)
        yield path, frames


def _keep(folder: Path | None, path: Path) -> None:
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / path.name).write_bytes(path.read_bytes())


def soak_json(options: argparse.Namespace) -> int:
    """Fuzz frames in a process of its own; the number of faults."""
    print(f"\njson: {options.json} frames")
    command = [sys.executable, "-c", _JSON_SCRIPT, str(options.json), options.seed]
    done = subprocess.run(command, env=_environment(), check=False)
    return 0 if done.returncode == 0 else 1


_JSON_SCRIPT = "import sys, soak_media; sys.exit(soak_media.json_frames(int(sys.argv[1]), sys.argv[2]))"


def _environment() -> dict[str, str]:
    folders = [str(Path(__file__).resolve().parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}


def json_frames(count: int, seed: str) -> int:
    """Fuzz ``count`` frames in this process and print what came of them; 1 where anything went wrong."""
    from json_fuzz import corpus, fuzz
    from outcomes import check_frame

    frames, counts, faults = corpus(), Counter[tuple[str, str]](), 0
    started, slowest = time.monotonic(), 0.0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            data = fuzz(frames, f"{seed}:{number}")
            begun = time.process_time()
            try:
                outcome = check_frame(Path(folder), data)
            except Exception as error:  # noqa: BLE001 - whatever is not typed is what is looked for
                faults += 1
                outcome = "untyped"
                print(f"FAULT untyped: {seed}:{number} {type(error).__name__}: {error}")
            slowest = max(slowest, time.process_time() - begun)
            counts[outcome, "frames"] += 1
    peak = _peak_mib()
    _table(counts, ("frames",))
    spent = time.monotonic() - started
    print(f"peak memory {peak} MiB, slowest frame {slowest:.2f} s, all {spent:.0f} s")
    return int(faults > 0 or peak >= _JSON_MIB)


def _peak_mib() -> int:
    """Largest memory of this process; `getrusage` would count that of the process that started it."""
    status = Path("/proc/self/status")
    if status.is_file():
        return int(status.read_text().split("VmHWM:")[1].split()[0]) // 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def _table(counts: Counter[tuple[str, str]], columns: tuple[str, ...]) -> None:
    rows = sorted({row for row, _ in counts})
    width = max(len(row) for row in rows)
    print(f"| {'outcome':<{width}} | " + " | ".join(f"{column:>7}" for column in columns) + " |")
    print(f"|{'-' * (width + 2)}|" + "|".join("-" * 8 + ":" for _ in columns) + "|")
    for row in rows:
        print(f"| {row:<{width}} | " + " | ".join(f"{counts[row, column]:>7}" for column in columns) + " |")


if __name__ == "__main__":
    sys.exit(main())
