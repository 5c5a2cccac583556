"""Kills runs, as the kernel would: right before each write, flush, rename and commit, and at random moments.

``python kill_points.py SOURCE EXAMPLES FOLDER [RANDOM] [SEED] [STEP]`` forks a child for each run (before
anything has started a thread), resumes what a killed child left, and compares the sorted export, byte
for byte, with that of an undisturbed run; of the points it takes every STEP-th. Prints
``<n> at points, <n> at random`` at the end, or what differs. `benchmarks/soak_kills.py` does the same
with more.
"""

from __future__ import annotations

import importlib
import os
import random
import shutil
import signal
import sqlite3
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

MOST_AT_RANDOM = 3
"""Kills of one run before it is left alone."""


def arm(count: int) -> None:
    """Kill this process right before its ``count``-th call that changes what is on the disk."""
    import pyarrow.parquet as pq

    from gesture_core.run import results

    left = count

    def counted(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            nonlocal left
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments, **options)

        return call

    os.fsync = counted(os.fsync)
    Path.replace = counted(Path.replace)  # type: ignore[method-assign]
    pq.write_table = counted(pq.write_table)
    transaction = results._transaction

    @contextmanager
    def killed(db: sqlite3.Connection) -> Iterator[None]:
        counted(lambda: None)()
        with transaction(db):
            yield
            counted(lambda: None)()

    results._transaction = killed


class Victim:
    """A run of one archive, in forked children, each time in a folder and with a cache of its own.

    Attributes
    ----------
    seconds : float
        How long an undisturbed run takes.
    """

    def __init__(self, source: str, examples: str, folder: Path, engine: str = "inline") -> None:
        self._source, self._examples, self._folder, self._engine = source, examples, folder, engine
        names = folder / "modules"
        assert _wait(self._start("clean", after=lambda: names.write_text(" ".join(sys.modules)))) == 0
        for name in names.read_text().split():  # loaded here once, so that no run need load them again
            if name != "__main__":
                importlib.import_module(name)
        self._expected = self._export("clean")
        self._clean("clean")
        started = time.monotonic()
        assert _wait(self._start("clean")) == 0
        self.seconds = time.monotonic() - started

    def at_point(self, number: int) -> bool:
        """Kill at the ``number``-th point; False where the run ended before it."""
        status = _wait(self._start("run", lambda: arm(number)))
        if status == 0:
            self._clean("run")
            return False
        assert os.WIFSIGNALED(status), f"failed at point {number} instead of being killed"
        self._resume(f"point {number}")
        return True

    def at_random(self, rng: random.Random) -> int:
        """Kill at random moments, some times over; the number of kills."""
        kills = 0
        for _ in range(MOST_AT_RANDOM):
            child = self._start("run")
            time.sleep(rng.uniform(0, 1.05 * self.seconds))
            os.kill(child, signal.SIGKILL)
            status = _wait(child)
            if not os.WIFSIGNALED(status):
                assert status == 0
                self.seconds *= 0.8  # it was measured while the machine had more to do
                break
            kills += 1
        self._resume(f"{kills} kills at random")
        return kills

    def _start(
        self, name: str, before: Callable[[], None] = lambda: None, after: Callable[[], object] = lambda: None
    ) -> int:
        child = os.fork()
        if child:
            return child
        code = 1
        try:
            os.environ["GESTURE_CACHE"] = str(self._folder / f"{name}-cache")
            before()
            self._run(self._folder / name)
            after()
            code = 0
        except BaseException:
            traceback.print_exc()
            raise
        finally:
            os._exit(code)

    def _run(self, out: Path) -> None:
        from gesture_core.run.archive import as_strings
        from gesture_core.run.pipeline import run_archive
        from gesture_core.run.plan import RunRequest
        from gesture_core.settings import load_settings

        settings = load_settings("paper", environment={}, classify__kernel="numpy")
        examples = as_strings(self._examples)
        run_archive(RunRequest(as_strings(self._source), out, settings, examples, engine=self._engine))

    def _resume(self, after: str) -> None:
        assert _wait(self._start("run")) == 0, f"no resume after {after}"
        found = self._export("run")
        if found != self._expected:
            lines = [b"- %s" % line for line in self._expected if line not in found]
            lines += [b"+ %s" % line for line in found if line not in self._expected]
            raise AssertionError(f"another export after {after}:\n{b''.join(lines).decode()}")
        self._clean("run")

    def _export(self, name: str) -> list[bytes]:
        from gesture_core.run.export import export_rows
        from gesture_core.settings import LimitSettings

        exported = export_rows(self._folder / name, "csv", None, LimitSettings())
        return sorted(exported.read_bytes().splitlines(keepends=True))

    def _clean(self, name: str) -> None:
        shutil.rmtree(self._folder / name)
        shutil.rmtree(self._folder / f"{name}-cache", ignore_errors=True)


def _wait(child: int) -> int:
    return os.waitpid(child, 0)[1]


def main(
    source: str, examples: str, folder: str, at_random: str = "0", seed: str = "1", step: str = "1"
) -> None:
    victim = Victim(source, examples, Path(folder))
    points = 0
    while victim.at_point(1 + points * int(step)):
        points += 1
    kills, rng = 0, random.Random(seed)
    while kills < int(at_random):
        kills += victim.at_random(rng)
    print(f"{points} at points, {kills} at random")


if __name__ == "__main__":
    main(*sys.argv[1:])
