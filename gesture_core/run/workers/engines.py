"""The engine ``inline``, which calls the table of functions in this process, and one worker to be asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from gesture_core.plugin.registry import show_tracebacks
from gesture_core.records import Job, Outcome, Task
from gesture_core.run.workers.worker import Worker
from gesture_core.settings import LimitSettings

if TYPE_CHECKING:
    from gesture_core.run.workers.processes import ProcessEngine

OnFrames = Callable[[Task, int], None]


@dataclass
class InlineEngine:
    """Performs tasks one after the other in this process, without limits: a crash ends the run.

    It is for debugging: until it is closed, an exception of a plugin is printed with its lines.
    """

    workers: int
    limits: LimitSettings
    _worker: Worker | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        show_tracebacks(True)

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: OnFrames, *, retry: bool = True
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, in order."""
        if self._worker is None or self._worker.job != job:
            self._worker = Worker(job, lambda message: None)
        for task in tasks:

            def report(message: dict[str, Any], task: Task = task) -> None:
                if "frames" in message:
                    on_frames(task, message["frames"])

            self._worker.report = report
            yield self._worker.perform(task)

    def close(self) -> None:
        """Forget what the tasks have left behind."""
        self._worker = None
        show_tracebacks(False)


class Assistant:
    """One worker that is asked one thing after the other, and told again what it knew if its process dies.

    Parameters
    ----------
    job : Job
    limits : LimitSettings
    inline : bool
        In this process.
    """

    def __init__(self, job: Job, limits: LimitSettings, *, inline: bool = False) -> None:
        self._job = job
        self._engine: InlineEngine | ProcessEngine
        if inline:
            self._engine = InlineEngine(1, limits)
        else:
            from gesture_core.run.workers.processes import ProcessEngine

            self._engine = ProcessEngine(1, limits)

    def ask(
        self,
        function: str,
        arguments: Mapping[str, Any] | None = None,
        *,
        keep: bool = False,
        retry: bool = True,
    ) -> Any:
        """The value of a function of the table.

        With ``keep``, what it has left in the worker is done again in each further process.

        Raises
        ------
        WorkerError
            Where it ended its process, twice unless ``retry`` is off.
        GestureError
            What the function raised.
        """
        task = Task(0, function, arguments or {})
        (outcome,) = self._engine.run(self._job, [task], lambda task, frames: None, retry=retry)
        if outcome.error:
            raise outcome.error
        if keep and not isinstance(self._engine, InlineEngine):
            self._engine.first.append(task)
        return outcome.value

    def __enter__(self) -> Assistant:
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()
