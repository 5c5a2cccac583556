"""``gesture bench``: which distance kernel is fastest on this machine, and whether all agree."""

from __future__ import annotations

import json
import os
import platform
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter, validators

from gesture_core.cli.flags import KernelFlags, Whole
from gesture_core.cli.screen import print_table
from gesture_core.cli.targets import check_file
from gesture_core.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from gesture_core.dtw.spec import DtwSpec
    from gesture_core.types import Signals

RUNS = 3
PATIENCE = 2.0
"""Seconds that one run of a kernel may take; slower kernels are timed on fewer queries."""


@dataclass(frozen=True)
class Timing:
    """What a kernel took: the median run, and its largest relative difference from NumPy's distances."""

    kernel: str
    pairs: int
    wall_seconds: float
    cpu_seconds_per_pair: float
    deviation: float

    def cells(self) -> tuple[str, str, str, str]:
        """As the table shows it."""
        wall, each = self.wall_seconds * 1e3, self.cpu_seconds_per_pair * 1e6
        return f"{self.pairs:,}", f"{wall:.1f}", f"{each:.2f}", f"{self.deviation:.1e}"


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
    rows, timings = [], []
    for name in names:
        kernel = registry().make("kernel", name, options.get(name))
        mark = "auto" if name == auto else ""
        if not kernel.supports(spec):
            rows.append((name, mark, "does not compute these settings", "", "", ""))
        elif not getattr(kernel, "exact", True):
            rows.append((name, mark, "an approximation, not timed", "", "", ""))
        else:
            timings.append(_measure(name, kernel, signals, spec))
            rows.append((name, mark, *timings[-1].cells()))
    columns = ("kernel", "", "pairs", "wall ms", "CPU µs / pair", "largest deviation")
    frames = sum(len(item) for item in signals) / len(signals)
    width = signals[0].values.shape[1]
    print(f"{len(signals)} series, {frames:.0f} frames on average, {width} channels")
    print_table(columns, rows, right=columns[2:])
    print(f"classify.kernel = auto takes {auto!r}")
    if out is not None:
        record = {
            "machine": platform.processor() or platform.machine(),
            "cores": os.cpu_count(),
            "series": len(signals),
            "frames": frames,
            "channels": width,
            "dtw": {key: str(value) for key, value in asdict(spec).items()},
            "auto": auto,
            "kernels": [asdict(timing) for timing in timings],
        }
        out.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    return 0


def _measure(name: str, kernel: Any, signals: list[Signals], spec: DtwSpec) -> Timing:
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
    asked = subset(queries, np.arange(max(len(few), min(len(queries), int(PATIENCE / max(each, 1e-9))))))
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
    return Timing(name, pairs, float(np.median(walls)), float(np.median(cpus)) / pairs, deviation)


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
    from gesture_core.run.archive import load_poses
    from gesture_core.signals.chain import Chain

    chain = Chain.from_settings(settings)
    return [chain(pose) for pose in load_poses(list(sources), settings)]
