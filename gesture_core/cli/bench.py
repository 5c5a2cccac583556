"""``gesture bench``: which distance kernel is fastest on this machine, and whether all agree."""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter, validators

from gesture_core.cli.flags import KernelFlags, Whole
from gesture_core.cli.output import check_file, print_table, warnings_as_lines
from gesture_core.errors import InputError

if TYPE_CHECKING:
    from gesture_core.dtw.spec import DtwSpec
    from gesture_core.plugin.interfaces import DistanceKernel
    from gesture_core.settings import Settings
    from gesture_core.types import Signals

_RUNS = 3
_SECONDS_OF_A_RUN = 2.0
"""What one run of a kernel may take; slower kernels are timed on fewer queries."""


def bench(
    *sources: str,
    flags: KernelFlags | None = None,
    series: Annotated[Whole, Parameter(validator=validators.Number(gte=1))] = 100,
    out: Annotated[Path | None, Parameter(help="Also write the table to this file, as JSON.")] = None,
) -> int:
    """Time every installed distance kernel on this machine, or the one that --kernel names.

    Drawn series have 40 to 90 frames and 36 channels.

    Parameters
    ----------
    sources
        Videos or keypoint files to take the series from; drawn ones by default.
    series
        How many of the series are compared with each other.
    """
    from gesture_core.dtw.distances import choose_kernel
    from gesture_core.plugin import registry
    from gesture_core.plugin.abilities import ApproximateKernel

    if out is not None:
        check_file(out)
    settings = (flags or KernelFlags()).settings()
    signals = (_own(sources, settings) if sources else _drawn(series))[:series]
    if not signals:
        raise InputError(
            "no series to compare", remedy="folders that hold videos or keypoints", code="E_EMPTY"
        )
    spec, options = settings.dtw, settings.options
    auto, _ = choose_kernel("auto", spec, options)
    asked = settings.classify.kernel
    names = registry().names("kernel", usable=True) if asked == "auto" else [asked]
    rows: list[tuple[str, ...]] = []
    timings: list[dict[str, Any]] = []
    for name in names:
        kernel = registry().make("kernel", name, options.get(name))
        mark = "auto" if name == auto else ""
        why = "" if kernel.supports(spec) else "does not compute these settings"
        if not why and isinstance(kernel, ApproximateKernel):
            why = "an approximation, not timed"
        if why:
            rows.append((name, mark, why, "", "", ""))
            timings.append({"kernel": name, "not_timed": why})
        else:
            pairs, wall, each, deviation = _measure(kernel, signals, spec)
            record = {"kernel": name, "pairs": pairs, "wall_seconds": wall, "cpu_seconds_per_pair": each}
            timings.append({**record, "deviation": deviation})
            cells = f"{pairs:,}", f"{wall * 1e3:.1f}", f"{each * 1e6:.2f}", f"{deviation:.1e}"
            rows.append((name, mark, *cells))
    frames = sum(len(item) for item in signals) / len(signals)
    width = signals[0].values.shape[1]
    table = {
        "machine": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "series": len(signals),
        "frames": frames,
        "channels": width,
        "dtw": {key: str(value) for key, value in asdict(spec).items()},
        "auto": auto,
        "kernels": timings,
    }
    if out is not None:  # before anything is printed: a closed pipe must not cost it
        out.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")
    if not sys.stdout.isatty():
        print(json.dumps(table))
        return 0
    print(f"{len(signals)} series, {frames:.0f} frames on average, {width} channels")
    columns = ("kernel", "", "pairs", "wall ms", "CPU µs / pair", "largest deviation")
    print_table(columns, rows, right=columns[2:])
    print(f"classify.kernel = auto takes {auto!r}")
    return 0


def _measure(
    kernel: DistanceKernel, signals: list[Signals], spec: DtwSpec
) -> tuple[int, float, float, float]:
    """Pairs, seconds of the median run, CPU seconds of a pair, largest relative difference from NumPy.

    Distances that are not finite do not count for the difference.
    """
    import numpy as np

    from gesture_core.dtw.batches import make_batches, subset
    from gesture_core.plugin import registry

    queries, examples = make_batches(signals, signals, spec)
    state = kernel.prepare(examples, spec)
    few = subset(queries, np.arange(min(2, len(queries))))
    kernel.distances(state, few)  # compiles
    start = time.perf_counter()
    found = kernel.distances(state, few)
    each = (time.perf_counter() - start) / len(few)
    fitting = min(len(queries), int(_SECONDS_OF_A_RUN / max(each, 1e-9)))
    asked = subset(queries, np.arange(max(len(few), fitting)))
    kernel.distances(state, asked)
    walls, cpus = [], []
    for _ in range(_RUNS):
        begun = time.perf_counter(), time.process_time()
        kernel.distances(state, asked)
        walls.append(time.perf_counter() - begun[0])
        cpus.append(time.process_time() - begun[1])
    plain: DistanceKernel = registry().make("kernel", "numpy")
    wanted = plain.distances(plain.prepare(examples, spec), few)
    finite = np.isfinite(wanted)
    scale = np.maximum(np.abs(wanted[finite]), 1e-6)
    deviation = (np.abs(found[finite].astype(float) - wanted[finite]) / scale).max(initial=0.0)
    pairs = len(asked) * len(examples)
    return pairs, float(np.median(walls)), float(np.median(cpus)) / pairs, float(deviation)


def _drawn(count: int) -> list[Signals]:
    """Random walks of the shape that gestures have, a fifth of the channels salient."""
    import numpy as np

    from gesture_core.types import Signals

    rng = np.random.default_rng(0)
    names = tuple(f"channel_{d}" for d in range(36))
    lengths = rng.integers(40, 91, count)
    walks = [np.cumsum(rng.normal(size=(n, 36)), axis=0) / 4 for n in lengths]
    return [Signals(walk, np.arange(len(walk)) / 30, names, rng.random(36) < 0.2) for walk in walks]


def _own(sources: tuple[str, ...], settings: Settings) -> list[Signals]:
    """The signals of the user's own data."""
    from gesture_core.cli.progress import progress
    from gesture_core.run.archive import load_poses
    from gesture_core.signals.chain import Chain

    chain = Chain.from_settings(settings)
    with progress(sources), warnings_as_lines():
        poses = load_poses(list(sources), settings)
    return [chain(pose) for pose in poses]
