"""``gesture bench``: which distance kernel is fastest on this machine, and whether all agree."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from gesture_core.cli.flags import Flags
from gesture_core.cli.screen import print_table

if TYPE_CHECKING:
    import numpy as np

    from gesture_core.dtw.spec import DtwSpec
    from gesture_core.types import Signals

RUNS = 3
PATIENCE = 2.0
"""Seconds that one run of a kernel may take; slower kernels are timed on fewer queries."""


def bench(*sources: str, flags: Flags | None = None, series: int = 100) -> int:
    """Time every installed distance kernel on this machine.

    Parameters
    ----------
    sources
        Videos or keypoint files to take the series from; without any, drawn series of 40 to 90
        frames and 36 channels.
    series
        How many of the series are compared with each other.
    """
    from gesture_core.dtw.distances import choose_kernel
    from gesture_core.plugin import registry

    settings = (flags or Flags()).settings()
    signals = _own(sources, settings)[:series] if sources else _drawn(series)
    chosen, _ = choose_kernel("auto", settings.dtw)
    rows = []
    for name in registry().names("kernel", usable=True):
        kernel = registry().make("kernel", name)
        if not getattr(kernel, "exact", True):
            rows.append((name, "", "an approximation, not timed", "", "", ""))
        elif kernel.supports(settings.dtw):
            mark = "auto" if name == chosen else ""
            rows.append((name, mark, *_measure(kernel, signals, settings.dtw)))
        else:
            rows.append((name, "", "does not compute these settings", "", "", ""))
    columns = ("kernel", "", "pairs", "wall ms", "CPU µs / pair", "largest deviation")
    frames = sum(len(item) for item in signals) / len(signals)
    print(f"{len(signals)} series, {frames:.0f} frames and {signals[0].values.shape[1]} channels on average")
    print_table(columns, rows, right=columns[2:])
    print(f"dtw.kernel = auto takes {chosen!r}")
    return 0


def _measure(kernel: Any, signals: list[Signals], spec: DtwSpec) -> tuple[str, str, str, str]:
    """Pairs, wall milliseconds and CPU microseconds of the median run, deviation from NumPy."""
    import numpy as np

    from gesture_core.dtw.distances import make_batches
    from gesture_core.dtw.pairs import subset
    from gesture_core.dtw.vectorised import NumpyKernel

    queries, examples = make_batches(signals, signals, spec)
    state = kernel.prepare(examples, spec)
    few = subset(queries, np.arange(min(2, len(queries))))
    kernel.distances(state, few)  # compiles
    start = time.perf_counter()
    found = kernel.distances(state, few)
    each = (time.perf_counter() - start) / len(few)
    asked = subset(queries, np.arange(max(len(few), min(len(queries), int(PATIENCE / each)))))
    kernel.distances(state, asked)
    walls, cpus = [], []
    for _ in range(RUNS):
        begun = time.perf_counter(), time.process_time()
        kernel.distances(state, asked)
        walls.append(time.perf_counter() - begun[0])
        cpus.append(time.process_time() - begun[1])
    pairs = len(asked) * len(examples)
    plain = NumpyKernel()
    deviation = _deviation(found, plain.distances(plain.prepare(examples, spec), few))
    cpu = float(np.median(cpus)) / pairs * 1e6
    return f"{pairs:,}", f"{np.median(walls) * 1e3:.1f}", f"{cpu:.2f}", f"{deviation:.1e}"


def _deviation(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest relative difference of finite distances."""
    import numpy as np

    finite = np.isfinite(wanted)
    if not finite.any():
        return 0.0
    scale = np.maximum(np.abs(wanted[finite]), 1e-6)
    return float((np.abs(found[finite].astype(float) - wanted[finite]) / scale).max())


def _drawn(count: int) -> list[Signals]:
    """Random walks of the shape that gestures have, a third of the channels salient."""
    import numpy as np

    from gesture_core.types import Signals

    rng = np.random.default_rng(0)
    names = tuple(f"channel_{d}" for d in range(36))
    lengths = rng.integers(40, 91, count)
    walks = [np.cumsum(rng.normal(size=(n, 36)), axis=0) / 4 for n in lengths]
    return [Signals(walk, np.arange(len(walk)) / 30, names, rng.random(36) < 0.2) for walk in walks]


def _own(sources: tuple[str, ...], settings: Any) -> list[Signals]:
    """The signals of the user's own data."""
    from gesture_core.archive.api import load_poses
    from gesture_core.signals.chain import Chain

    chain = Chain.from_settings(settings)
    return [chain(pose) for pose in load_poses(list(sources), settings)]
