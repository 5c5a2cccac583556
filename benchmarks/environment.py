"""What a benchmark prints above its tables: the machine, the versions and the command."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("numpy", "numba", "jax", "torch", "scipy")


def one_thread() -> None:
    """Keep the libraries' own thread pools at one thread; call before jax or torch is imported."""
    for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[variable] = "1"
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


def header(more: Mapping[str, str] | None = None) -> None:
    """Print it."""
    from gesture_core.files import usable_cores

    cpu = platform.processor()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [row.split(":", 1)[1].strip() for row in info.read_text().splitlines() if "model name" in row]
        cpu = names[0] if names else cpu
    print(f"{' '.join(['python', *(Path(part).name for part in sys.argv)])}")
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    print(f"{cpu}, {usable_cores()} cores, load {load:.1f}, Python {platform.python_version()}")
    found = []
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    print(", ".join(found))
    if more:
        print("peers: " + ", ".join(f"{name} {number}" for name, number in more.items()))
    print(flush=True)
