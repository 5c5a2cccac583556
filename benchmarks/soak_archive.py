"""Many videos in one run: the parent's memory must not grow with them, nor JAX's programs.

Called by ``python benchmarks/soak.py archive``. The clips are tiny and the pose backend is a stub, so that
the run itself is what is looked at: discovery, workers, decoding, keypoint store, distances, journal.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1] / "tests"
_WIDTH = 64
_GROWTH_MIB = 32


def archive(folder: Path, count: int, seed: int) -> int:
    """Classify ``count`` videos; print the marks; 1 where memory grew or rows are missing."""
    sys.path[:0] = [str(TESTS), str(TESTS / "run")]
    from troubles import make_site, with_site, write_video

    site = make_site(folder / "site")
    for right in (True, False):
        write_video(folder / "examples" / ("right" if right else "left") / "1.avi", _WIDTH, 30, right)
    for number in range(count):
        path = folder / "videos" / f"{number // 1000:03d}" / f"{number:06d}.avi"
        write_video(path, _WIDTH, 8 + (number * 7 + seed) % 40, number % 2 == 0, number)
    started = time.monotonic()
    script = [sys.executable, str(TESTS / "run" / "many_videos.py"), folder / "videos"]
    run = subprocess.Popen(
        [*script, folder / "examples", folder / "run"],
        env={**with_site(site), "GESTURE_CACHE": str(folder / "cache")},
        stdout=subprocess.PIPE,
        text=True,
    )
    held: dict[int, int] = {}
    last = ""
    assert run.stdout is not None
    for line in run.stdout:
        last = line.strip()
        if "," not in last:
            rows, mib = map(int, last.split())
            held[rows] = mib
            print(f"{rows:>8} rows: parent {mib} MiB", flush=True)
    if run.wait() != 0:
        return 1
    first = min(rows for rows in held if rows >= count // 10)
    growth = held[max(held)] - held[first]
    print(f"{last}; {growth:+d} MiB from row {first} to row {max(held)}; {time.monotonic() - started:.0f} s")
    programs, buckets, rows = (int(part.split()[0]) for part in last.split(", ")[:3])
    return int(rows != count or growth > _GROWTH_MIB or programs > buckets)
