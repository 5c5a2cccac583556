"""The engines of the package: worker processes, or this process; both call the same table of functions."""

from __future__ import annotations

import queue
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from gesture_core.run.workers.process import Inbox, Message, WorkerProcess, messages
from gesture_core.run.workers.worker import Worker, from_tree
from gesture_core.settings import LimitSettings
from gesture_core.types import Job, Outcome, Task

OnFrames = Callable[[Task, int], None]
_ENDINGS = frozenset({"E_WORKER_CRASH", "E_WORKER_HANG", "E_WORKER_MEMORY"})
"""Codes of what another process may not meet: memory can also end without ending the process."""


@dataclass
class ProcessEngine:
    """Performs tasks in worker processes, which live on for the next `run` of the same job until `close`.

    Attributes
    ----------
    workers : int
        Processes at a time.
    limits : LimitSettings
        ``seconds`` without a sign of progress and ``memory`` of a process, beyond which it is ended.
    """

    workers: int
    limits: LimitSettings
    first: list[Task] = field(default_factory=list, init=False)
    """What every process performs before anything else, so that a new one knows what the last one knew."""
    _job: Job | None = field(default=None, init=False)
    _processes: list[WorkerProcess] = field(default_factory=list, init=False)
    _inbox: Inbox = field(default_factory=queue.Queue, init=False)

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise ValueError(f"workers is {self.workers}, at least 1")

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: OnFrames, *, retry: bool = True
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, as they come.

        A task that ends its process is tried once more, alone in a new process, unless ``retry`` is off;
        then its outcome has a `WorkerError`.
        """
        again: list[Task] = []
        for task, outcome in self._round(job, tasks, self.workers, on_frames):
            if retry and outcome.error and outcome.error.code in _ENDINGS:
                again.append(task)
            else:
                yield outcome
        for task in again:
            self.close()  # alone, and in a process in which nothing has been done
            for _, outcome in self._round(job, [task], 1, on_frames):
                yield replace(outcome, attempts=2)

    def close(self) -> None:
        """End the worker processes."""
        for process in self._processes:
            process.end()
        self._processes.clear()
        self._job = None

    def _round(
        self, job: Job, tasks: Sequence[Task], workers: int, on_frames: OnFrames
    ) -> Iterator[tuple[Task, Outcome]]:
        waiting = deque(tasks)
        if self._job != job:
            self.close()
        self._job, processes = job, self._processes
        done = False
        try:
            while waiting or any(process.task for process in processes):
                busy = sum(process.task is not None for process in processes)
                while len(processes) < min(workers, len(waiting) + busy):
                    processes.append(self._start(job))
                for process in processes:
                    if process.task is None and waiting:
                        process.give(waiting.popleft())
                for process, message in messages(self._inbox):
                    task = process.task
                    if "value" in message and task:
                        process.task = None
                        yield task, _outcome(task, message)
                    elif "frames" in message and task:
                        on_frames(task, message["frames"])
                for process in list(processes):
                    error = process.failure()
                    if error:
                        task = process.task
                        processes.remove(process)
                        process.end()
                        if task:
                            yield task, Outcome(task.number, error=error)
            done = True
        finally:
            if not done:  # nobody wants to know any more, and some are at work
                self.close()

    def _start(self, job: Job) -> WorkerProcess:
        first = [{"function": task.function, "arguments": task.arguments} for task in self.first]
        header = {"job": asdict(job), "first": first}
        return WorkerProcess(header, job.threads, self.limits, self._inbox)


def _outcome(task: Task, message: Message) -> Outcome:
    error = message["error"] and from_tree(message["error"])
    return Outcome(task.number, message["value"], error)


@dataclass
class InlineEngine:
    """Performs tasks one after the other in this process, without limits: a crash ends the run."""

    workers: int
    limits: LimitSettings
    _worker: Worker | None = field(default=None, init=False)

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: OnFrames, *, retry: bool = True
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, in order."""
        if self._worker is None or self._worker.job != job:
            self._worker = Worker(job, lambda message: None)
        for task in tasks:

            def report(message: Message, task: Task = task) -> None:
                if "frames" in message:
                    on_frames(task, message["frames"])

            self._worker.report = report
            yield self._worker.perform(task)

    def close(self) -> None:
        """Forget what the tasks have left behind."""
        self._worker = None


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
        self._engine = InlineEngine(1, limits) if inline else ProcessEngine(1, limits)

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
        if keep and isinstance(self._engine, ProcessEngine):
            self._engine.first.append(task)
        return outcome.value

    def __enter__(self) -> Assistant:
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()
