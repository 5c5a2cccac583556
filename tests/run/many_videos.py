"""A run over many small videos with JAX's kernel: the parent's memory on the way, and what was compiled.

``python many_videos.py SOURCE EXAMPLES OUT`` prints ``<rows> <MiB>`` twenty times and, at the end,
``<programs> programs, <buckets> buckets, <rows> rows, <ok> ok``. `trouble_plugin` must be installed.
"""

from __future__ import annotations

import sys
from pathlib import Path

import psutil

from gesture_core.run.extract import Listener
from gesture_core.run.pipeline import run_archive
from gesture_core.run.plan import RunRequest
from gesture_core.settings import load_settings
from gesture_core.types import Row

_MARKS = 20


class Watch(Listener):
    """Says what this process holds, each time a twentieth of the rows is there."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._total = self._rows = 0
        self.lengths: set[int] = set()

    def planned(self, inputs: int, waiting: int, examples: int, kernel: str) -> None:
        self._total = inputs

    def row(self, row: Row) -> None:
        self._rows += 1
        self.lengths.add(row.frames_read)
        if self._rows % max(1, self._total // _MARKS) == 0:
            print(self._rows, self._process.memory_info().rss >> 20, flush=True)


def buckets(lengths: set[int]) -> int:
    """Powers of two that series of these lengths, with one frame of padding, are padded to."""
    return len({1 << length.bit_length() for length in lengths})


def main(source: str, examples: str, out: str) -> None:
    settings = load_settings(
        "paper", environment={}, classify__kernel="jax", pose__backend="trouble-pose", pose__reader="opencv"
    )
    watch = Watch()
    # In this process, so that what decides, and what it compiles, can be looked at.
    request = RunRequest((source,), Path(out), settings, (examples,), engine="inline")
    summary = run_archive(request, watch)
    from gesture_dtw_jax.hard import hard_tile

    rows = sum(summary.counts.values())
    programs = hard_tile._cache_size()  # type: ignore[attr-defined]  # nothing public counts them
    ok = summary.counts.get("ok", 0)
    print(f"{programs} programs, {buckets(watch.lengths)} buckets, {rows} rows, {ok} ok")


if __name__ == "__main__":
    main(*sys.argv[1:])
