"""One run at a time in a run folder. The operating system drops the lock of a dead holder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gesture_core.errors import RunFolderError

FILE_NAME = "run.lock"


class RunLockedError(RunFolderError):
    """Another process holds the run folder."""

    code = "E_RUN_LOCKED"


@contextmanager
def run_lock(folder: Path) -> Iterator[None]:
    """Hold ``folder`` for this process.

    Raises
    ------
    RunLockedError
        Where another living process holds it.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(folder / FILE_NAME, blocking=False)
    try:
        lock.acquire()
    except Timeout:
        raise RunLockedError(
            "another run holds this folder", subject=str(folder), remedy="wait for it, or another --out"
        ) from None
    try:
        yield
    finally:
        lock.release()
