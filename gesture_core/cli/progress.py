"""Progress of a run on standard error: a bar on a terminal, JSON lines otherwise."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from gesture_core.cli.screen import visible
from gesture_core.run.pipeline import Listener
from gesture_core.types import Row

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


class _Counter(Listener):
    """Counts what is done: inputs and examples, each once, and frames that were decoded now."""

    def __init__(self) -> None:
        self._extracted: set[str] = set()
        self._done = self._total = self._frames = 0
        self._started = time.monotonic()

    def planned(self, inputs: int, waiting: int, examples: int, kernel: str) -> None:
        self._total = waiting + examples if waiting else 0

    def frames(self, name: str, count: int) -> None:
        self._frames += count
        self._changed()

    def extracted(self, name: str, cached: bool) -> None:
        self._extracted.add(name)
        self._done += 1
        self._changed()

    def row(self, row: Row) -> None:
        if not row.person and row.input not in self._extracted:  # nobody can read it
            self._done += 1
            self._changed()

    def example_failed(self, row: Row) -> None:
        if row.input not in self._extracted:
            self._done += 1
            self._changed()

    @property
    def _rate(self) -> float:
        """Frames a second."""
        return self._frames / max(time.monotonic() - self._started, 1e-9)

    def _changed(self) -> None:
        """Something more is done."""


class _Bar(_Counter):
    """Files, frames a second and time left."""

    def __init__(self) -> None:
        super().__init__()
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        from gesture_core.cli.screen import console

        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(complete_style="green", finished_style="green"),
            MofNCompleteColumn(),
            TextColumn("{task.fields[speed]}"),
            TimeRemainingColumn(),
            console=console(stderr=True),
            transient=True,
        )
        self._task = self._bar.add_task("looking for inputs", total=None, speed="")

    def __enter__(self) -> _Bar:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def planned(self, inputs: int, waiting: int, examples: int, kernel: str) -> None:
        super().planned(inputs, waiting, examples, kernel)
        if self._total:
            self._bar.update(self._task, description="keypoints", total=self._total)

    def _changed(self) -> None:
        speed = f"{self._rate:.0f} frames/s" if self._frames else ""
        self._bar.update(self._task, completed=self._done, speed=speed)

    def example_failed(self, row: Row) -> None:
        super().example_failed(row)
        self._bar.console.print(f"example left out: {row.code} {visible(row.message)}", markup=False)


class _JsonLines(_Counter):
    """One line when the work is planned, for each failed example, and every two seconds."""

    def __init__(self) -> None:
        super().__init__()
        self._last = self._started

    def planned(self, inputs: int, waiting: int, examples: int, kernel: str) -> None:
        super().planned(inputs, waiting, examples, kernel)
        say_event("planned", inputs=inputs, waiting=waiting, examples=examples, kernel=kernel)

    def example_failed(self, row: Row) -> None:
        super().example_failed(row)
        say_event("example_failed", input=row.input, code=row.code, message=row.message)

    def _changed(self) -> None:
        now = time.monotonic()
        if now - self._last < _SECONDS_BETWEEN_LINES:
            return
        self._last = now
        left = (now - self._started) / self._done * (self._total - self._done) if self._done else None
        say_event(
            "progress",
            files=self._done,
            of=self._total,
            frames_per_second=round(self._rate, 1),
            seconds_left=None if left is None else round(left),
        )


def say_event(event: str, **facts: Any) -> None:
    """One JSON line on standard error."""
    print(json.dumps({"event": event, **facts}, ensure_ascii=False), file=sys.stderr, flush=True)
