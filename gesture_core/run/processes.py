"""Workers in processes of their own: a crash, a hang or a hunger for memory costs one input."""

from __future__ import annotations

import queue
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from gesture_core.run.child import CRASH, DEATHS, Child, Death, Inbox, messages
from gesture_core.run.work import Job, Outcome, Task
from gesture_core.settings import LimitSettings


@dataclass
class _Pool:
    """Workers that stay alive from one run of the engine to the next, all with the same job."""

    job: Job | None = None
    children: list[Child] = field(default_factory=list)
    inbox: Inbox = field(default_factory=queue.Queue)


@dataclass(frozen=True)
class ProcessEngine:
    """Runs tasks in worker processes, which live on for the next `run` with the same job until `close`.

    Attributes
    ----------
    workers : int
        Processes at a time.
    limits : LimitSettings
        ``seconds`` without a sign of progress and ``memory`` of a process, beyond which it is
        ended. Its task is then tried once more, alone, before it fails.
    """

    workers: int
    limits: LimitSettings
    _pool: _Pool = field(default_factory=_Pool, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise ValueError(f"workers is {self.workers}, at least 1")

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: Callable[[Task, int], None]
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, as they come."""
        again: list[Task] = []
        for task, outcome in self._round(job, tasks, self.workers, on_frames):
            if outcome.code in DEATHS:
                again.append(task)
            else:
                yield outcome
        for task in again:
            self.close()  # alone, and in a process that nothing has been done in
            for _, outcome in self._round(job, [task], 1, on_frames):
                yield replace(outcome, attempts=2)

    def close(self) -> None:
        """End the worker processes."""
        for child in self._pool.children:
            child.kill()
        self._pool.children.clear()
        self._pool.job = None

    def _round(
        self, job: Job, tasks: Sequence[Task], workers: int, on_frames: Callable[[Task, int], None]
    ) -> Iterator[tuple[Task, Outcome]]:
        waiting = deque(tasks)
        if self._pool.job != job:
            self.close()
        self._pool.job, children = job, self._pool.children
        done = False
        try:
            while waiting or any(child.work for child in children):
                busy = sum(child.work is not None for child in children)
                while len(children) < min(workers, len(waiting) + busy):
                    children.append(self._start(job))
                for child in children:
                    if child.work is None and waiting:
                        task = waiting.popleft()
                        child.give(task, task.as_dict())
                for child, message in messages(self._pool.inbox):
                    task = child.work
                    if "outcome" in message and task:
                        child.work = None
                        yield task, Outcome.from_dict(message["outcome"])
                    elif "frames" in message and task:
                        on_frames(task, message["frames"])
                for child in list(children):
                    death = child.failure()
                    if death:
                        task = child.work
                        children.remove(child)
                        child.kill()
                        if task:
                            yield task, _lost(task, death, child.last_words())
            done = True
        finally:
            if not done:  # nobody wants to know any more, and some are at work
                self.close()

    def _start(self, job: Job) -> Child:
        header = {"job": job.as_dict()}
        module = "gesture_core.run.worker"
        return Child(module, header, job.threads, self.limits, self._pool.inbox)


def _lost(task: Task, death: Death, words: str) -> Outcome:
    remedy = death.remedy
    if death.code == CRASH and task.kind == "video":
        remedy = "repair the file, or --set pose.reader=… with the other video reader"
    message = f"{death.cause}{words}; kept: nothing; try: {remedy}"
    return Outcome(task.number, code=death.code, message=message, complete=False)
