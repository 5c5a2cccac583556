"""Twenty kinds of bad plugin: what one does to its inputs must show in no other row.

Called by ``python benchmarks/soak.py plugins``. All runs have the same plugins in every stage and differ in
the inputs at which one of them fails; a run without such inputs says what all other rows must be.
"""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1] / "tests"
_POISONED = 4
_VIDEOS = 16
BAD = (
    "normalizer os-exit", "normalizer hang", "normalizer shape", "filter segfault", "filter hungry",
    "filter nan", "filter interrupt", "selector kill", "selector close", "selector none",
    "kernel os-exit", "kernel hang", "kernel unprintable", "kernel nan", "pose segfault", "pose hang",
    "pose print", "accepts abort", "members os-exit", "read hungry",
)  # fmt: skip
LIMITS = ("--set", "limits.seconds=15", "--set", "limits.memory=700")


def plugins(folder: Path, count: int, seed: int) -> int:
    """Classify ``count`` inputs for each of `BAD`; print a line for each; the number of faults."""
    sys.path[:0] = [str(TESTS), str(TESTS / "run")]
    from troubles import CHAIN, classify, make_site, write_archive, write_video

    os.environ["GESTURE_CACHE"] = str(folder / "cache")
    started, site, faults = time.monotonic(), make_site(folder / "site"), 0
    archive = folder / "archive"
    healthy = count - _POISONED
    write_archive(archive, healthy - _VIDEOS, ())
    for number in range(_VIDEOS):
        write_video(
            archive / "videos" / f"film_{number}.avi", 64, 20 + number, number % 2 == 0, seed + number
        )
    options = (*CHAIN, "--pose", "trouble-pose", "--workers", "1", *LIMITS)
    _, clean = classify(archive, folder / "clean", site, *options)
    print(f"{healthy} healthy inputs: {Counter(row['status'] for row in clean.values())}", flush=True)
    for number, bad in enumerate(BAD):
        added = _poison(archive / "videos", *bad.split())
        exit_code, rows = classify(archive, folder / f"run-{number}", site, *options)
        for path in added:
            path.unlink()
        codes = Counter(rows[path.name]["code"] or rows[path.name]["status"] for path in added)
        same = sum(rows.get(name) == row for name, row in clean.items())
        fault = same != healthy or len(rows) != count
        faults += fault
        said = ", ".join(f"{n} {code}" for code, n in codes.items())
        same_text = f"{same} of {healthy} other rows identical"
        print(f"{'FAULT ' * fault}{bad:<20} exit {exit_code}: {same_text}; {said}", flush=True)
    print(f"{len(BAD)} kinds x {count} inputs, {faults} faults; {time.monotonic() - started:.0f} s")
    return faults


def _poison(folder: Path, kind: str, trouble: str) -> list[Path]:
    """Write the inputs at which a plugin of ``kind`` fails."""
    from trouble_plugin import length
    from troubles import write_clip, write_video

    added = []
    for number in range(_POISONED):
        if kind == "pose":
            added.append(folder / f"poison_{number}.avi")
            write_video(added[-1], 2 * length(kind, trouble), 30, seed=number)
        elif kind in ("accepts", "members", "read"):
            added.append(folder / f"{number}.poison")
            added[-1].write_text(f"{kind} {trouble}")
        else:
            added.append(folder / f"poison_{number}.npz")
            write_clip(added[-1], length(kind, trouble), 4, number)
    return added
