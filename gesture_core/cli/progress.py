"""Progress of a run on standard error: a bar on a terminal, JSON lines otherwise."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from gesture_core.archive.rows import Row
from gesture_core.archive.run import Listener
from gesture_core.cli.screen import visible

_SECONDS_BETWEEN_LINES = 2.0


@contextmanager
def progress(*, quiet: bool = False) -> Iterator[Listener]:
    """A listener that shows a run while the block lasts."""
    if quiet:
        yield Listener()
    elif sys.stderr.isatty():
        with _Bar() as bar:
            yield bar
    else:
        yield _JsonLines()


class _Bar(Listener):
    """Files, frames a second and time left."""

    def __init__(self) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        from gesture_core.cli.screen import console

        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[speed]}"),
            TimeRemainingColumn(),
            console=console(stderr=True),
            transient=True,
        )
        self._task = self._bar.add_task("keypoints", total=None, speed="")
        self._frames = 0
        self._started = time.monotonic()

    def __enter__(self) -> _Bar:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def planned(self, inputs: int, waiting: int, examples: int, kernel: str) -> None:
        self._bar.update(self._task, total=waiting + examples if waiting else 0)

    def frames(self, name: str, count: int) -> None:
        self._frames += count
        speed = self._frames / (time.monotonic() - self._started)
        self._bar.update(self._task, speed=f"{speed:.0f} frames/s")

    def extracted(self, name: str, cached: bool) -> None:
        self._bar.advance(self._task)

    def row(self, row: Row) -> None:
        if not row.sha256 and row.status in ("skipped", "error"):  # never extracted
            self._bar.advance(self._task)

    def example_failed(self, row: Row) -> None:
        self._bar.console.print(f"example left out: {row.code} {visible(row.message)}", markup=False)


class _JsonLines(Listener):
    """One line when the work is planned, for each failed example, and every two seconds."""

    def __init__(self) -> None:
        self._done = self._frames = self._total = 0
        self._last = self._started = time.monotonic()

    def planned(self, inputs: int, waiting: int, examples: int, kernel: str) -> None:
        self._total = waiting + examples if waiting else 0
        say_event("planned", inputs=inputs, waiting=waiting, examples=examples, kernel=kernel)

    def frames(self, name: str, count: int) -> None:
        self._frames += count
        self._tick()

    def extracted(self, name: str, cached: bool) -> None:
        self._done += 1
        self._tick()

    def example_failed(self, row: Row) -> None:
        say_event("example_failed", input=row.input, code=row.code, message=row.message)

    def _tick(self) -> None:
        now = time.monotonic()
        if now - self._last < _SECONDS_BETWEEN_LINES:
            return
        self._last = now
        elapsed = now - self._started
        say_event(
            "progress",
            files=self._done,
            of=self._total,
            frames_per_second=round(self._frames / elapsed, 1),
            seconds_left=round(elapsed / self._done * (self._total - self._done)) if self._done else None,
        )


def say_event(event: str, **facts: Any) -> None:
    """One JSON line on standard error."""
    print(json.dumps({"event": event, **facts}, ensure_ascii=False), file=sys.stderr, flush=True)
