"""Long versions of the robustness tests. Nothing of it is timed; the last line says what it proves.

    python benchmarks/soak.py kills --count 1000       kill -9, resume, compare the exports
    python benchmarks/soak.py archive --count 10000    videos: the parent's memory, JAX's compilations
    python benchmarks/soak.py libraries --count 10000  example libraries and pose networks, mutated
    python benchmarks/soak.py plugins --count 100      twenty kinds of bad plugin, each with 100 inputs

`benchmarks/soak_media.py` does the same for mutated media and keypoint JSON. Ends with 1 where a fault was
found. Everything happens below ``TMPDIR``.
"""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import sys
import tempfile
from pathlib import Path

WHAT = ("kills", "archive", "libraries", "plugins")


def main() -> int:
    """Run one of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=WHAT)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    print("command: python", *sys.argv)
    print(f"machine: {platform.platform()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    soak = getattr(importlib.import_module(f"soak_{chosen.what}"), chosen.what)
    with tempfile.TemporaryDirectory() as folder:
        return 1 if soak(Path(folder), chosen.count, chosen.seed) else 0


if __name__ == "__main__":
    sys.exit(main())
