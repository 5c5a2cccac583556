"""The folder of a run: made, held, and taken away again where the run never began."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gesture_core.errors import ConfigError, RunFolderError
from gesture_core.run import journal, lock


@contextmanager
def run_folder(folder: Path) -> Iterator[None]:
    """Make ``folder`` where there is none, and hold it for this process.

    One that was made here, and in which no run began before an error came (a mistyped source, a wrong
    setting), is removed: mistakes leave nothing behind.

    Raises
    ------
    ConfigError
        ``E_OUT`` where it is a file or cannot be made.
    RunFolderError
        Where another process holds it, or it cannot be held.
    """
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise ConfigError(f"--out {folder} is a file", remedy="a folder", code="E_OUT") from None
    except OSError as error:
        cause = f"--out {folder} cannot be made: {error.strerror or error}"
        raise ConfigError(cause, remedy="another place, or its permissions", code="E_OUT") from None
    try:
        with lock.run_lock(folder):
            yield
    except BaseException:
        if made and not _begun(folder):
            _remove(folder)
        raise


def _begun(folder: Path) -> bool:
    try:
        with journal.open_journal(folder) as found:
            return found.get("configuration") is not None
    except RunFolderError as error:
        return error.code != "E_NO_RUN"


def _remove(folder: Path) -> None:
    with suppress(OSError):  # somebody put something else into it
        for name in (
            journal.FILE_NAME,
            f"{journal.FILE_NAME}-wal",
            f"{journal.FILE_NAME}-shm",
            lock.FILE_NAME,
        ):
            (folder / name).unlink(missing_ok=True)
        folder.rmdir()
