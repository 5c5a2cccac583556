"""Runs killed at every point that changes the disk and at random moments, each resumed and compared.

Called by ``python benchmarks/soak.py kills``.
"""

from __future__ import annotations

import random
import sys
import time
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1] / "tests"
_INPUTS = 6
_SHARE_WITH_WORKERS = 40
_RUNS_BETWEEN_LINES = 20


def kills(folder: Path, count: int, seed: int) -> int:
    """Kill ``count`` times; print how; an AssertionError names the first run that ended otherwise."""
    sys.path[:0] = [str(TESTS), str(TESTS / "run")]
    from kill_points import Victim
    from troubles import write_archive

    write_archive(folder / "drawn", _INPUTS, [])
    source, examples = str(folder / "drawn" / "videos"), str(folder / "drawn" / "examples")
    started, rng = time.monotonic(), random.Random(seed)
    (folder / "inline").mkdir()
    (folder / "workers").mkdir()
    victim = Victim(source, examples, folder / "inline")
    points = runs = alone = 0
    while points < count and victim.at_point(points + 1):
        points += 1
    print(f"{points} kills, one before each write, flush, rename and commit of {_INPUTS} inputs", flush=True)
    wanted = (count - points) // _SHARE_WITH_WORKERS
    with_workers = Victim(source, examples, folder / "workers", engine="processes")
    gone = 0
    while gone < wanted:
        gone += with_workers.at_random(rng)
        runs += 1
    print(f"{gone} kills at random moments of runs with worker processes", flush=True)
    while points + gone + alone < count:
        alone += victim.at_random(rng)
        runs += 1
        if runs % _RUNS_BETWEEN_LINES == 0:
            print(f"{points + gone + alone} kills so far, no difference", flush=True)
    print(f"{alone} kills at random moments of runs in one process")
    spent = time.monotonic() - started
    print(
        f"{points + gone + alone} kills in {points + runs} runs, each resumed: every sorted export "
        f"byte-identical to that of an undisturbed run; {spent:.0f} s"
    )
    return 0
