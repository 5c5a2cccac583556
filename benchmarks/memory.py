"""Memory and growth of the fastest kernel: up to 10,000 queries × 1,000 examples in one call.

    python benchmarks/memory.py

Goal: under 1 GiB over the inputs, and time that grows with the pairs.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from gesture_core.dtw.distances import warping_distances


def main() -> None:
    """Print a row for each size."""
    rng = np.random.default_rng(0)
    lengths = rng.integers(40, 91, 11_000)
    series = [np.cumsum(rng.normal(size=(n, 2)), axis=0).astype(np.float32) for n in lengths]
    warping_distances(series[:40], series[:40])
    inputs = sum(item.nbytes for item in series) / 2**20
    print(f"### 7. Memory and growth: 40 to 90 frames, 2 dimensions, inputs {inputs:.0f} MiB\n")
    print("| pairs | CPU s | CPU µs / pair | peak over the inputs, MiB |")
    print("|---|---|---|---|")
    for queries in (1_000, 2_500, 5_000, 10_000):
        before = _forget_peak()
        start = time.process_time()
        warping_distances(series[:queries], series[10_000:])
        cpu = time.process_time() - start
        peak = (_memory("VmHWM") - before) / 1024
        print(f"| {queries:,} × 1,000 | {cpu:.2f} | {cpu / queries * 1e3:.3f} | {peak:.0f} |", flush=True)


def _forget_peak() -> int:
    """Start a new high-water mark; the resident KiB now. Linux."""
    Path("/proc/self/clear_refs").write_text("5")
    return _memory("VmRSS")


def _memory(field: str) -> int:
    """KiB, as the kernel counts this process's memory."""
    rows = Path("/proc/self/status").read_text().splitlines()
    return int(next(row for row in rows if row.startswith(field)).split()[1])


if __name__ == "__main__":
    main()
