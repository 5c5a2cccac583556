"""Exact search on real sequences: identical neighbours, and the share of pairs that are warped.

    python benchmarks/search.py [SHARED]

Windows of 128 samples, z-normalised, of the UCR series and of the pose trajectories beside the
repository; 2,000 queries against 2,000 examples, a band of 10 %. Goal: at most 20 % of the pairs.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from published import read_ucr

from gesture_core.dtw import DtwSpec, ExampleIndex, warping_distances

HERE = Path(__file__).resolve().parent
LENGTH, COUNT = 128, 4_000


class CountingIndex(ExampleIndex):
    """Counts the pairs that are handed to the kernel."""

    warped = 0

    def _within(self, queries, examples, qi, ei, limits):  # type: ignore[no-untyped-def]
        self.warped += len(qi)
        return super()._within(queries, examples, qi, ei, limits)


def windows(shared: Path) -> dict[str, np.ndarray]:
    """(COUNT, LENGTH) float32 of each source, drawn with a fixed seed."""
    sources: dict[str, list[np.ndarray]] = {"UCR series": [], "wrists of 15 gestures": []}
    for name in ("CBF", "GunPoint", "Trace", "ShakeGestureWiimoteZ"):
        for part in ("TRAIN", "TEST"):
            sources["UCR series"] += list(read_ucr(shared / "data" / "ucr" / name, name, part)[0])
    with np.load(shared / "data" / "body_gesture" / "landmarks_mediapipe33.npz", allow_pickle=False) as poses:
        for key in sorted(poses.files):
            track = poses[key][:, (15, 16), :2].reshape(len(poses[key]), -1)
            sources["wrists of 15 gestures"] += list(track[np.isfinite(track).all(axis=1)].T)
    rng = np.random.default_rng(0)
    return {name: _draw(series, rng) for name, series in sources.items()}


def _draw(series: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    long = [item for item in series if len(item) >= 32]
    out = []
    while len(out) < COUNT:
        item = long[rng.integers(len(long))]
        size = min(len(item), LENGTH)
        start = rng.integers(len(item) - size + 1)
        cut = np.interp(np.linspace(0, size - 1, LENGTH), np.arange(size), item[start : start + size])
        if cut.std() > 1e-6:
            out.append((cut - cut.mean()) / cut.std())
    return np.array(out, np.float32)


def main() -> None:
    """Print a row for each source."""
    shared = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parent / ".." / "shared"
    print("### 6. Exact search, 2,000 × 2,000 windows of 128 frames, band 10 %\n")
    if not (shared / "data").is_dir():
        print(f"skipped: no data at {shared}")
        return
    spec = DtwSpec(cost="squared", window=0.1)
    print("| source | k | identical | pairs warped | search CPU s | brute force CPU s |")
    print("|---|---|---|---|---|---|")
    for name, cuts in windows(shared).items():
        queries, examples = list(cuts[: COUNT // 2]), list(cuts[COUNT // 2 :])
        warping_distances(queries[:2], examples[:2], spec)
        start = time.process_time()
        table = warping_distances(queries, examples, spec)
        brute = time.process_time() - start
        for k in (1, 5):
            start = time.process_time()
            index = CountingIndex(examples, spec)
            found = index.nearest(queries, k)
            cpu = time.process_time() - start
            order = np.argsort(table, axis=1, kind="stable")[:, :k]
            same = (found.indices == order).all() and (
                found.distances == np.take_along_axis(table, order, axis=1)
            ).all()
            share = index.warped / table.size
            print(
                f"| {name} | {k} | {'yes' if same else 'NO'} | {share:.1%} | {cpu:.2f} | {brute:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
