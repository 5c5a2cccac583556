"""The engines: ``processes``, with a watch over the life, time and memory of each, and ``inline``."""

from __future__ import annotations

import json
import logging
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from typing import IO, Any

from gesture_core.errors import WorkerError
from gesture_core.files import usable_cores
from gesture_core.plugin.registry import show_tracebacks, tracebacks
from gesture_core.records import Job, Outcome, Task
from gesture_core.run.workers.worker import Worker, from_tree
from gesture_core.settings import LimitSettings

_TICK = 0.2
_START_SECONDS = 120.0
_ENDINGS = frozenset({"E_WORKER_CRASH", "E_WORKER_HANG", "E_WORKER_MEMORY"})
"""Codes of what another process may not meet: memory can also end without ending the process."""

KEPT_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(256 << 20)}
"""Has glibc keep what a batch of large pictures took: given back and taken anew, each page costs a fault."""

OnFrames = Callable[[Task, int], None]
Message = dict[str, Any]
Inbox = queue.Queue[tuple["WorkerProcess", Message | None]]


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
            for process in list(processes):  # one that ended while it was idle must cost no task
                if process.failure():
                    processes.remove(process)
                    process.end()
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
                        error = message["error"] and from_tree(message["error"])
                        yield task, Outcome(task.number, message["value"], error)
                    elif "frames" in message and task:
                        on_frames(task, message["frames"])
                for process in list(processes):
                    failure = process.failure()
                    if failure:
                        task = process.task
                        processes.remove(process)
                        process.end()
                        if task:
                            yield task, Outcome(task.number, error=failure)
            done = True
        finally:
            if not done:  # nobody wants to know any more, and some are at work
                self.close()

    def _start(self, job: Job) -> WorkerProcess:
        first = [{"function": task.function, "arguments": task.arguments} for task in self.first]
        header = {"job": asdict(job), "first": first}
        return WorkerProcess(header, job.threads, self.limits, self._inbox)


class WorkerProcess:
    """One process and the threads that read its pipes.

    Parameters
    ----------
    header : mapping
        Its first message: the job, and the tasks that it performs before any other.
    threads : int
        Of the numeric libraries in it.
    limits : LimitSettings
        ``seconds`` without a sign of progress while it works, and ``memory``.
    inbox : queue
        Gets ``(process, message)`` for each of its messages, and ``(process, None)`` when it ends.

    Attributes
    ----------
    task : Task or None
        What it is doing; None while it is idle.
    """

    def __init__(self, header: Mapping[str, Any], threads: int, limits: LimitSettings, inbox: Inbox) -> None:
        self.task: Task | None = None
        self.ended = False
        self._limits = limits
        self._ready = self._slow = False
        self._plugin = ""
        self._error_lines: deque[str] = deque(maxlen=3)
        environment = KEPT_MEMORY | os.environ
        environment |= {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": str(threads)}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "gesture_core.run.workers.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
            text=True,
            encoding="utf-8",
            errors="replace",
        )
        assert self._process.stdout is not None and self._process.stderr is not None
        self._readers = [
            threading.Thread(target=self._read_messages, args=(self._process.stdout, inbox), daemon=True),
            threading.Thread(target=self._read_errors, args=(self._process.stderr,), daemon=True),
        ]
        for reader in self._readers:
            reader.start()
        self._send({**header, "memory": limits.memory})
        self._seen = time.monotonic()

    def give(self, task: Task) -> None:
        """Hand over ``task``."""
        self.task = task
        self._send({"function": task.function, "arguments": task.arguments})
        self._seen, self._slow = time.monotonic(), False

    def note(self, message: Message) -> None:
        """Take ``message``, which has come from the process, as a sign of progress."""
        self._seen, self._slow = time.monotonic(), "slow" in message

    def failure(self) -> WorkerError | None:
        """Why the process has ended or must be ended; None while all is well."""
        if self.ended:  # it has closed its pipe, and may live on
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=2)
            self._process.kill()
        if self.ended or self._process.poll() is not None:
            code = self._process.wait()
            ending = f"ended with exit code {code}"
            if code < 0:
                with suppress(ValueError):
                    ending = f"was ended by {signal.Signals(-code).name}"
            return self._error(f"the worker process {ending}", "E_WORKER_CRASH", "--retry-errors")
        # The first message, and a task that says so, may take as long as a start.
        starting = self._slow or not self._ready
        allowed = max(self._limits.seconds, _START_SECONDS) if starting else self._limits.seconds
        more = "--retry-errors and --set limits.{}=… with a larger figure"
        if self.task is not None and time.monotonic() - self._seen > allowed:
            return self._error(f"no progress for {allowed:g} s", "E_WORKER_HANG", more.format("seconds"))
        used = self._resident()
        if used > self._limits.memory << 20:
            cause = f"the worker process took {used >> 20} MiB of memory"
            return self._error(cause, "E_WORKER_MEMORY", more.format("memory"))
        return None

    def end(self) -> None:
        """End the process now and wait for it."""
        self.task = None
        self._process.kill()
        self._process.wait()
        for reader in self._readers:
            reader.join(timeout=5)
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            with suppress(OSError):
                if pipe:
                    pipe.close()

    def _error(self, cause: str, code: str, remedy: str) -> WorkerError:
        """The error, with the end of what the process wrote to standard error, on one line."""
        self._process.kill()
        for reader in self._readers:
            reader.join(timeout=1)
        lines = " | ".join(self._error_lines)[-300:]
        cause += f" ({lines})" if lines else ""
        return WorkerError(cause, subject=self._plugin, kept="nothing", remedy=remedy, code=code)

    def _send(self, message: Mapping[str, Any]) -> None:
        assert self._process.stdin is not None
        with suppress(OSError):  # a dead process is noticed by failure()
            self._process.stdin.write(json.dumps(message) + "\n")
            self._process.stdin.flush()

    def _resident(self) -> int:
        import psutil

        try:
            return int(psutil.Process(self._process.pid).memory_info().rss)
        except psutil.Error:
            return 0

    def _read_messages(self, pipe: IO[str], inbox: Inbox) -> None:
        try:
            with suppress(ValueError, OSError):
                for line in pipe:
                    message = dict(json.loads(line))
                    self._ready = True
                    if "plugin" in message:  # kept here, as nobody waits for it
                        self._plugin = str(message["plugin"])
                    elif "note" in message:
                        logging.getLogger("gesture_core").warning(str(message["note"]))
                        self._seen = time.monotonic()
                    else:
                        inbox.put((self, message))
        finally:
            inbox.put((self, None))

    def _read_errors(self, pipe: IO[str]) -> None:
        with suppress(ValueError, OSError):
            for line in pipe:
                if tracebacks():
                    print(line, end="", file=sys.stderr, flush=True)
                if line.strip():
                    self._error_lines.append(line.strip()[:200])


def messages(inbox: Inbox) -> Iterator[tuple[WorkerProcess, Message]]:
    """What has come in, after waiting a moment for the first of it; notes which processes have ended."""
    with suppress(queue.Empty):
        process, message = inbox.get(timeout=_TICK)
        while True:
            if message is None:
                process.ended = True
            else:
                process.note(message)
                yield process, message
            process, message = inbox.get_nowait()


@dataclass
class InlineEngine:
    """Performs tasks one after the other in this process, without limits: a crash ends the run.

    It is for debugging: until it is closed, an exception of a plugin is printed with its lines.
    """

    workers: int
    limits: LimitSettings
    first: list[Task] = field(default_factory=list, init=False)
    """What is performed before anything else, as in `ProcessEngine`."""
    _worker: Worker | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        show_tracebacks(True)

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: OnFrames, *, retry: bool = True
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, in order."""
        if self._worker is None or self._worker.job != job:
            self._worker = Worker(job, lambda message: None)
            for task in self.first:
                self._worker.perform(task)
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


def perform_all(
    job: Job,
    tasks: Sequence[Task],
    limits: LimitSettings,
    workers: int,
    on_frames: OnFrames = lambda task, frames: None,
) -> Iterator[Outcome]:
    """One outcome for each task, in worker processes (0: one for each core), which then end."""
    engine = ProcessEngine(max(1, min(workers or usable_cores(), len(tasks))), limits)
    try:
        yield from engine.run(job, tasks, on_frames)
    finally:
        engine.close()


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

    @property
    def settings(self) -> Mapping[str, Any]:
        """Those of its job, as plain values."""
        return self._job.settings

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
        if keep:
            self._engine.first.append(task)
        return outcome.value

    def __enter__(self) -> Assistant:
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()
