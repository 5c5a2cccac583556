"""How many cores there are to compute on."""

from __future__ import annotations

import os


def usable_cores() -> int:
    """Cores that this process may use, where the system says; else all of the machine's."""
    if hasattr(os, "sched_getaffinity"):  # Linux; neither macOS nor Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
