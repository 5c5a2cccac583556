"""Content hashes of files, folders and settings; stamps that say whether a file has been written since."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

_CHUNK = 8 << 20


def content_sha256(path: Path, on_piece: Callable[[], None] = lambda: None) -> str:
    """SHA-256 of a file, or of the names and hashes of the regular files directly in a folder.

    ``on_piece`` is called as pieces are read, as a sign of life. Raises OSError.
    """
    if not path.is_dir():
        return _file_sha256(path, on_piece)
    digest = hashlib.sha256()
    for entry in _regular_files(path):
        digest.update(os.fsencode(entry.name) + b"\0" + _file_sha256(entry, on_piece).encode() + b"\n")
    return digest.hexdigest()


def _file_sha256(path: Path, on_piece: Callable[[], None]) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
            on_piece()
    return digest.hexdigest()


def stamp(path: Path) -> str:
    """What changes when a file, or a regular file directly in a folder, is written, added or renamed.

    Raises OSError where the path cannot be looked at.
    """
    if not path.is_dir():
        return json.dumps(_facts(path))
    digest = hashlib.sha256()
    for entry in _regular_files(path):
        digest.update(os.fsencode(entry.name) + b"\0" + json.dumps(_facts(entry)).encode())
    return digest.hexdigest()


def _facts(path: Path) -> tuple[int, int, int]:
    found = path.stat()
    return found.st_size, found.st_mtime_ns, found.st_ctime_ns


def _regular_files(folder: Path) -> Iterator[Path]:
    for entry in sorted(folder.iterdir(), key=lambda entry: os.fsencode(entry.name)):
        try:
            regular = stat.S_ISREG(entry.stat().st_mode)
        except OSError:  # a link that leads nowhere holds nothing
            continue
        if regular:
            yield entry


def settings_sha256(tree: Any) -> str:
    """SHA-256 of a tree of plain values, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(tree, sort_keys=True, ensure_ascii=True).encode()).hexdigest()
