"""A process of one's own that talks JSON lines, and the watch over its life, time and memory.

It is started afresh (never forked), so a caller's script needs no ``if __name__ == "__main__"``
guard and JAX's threads are never copied.
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
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import IO, Any

from gesture_core.settings import LimitSettings

CRASH, HANG, MEMORY = "E_WORKER_CRASH", "E_WORKER_HANG", "E_WORKER_MEMORY"
DEATHS = frozenset({CRASH, HANG, MEMORY})
"""Codes of what was lost with the process that had it."""
_TICK = 0.2
_START_SECONDS = 120.0

Inbox = queue.Queue[tuple["Child", dict[str, Any] | None]]


@dataclass(frozen=True)
class Death:
    """Why a process ended, or had to be ended."""

    code: str
    cause: str

    @property
    def remedy(self) -> str:
        """What to try where the input is not at fault."""
        if self.code == CRASH:
            return "--retry-errors"
        setting = "limits.seconds" if self.code == HANG else "limits.memory"
        return f"--retry-errors and --set {setting}=… with a larger figure"


class Child:
    """One process and the threads that read its pipes.

    Parameters
    ----------
    module : str
        Run as ``python -m module``; it calls `serving.serve`.
    header : mapping
        Its first message; the memory limit is added.
    threads : int
        Of the numeric libraries in it.
    limits : LimitSettings
        ``seconds`` without a sign of progress while it works, and ``memory``.
    inbox : queue
        Gets ``(child, message)`` for each of its messages, and ``(child, None)`` when it ends.

    Attributes
    ----------
    work : object or None
        What it is doing; None while it is idle.
    """

    def __init__(
        self, module: str, header: Mapping[str, Any], threads: int, limits: LimitSettings, inbox: Inbox
    ) -> None:
        self.work: Any = None
        self.ended = False
        self._limits = limits
        self._ready = self._slow = False
        self._words: deque[str] = deque(maxlen=3)
        environment = os.environ | {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": str(threads)}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", module],
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
        self._send({**header, "memory": limits.memory})
        self.touch()

    def give(self, work: Any, message: Mapping[str, Any], *, slow: bool = False) -> None:
        """Hand over ``work``, which ``message`` tells; ``slow`` where it may take as long as a start."""
        self.work = work
        self._send(message)
        self.touch(slow=slow)

    def touch(self, *, slow: bool = False) -> None:
        """Note a sign of life; ``slow`` where the next one may take as long as a start."""
        self._seen, self._slow = time.monotonic(), slow

    def failure(self) -> Death | None:
        """Why the process has ended or must be ended; None while all is well."""
        if self.ended:  # it has closed its pipe, and may live on
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=2)
            self._process.kill()
        if self.ended or self._process.poll() is not None:
            return Death(CRASH, f"the worker process {_exit_text(self._process.wait())}")
        starting = self._slow or not self._ready
        allowed = max(self._limits.seconds, _START_SECONDS) if starting else self._limits.seconds
        if self.work is not None and time.monotonic() - self._seen > allowed:
            return Death(HANG, f"no progress for {allowed:g} s")
        used = self._resident()
        if used > self._limits.memory << 20:
            return Death(MEMORY, f"the worker process took {used >> 20} MiB of memory")
        return None

    def last_words(self) -> str:
        """The end of what the process wrote to standard error, on one line, in brackets; or nothing."""
        self._readers[1].join(timeout=1)
        words = " | ".join(self._words)[-300:]
        return f" ({words})" if words else ""

    def kill(self) -> None:
        """End the process now and wait for it."""
        self.work = None
        self._process.kill()
        self._process.wait()
        for reader in self._readers:
            reader.join(timeout=5)
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            with suppress(OSError):
                if pipe:
                    pipe.close()

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

    def _listen(self, pipe: IO[str], inbox: Inbox) -> None:
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


def messages(inbox: Inbox) -> Iterator[tuple[Child, dict[str, Any]]]:
    """What has come in, after waiting a moment for the first of it; notes which processes have ended."""
    with suppress(queue.Empty):
        child, message = inbox.get(timeout=_TICK)
        while True:
            if message is None:
                child.ended = True
            else:
                child.touch(slow="slow" in message)
                yield child, message
            child, message = inbox.get_nowait()


def _exit_text(code: int) -> str:
    if code < 0:
        with suppress(ValueError):
            return f"was ended by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"
