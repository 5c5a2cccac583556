"""Memory and growth of the fastest kernel: up to 10,000 queries × 1,000 examples in one call.

    python benchmarks/memory.py

Goal: under 1 GiB over the inputs, and time that grows with the pairs.
"""

from __future__ import annotations

import resource
import time

import numpy as np

from gesture_core.dtw.distances import warping_distances


def main() -> None:
    """Print a row for each size."""
    rng = np.random.default_rng(0)
    lengths = rng.integers(40, 91, 11_000)
    series = [np.cumsum(rng.normal(size=(n, 2)), axis=0).astype(np.float32) for n in lengths]
    warping_distances(series[:40], series[:40])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    inputs = sum(item.nbytes for item in series) / 2**20
    print(f"## 7. Memory and growth: 40 to 90 frames, 2 dimensions, inputs {inputs:.0f} MiB\n")
    print("| pairs | CPU s | CPU µs / pair | peak over the inputs, MiB |")
    print("|---|---|---|---|")
    for queries in (1_000, 2_500, 5_000, 10_000):
        start = time.process_time()
        warping_distances(series[:queries], series[10_000:])
        cpu = time.process_time() - start
        peak = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
        print(f"| {queries:,} × 1,000 | {cpu:.2f} | {cpu / queries * 1e3:.3f} | {peak:.0f} |", flush=True)


if __name__ == "__main__":
    main()
