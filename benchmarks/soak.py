"""Long versions of the robustness tests: kills, bad plugins, many inputs. Nothing of it is timed.

    python benchmarks/soak.py kills --count 1000     kill -9 at random moments, resume, compare
    python benchmarks/soak.py archive --count 10000  parent memory from the 1,000th input to the last

`benchmarks/soak_media.py` does the same for mutated media and keypoint files.
"""

from __future__ import annotations

import argparse
import os
import platform
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from gesture_core.archive.journal import open_journal
from gesture_core.demo.archive import DemoArchive, write_archive


def command(source: Path, examples: Path, out: Path) -> list[str]:
    """The command that is killed and resumed."""
    base = [sys.executable, "-m", "gesture_core", "classify", str(source), "--examples", str(examples)]
    return [*base, "--out", str(out), "--preset", "paper", "--kernel", "numpy", "--quiet"]


def table(out: Path) -> list[object]:
    """The rows of a run."""
    with open_journal(out) as journal:
        return list(journal.rows())


def kills(folder: Path, count: int, seed: int) -> None:
    """Kill a run at random moments ``count`` times; every resumed run must end in the same table."""
    archive: DemoArchive = write_archive(folder / "drawn", queries=2, examples=1, seed=seed)
    rng = random.Random(seed)
    source, examples = archive.video_keypoints, archive.example_keypoints
    os.environ["GESTURE_CACHE"] = str(folder / "clean-cache")
    started = time.monotonic()
    subprocess.run(command(source, examples, folder / "clean"), check=True)
    length = time.monotonic() - started
    expected = table(folder / "clean")
    killed = runs = 0
    while killed < count:
        runs += 1
        out = folder / "run"
        os.environ["GESTURE_CACHE"] = str(folder / "cache")
        for _ in range(12):
            process = subprocess.Popen(command(source, examples, out), stderr=subprocess.DEVNULL)
            try:
                process.wait(timeout=rng.uniform(0.1, 1.1 * length))
                break
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
                process.wait()
                killed += 1
        subprocess.run(command(source, examples, out), check=True, stderr=subprocess.DEVNULL)
        if table(out) != expected:
            sys.exit(f"after {killed} kills: run {runs} ended in another table")
        shutil.rmtree(out)
        shutil.rmtree(folder / "cache")
    print(f"{killed} kills in {runs} runs: every table equal to that of an undisturbed run")


def archive(folder: Path, count: int, seed: int) -> None:
    """Classify ``count`` inputs; print the parent's resident memory along the way."""
    import psutil

    drawn = write_archive(folder / "drawn", queries=1, examples=1, seed=seed)
    clips = sorted(drawn.video_keypoints.iterdir())
    many = folder / "many"
    for number in range(count):
        clip = clips[number % len(clips)]
        target = many / f"{number // 1000:03d}" / f"clip_{number:06d}"
        target.mkdir(parents=True)
        skip = number // len(clips) % 30
        for index, frame in enumerate(sorted(clip.iterdir())):
            if index != skip:
                os.link(frame, target / frame.name)
    process = subprocess.Popen(command(many, drawn.example_keypoints, folder / "run"))
    parent, marks = psutil.Process(process.pid), []
    while process.poll() is None:
        time.sleep(2)
        if (folder / "run" / "run.db").is_file():
            try:
                with open_journal(folder / "run") as journal:
                    done = sum(journal.counts().values())
                marks.append((done, parent.memory_info().rss >> 20))
            except psutil.Error:
                break
    steps = [min((m for m in marks if m[0] >= count * i // 10), default=None) for i in range(1, 11)]
    for done, resident in dict.fromkeys(m for m in steps if m):
        print(f"{done:8d} rows: parent {resident} MiB")
    rows = len(table(folder / "run"))
    print(f"{rows} rows for {count} inputs, exit code {process.returncode}")


def main() -> None:
    """Run one of the two."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("kills", "archive"))
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    print(f"{platform.platform()}, {os.cpu_count()} cores: {' '.join(sys.argv)}")
    with tempfile.TemporaryDirectory() as folder:
        {"kills": kills, "archive": archive}[chosen.what](Path(folder), chosen.count, chosen.seed)


if __name__ == "__main__":
    main()
