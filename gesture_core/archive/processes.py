"""Workers in processes of their own: a crash, a hang or a hunger for memory costs one input.

Processes are started afresh (never forked), as ``python -m gesture_core.archive.worker``, so a
caller's script needs no ``if __name__ == "__main__"`` guard and JAX's threads are never copied.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import IO, Any

from gesture_core.archive.work import Job, Outcome, Task
from gesture_core.settings import LimitSettings

_TICK = 0.2
_START_SECONDS = 120.0


@dataclass(frozen=True)
class ProcessEngine:
    """Runs tasks in worker processes.

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

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise ValueError(f"workers is {self.workers}, at least 1")

    def run(
        self, job: Job, tasks: Sequence[Task], on_frames: Callable[[Task, int], None]
    ) -> Iterator[Outcome]:
        """Yield one outcome for every task, as they come."""
        again: list[Task] = []
        for task, outcome in self._round(job, tasks, self.workers, on_frames):
            if outcome.code in _DEATHS:
                again.append(task)
            else:
                yield outcome
        for task in again:
            for _, outcome in self._round(job, [task], 1, on_frames):
                yield replace(outcome, attempts=2)

    def _round(
        self, job: Job, tasks: Sequence[Task], workers: int, on_frames: Callable[[Task, int], None]
    ) -> Iterator[tuple[Task, Outcome]]:
        waiting = deque(tasks)
        inbox: queue.Queue[tuple[_Process, dict[str, Any] | None]] = queue.Queue()
        alive: list[_Process] = []
        try:
            while waiting or any(process.task for process in alive):
                while len(alive) < min(workers, len(waiting) + sum(p.task is not None for p in alive)):
                    alive.append(_Process(job, self.limits, inbox))
                for process in alive:
                    if process.task is None and waiting:
                        process.give(waiting.popleft())
                for process, message in _messages(inbox):
                    if message is None:
                        process.ended = True
                        continue
                    process.touch()
                    if "outcome" in message and process.task:
                        task, process.task = process.task, None
                        yield task, Outcome.from_dict(message["outcome"])
                    elif "frames" in message and process.task:
                        on_frames(process.task, message["frames"])
                for process in list(alive):
                    cause = process.failure()
                    if cause is None:
                        continue
                    alive.remove(process)
                    process.kill()
                    if process.task:
                        yield process.task, _death(process.task, cause, process.last_words())
        finally:
            for process in alive:
                process.kill()


def _messages(inbox: queue.Queue[Any]) -> Iterator[Any]:
    """What has come in, after waiting a moment for the first of it."""
    with suppress(queue.Empty):
        yield inbox.get(timeout=_TICK)
        while True:
            yield inbox.get_nowait()


_DEATHS = {
    "E_WORKER_CRASH": "repair the file, or --set pose.reader=… with the other video reader",
    "E_WORKER_HANG": "--retry-errors and --set limits.seconds=… with a larger figure",
    "E_WORKER_MEMORY": "--retry-errors and --set limits.memory=… with a larger figure",
}


def _death(task: Task, cause: tuple[str, str], words: str) -> Outcome:
    code, text = cause
    message = f"{text}{f' ({words})' if words else ''}; kept: nothing; try: {_DEATHS[code]}"
    return Outcome(task.number, code=code, message=message, complete=False)


class _Process:
    """One worker process and the threads that read its pipes."""

    def __init__(self, job: Job, limits: LimitSettings, inbox: queue.Queue[Any]) -> None:
        self.task: Task | None = None
        self.ended = False
        self._limits = limits
        self._ready = False
        self._words: deque[str] = deque(maxlen=3)
        threads = str(job.threads)
        environment = os.environ | {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "gesture_core.archive.worker"],
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
            threading.Thread(target=self._listen, args=(self._process.stdout, inbox), daemon=True),
            threading.Thread(target=self._overhear, args=(self._process.stderr,), daemon=True),
        ]
        for reader in self._readers:
            reader.start()
        self._send({"job": job.as_dict(), "memory": limits.memory})
        self.touch()

    def give(self, task: Task) -> None:
        """Hand over a task."""
        self.task = task
        self._send(task.as_dict())
        self.touch()

    def touch(self) -> None:
        """Note a sign of life."""
        self._seen = time.monotonic()

    def failure(self) -> tuple[str, str] | None:
        """Code and cause where the process has ended or must be ended."""
        if self.ended:  # it has closed its pipe, and may live on
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=2)
            self._process.kill()
        if self.ended or self._process.poll() is not None:
            return "E_WORKER_CRASH", f"the worker process {_exit_text(self._process.wait())}"
        allowed = self._limits.seconds if self._ready else max(self._limits.seconds, _START_SECONDS)
        if self.task and time.monotonic() - self._seen > allowed:
            return "E_WORKER_HANG", f"no progress for {allowed:g} s"
        used = self._resident()
        if used > self._limits.memory << 20:
            return "E_WORKER_MEMORY", f"the worker process took {used >> 20} MiB of memory"
        return None

    def last_words(self) -> str:
        """The end of what the process wrote to standard error, on one line."""
        self._readers[1].join(timeout=1)
        return " | ".join(self._words)[-300:]

    def kill(self) -> None:
        """End the process now and wait for it."""
        self._process.kill()
        self._process.wait()
        for reader in self._readers:
            reader.join(timeout=5)
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            with suppress(OSError):
                if pipe:
                    pipe.close()

    def _send(self, message: dict[str, Any]) -> None:
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

    def _listen(self, pipe: IO[str], inbox: queue.Queue[Any]) -> None:
        with suppress(ValueError, OSError):
            for line in pipe:
                message = json.loads(line)
                self._ready = True
                inbox.put((self, message))
        inbox.put((self, None))

    def _overhear(self, pipe: IO[str]) -> None:
        with suppress(ValueError, OSError):
            for line in pipe:
                if line.strip():
                    self._words.append(line.strip()[:200])


def _exit_text(code: int) -> str:
    if code < 0:
        with suppress(ValueError):
            return f"was ended by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"
