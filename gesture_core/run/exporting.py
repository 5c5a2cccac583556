"""The rows of a run as a file, by whichever result writer."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from gesture_core.errors import GestureError, PluginError
from gesture_core.files import replacing
from gesture_core.plugin import registry
from gesture_core.run.child import MEMORY
from gesture_core.run.journal import Journal, open_journal
from gesture_core.run.sandbox import Sandbox, SandboxDeath
from gesture_core.settings import LimitSettings
from gesture_core.types import COLUMNS

_SECONDS_BETWEEN_SIGNS = 0.5


def export_rows(run: Path, format: str, path: Path | None, limits: LimitSettings) -> Path:
    """Write the rows of ``run`` to ``path`` or ``<run>/results.<suffix>``; the file is whole or not there.

    Raises
    ------
    RunFolderError
        Where there is no run.
    PluginError
        Where the writer is unknown, raises, ends its process, or writes nothing. Writers of third
        parties run under ``limits`` in a process of their own.
    """
    entry = registry().find("writer", format)
    with open_journal(run):
        pass  # where there is no run, no folder is made for it either
    with Sandbox(limits) as sandbox:
        foreign = None if entry.origin.built_in else sandbox
        try:
            target = path or run / f"results{_suffix(format, foreign)}"
            with replacing(target) as temporary:
                _write(run, format, temporary, foreign)
        except SandboxDeath as death:
            raise PluginError(
                f"{entry.title} of {entry.origin}: {death.cause}",
                kept="every row of the run",
                remedy="another --format, or report it",
                code=death.code,
            ) from death
    return target


def _suffix(format: str, sandbox: Sandbox | None) -> str:
    return str(sandbox.ask("suffix", format=format)) if sandbox else suffix_of(format)


def _write(run: Path, format: str, path: Path, sandbox: Sandbox | None) -> None:
    if sandbox:
        sandbox.ask("write", run=os.fsencode(run).hex(), format=format, path=os.fsencode(path).hex())
    else:
        write_rows(run, format, path)


def suffix_of(format: str) -> str:
    """What the names of the files that a writer writes end in."""
    return str(registry().make("writer", format).suffix)


def write_rows(run: Path, format: str, path: Path, alive: Callable[[], None] = lambda: None) -> None:
    """Write the rows of ``run`` to ``path`` in this process; ``alive`` is called now and then."""
    entry = registry().find("writer", format)
    writer = registry().make("writer", format)
    with open_journal(run) as journal:
        try:
            writer.write(_records(journal, alive), COLUMNS, path)
        except (GestureError, OSError):
            raise
        except MemoryError as error:
            raise PluginError(
                f"{entry.title} of {entry.origin}: out of memory",
                kept="every row of the run",
                remedy="GESTURE_SET_LIMITS__MEMORY=… with a larger figure in the environment",
                code=MEMORY,
            ) from error
        except (Exception, SystemExit) as error:
            raise PluginError(
                f"{entry.title} of {entry.origin} raised {type(error).__name__}: {error}",
                kept="every row of the run",
                remedy="another --format, or report it",
                code="E_PLUGIN_RAISED",
            ) from error
    if not path.is_file():
        cause = f"{entry.title} of {entry.origin} wrote no file"
        raise PluginError(cause, kept="every row of the run", code="E_PLUGIN_CONTRACT")


def _records(journal: Journal, alive: Callable[[], None]) -> Iterator[dict[str, Any]]:
    """The rows as records, with a sign of life now and then."""
    last = time.monotonic()
    with journal.failures():
        for row in journal.rows():
            yield row.as_record()
            if time.monotonic() - last > _SECONDS_BETWEEN_SIGNS:
                alive()
                last = time.monotonic()
