"""Keeps the keypoint store below its limit: what was used longest ago goes first."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from gesture_core.files import TEMPORARY

SPARED_SECONDS = 86_400.0
"""What was used in the last day stays, whatever the limit: another run may be about to read it."""


def mark_used(path: Path) -> None:
    """Note that a file of the store has been used now."""
    with suppress(OSError):  # a store that may only be read is as good
        os.utime(path)


def prune(store: Path, mebibytes: int) -> int:
    """Delete the files of the store that were used longest ago until the others fit.

    Parameters
    ----------
    store : Path
        Its files are in folders one level down.
    mebibytes : int
        What may stay, apart from what was used in the last day. Temporary files that a killed run
        left more than a day ago go in any case.

    Returns
    -------
    int
        Files that were deleted.
    """
    old = time.time() - SPARED_SECONDS
    found = sorted(_files(store), reverse=True)
    room, gone = mebibytes << 20, 0
    for used, size, path in found:
        room -= size
        if used < old and (room < 0 or TEMPORARY in path.name):
            with suppress(OSError):  # another run was quicker, or it is not ours to delete
                path.unlink()
                gone += 1
    return gone


def _files(store: Path) -> Iterator[tuple[float, int, Path]]:
    """When it was last used, size and path of each file; none where there is no store."""
    with suppress(FileNotFoundError):
        for folder in os.scandir(store):
            if not folder.is_dir(follow_symlinks=False):
                continue
            for entry in os.scandir(folder):
                with suppress(FileNotFoundError):
                    facts = entry.stat(follow_symlinks=False)
                    yield facts.st_mtime, facts.st_size, Path(entry.path)
