"""One run at a time in a run folder. The operating system drops the lock of a dead holder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from inspect import signature
from pathlib import Path
from typing import Any

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

    # Where the system cannot lock, a soft lock would go by the number of a process, which may be another
    # one's by now; earlier versions have no such fallback.
    known = signature(FileLock.__init__).parameters
    hard: dict[str, Any] = {"fallback_to_soft": False} if "fallback_to_soft" in known else {}
    lock = FileLock(folder / FILE_NAME, blocking=False, **hard)
    try:
        lock.acquire()
    except NotImplementedError as error:
        raise RunFolderError(
            f"cannot be locked: {error}", subject=str(folder), remedy="--out on another file system"
        ) from error
    except PermissionError as error:
        raise RunFolderError(
            f"cannot be written: {error.strerror}",
            subject=str(folder),
            remedy="its permissions, or another --out",
            code="E_RUN_WRITE",
        ) from error
    except Timeout:
        raise RunLockedError(
            "another run holds this folder", subject=str(folder), remedy="wait for it, or another --out"
        ) from None
    try:
        yield
    finally:
        lock.release()
