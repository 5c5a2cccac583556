"""Makes an installed third-party distribution out of a few lines of source, in a folder for PYTHONPATH."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path


def make_distribution(folder: Path, name: str, source: str, version: str = "1.0") -> Path:
    """A distribution ``name`` whose one module holds ``source`` and is a ``gesture_core`` plugin."""
    module = name.replace("-", "_")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{module}.py").write_text(textwrap.dedent(source), encoding="utf-8")
    info = folder / f"{module}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(f"[gesture_core]\n{name} = {module}\n")
    return folder


_KERNEL = """
import os
import sys
import numpy as np
from gesture_core import hookimpl

class Bad:
    def supports(self, spec): return True
    def prepare(self, examples, spec): return len(examples)
    def distances(self, state, queries):
        {body}

@hookimpl
def register_distance_kernels(register):
    register("bad", "bad_kernel:Bad")
"""


def make_kernel(folder: Path, body: str) -> Path:
    """The distribution bad-kernel, whose kernel ``bad`` answers ``queries`` with ``body``."""
    return make_distribution(folder, "bad-kernel", _KERNEL.format(body=body))


def gesture(
    *arguments: str | os.PathLike[str], path: Path | None = None, cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own, with ``path`` on PYTHONPATH."""
    full = os.environ | environment | ({"PYTHONPATH": str(path)} if path else {})
    return subprocess.run(
        [sys.executable, "-m", "gesture_core", *(os.fspath(argument) for argument in arguments)],
        capture_output=True,
        text=True,
        errors="surrogateescape",
        env=full,
        cwd=cwd,
        timeout=240,
    )
