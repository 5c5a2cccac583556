"""No worker processes: everything in this one, for debuggers and profilers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from gesture_core.run.extractor import Extractor
from gesture_core.run.work import Job, Outcome, Task
from gesture_core.settings import LimitSettings


@dataclass(frozen=True)
class InlineEngine:
    """Runs tasks one after the other in this process, without limits: a crash ends the run."""

    workers: int
    limits: LimitSettings

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: Callable[[Task, int], None]
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, in order."""
        extract = Extractor(job)
        for task in tasks:
            yield extract(task, lambda frames, task=task: on_frames(task, frames))  # type: ignore[misc]
