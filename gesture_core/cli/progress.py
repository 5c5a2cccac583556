"""Progress of a run on standard error: a bar on a terminal, JSON lines otherwise."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from gesture_core.cli.output import named, say, say_event
from gesture_core.files import printable
from gesture_core.run.addresses import shown
from gesture_core.run.extract import Listener

if TYPE_CHECKING:
    from rich.progress import Task

    from gesture_core.records import Row

_SECONDS_BETWEEN_LINES = 2.0


@contextmanager
def progress(
    sources: Sequence[str], examples: Sequence[str] = (), *, quiet: bool = False
) -> Iterator[Listener]:
    """A listener that shows a run while the block lasts, and first what it works on.

    Parameters
    ----------
    sources, examples : sequence of str
        As they stand on the command line: what a shell made of a pattern may surprise.
    quiet : bool
        Show nothing.
    """
    if quiet:
        yield Listener()
    elif sys.stderr.isatty():
        for what, names in (("sources", sources), ("examples", examples)):
            if names:
                say(f"{what}: {named([*map(shown, names)], join=' ')}")
        with Bar() as bar:
            yield bar
    else:
        yield Events(sources, examples)


class Events(Listener):
    """One line when the work is planned, for each failed example, and every two seconds.

    What is done is counted: inputs and examples, each once, and frames that were decoded now. Where work is
    planned in several stages, it adds up.
    """

    def __init__(self, sources: Sequence[str] = (), examples: Sequence[str] = ()) -> None:
        self._named = {"sources": [*map(shown, sources)], "example_sources": [*map(shown, examples)]}
        self._stage = ""
        self._extracted: set[str] = set()
        self._network = ""
        self._done = self._total = self._frames = 0
        self._started = self._last = time.monotonic()

    def planned(self, inputs: int, waiting: int, examples: int, kernel: str) -> None:
        self._total += waiting + examples if waiting else 0
        self._plan(inputs=inputs, waiting=waiting, examples=examples, kernel=kernel)

    def stage(self, name: str) -> None:
        if name != self._stage:
            self._stage = name
            self._staged()

    def network(self, text: str) -> None:
        if not self._network:  # the first one says most
            self._network = text
            self._say_network()

    def _say_network(self) -> None:
        say_event("pose", network=self._network)

    def frames(self, name: str, count: int) -> None:
        self._frames += count
        self._changed()

    def extracted(self, name: str, cached: bool) -> None:
        self._extracted.add(name)
        self._done += 1
        self._changed()

    def row(self, row: Row) -> None:
        if not row.person and row.input not in self._extracted:  # it could not be read
            self._done += 1
            self._changed()

    def example_failed(self, row: Row) -> None:
        if row.input not in self._extracted:
            self._done += 1
            self._changed()
        self._failed(row)

    @property
    def _rate(self) -> float:
        """Frames a second."""
        return self._frames / max(time.monotonic() - self._started, 1e-9)

    def _plan(self, **counts: int | str) -> None:
        say_event("planned", **counts, **self._named)

    def _failed(self, row: Row) -> None:
        say_event("example_failed", input=row.input, code=row.code, message=row.message)

    def _staged(self) -> None:
        """Another stage has begun."""

    def _changed(self) -> None:
        """Something more is done."""
        now = time.monotonic()
        if now - self._last < _SECONDS_BETWEEN_LINES:
            return
        self._last = now
        left = (
            (now - self._started) / self._done * (self._total - self._done)
            if self._done and self._total
            else None
        )
        say_event(
            "progress",
            stage=self._stage or "keypoints",
            files=self._done,
            of=self._total,
            frames=self._frames,
            frames_per_second=round(self._rate, 1),
            seconds_left=None if left is None else round(left),
        )


class Bar(Events):
    """The stage, files, frames, frames a second and time left."""

    def __init__(self) -> None:
        super().__init__()
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        from gesture_core.cli.output import console

        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(complete_style="green", finished_style="green"),
            MofNCompleteColumn(),
            TextColumn("{task.fields[speed]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console(stderr=True),
            transient=True,
        )
        self._task = self._bar.add_task("looking for inputs", total=None, speed="")

    def __enter__(self) -> Bar:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    @property
    def shown(self) -> Task:
        """The bar as it stands."""
        return self._bar.tasks[0]

    def _say_network(self) -> None:
        self._bar.console.print(f"pose: {self._network}", markup=False, highlight=False)

    def _plan(self, **counts: int | str) -> None:
        if self._total:
            self._bar.update(self._task, description="keypoints", total=self._total)

    def _staged(self) -> None:
        self._bar.update(self._task, description=self._stage)

    def _failed(self, row: Row) -> None:
        self._bar.console.print(f"example left out: {row.code} {printable(row.message)}", markup=False)

    def _changed(self) -> None:
        speed = f"{self._frames:,} frames, {self._rate:.0f} a second" if self._frames else ""
        self._bar.update(self._task, completed=self._done, speed=speed)
