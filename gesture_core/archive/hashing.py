"""Content hashes: of files, of folders of keypoint files, and of settings."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

_CHUNK = 1 << 20


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, read in pieces."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def content_sha256(path: Path) -> str:
    """SHA-256 of a file, or of the names and hashes of the files directly in a folder."""
    if not path.is_dir():
        return file_sha256(path)
    digest = hashlib.sha256()
    for entry in sorted(path.iterdir(), key=lambda entry: os.fsencode(entry.name)):
        if entry.is_file():
            digest.update(os.fsencode(entry.name) + b"\0" + file_sha256(entry).encode() + b"\n")
    return digest.hexdigest()


def stamp(path: Path) -> str:
    """What changes when a file, or a file directly in a folder, is written: sizes and times."""
    entries = sorted(path.iterdir()) if path.is_dir() else [path]
    facts = [(entry.stat().st_size, entry.stat().st_mtime_ns) for entry in entries]
    if len(facts) == 1:
        return f"{facts[0][0]}:{facts[0][1]}"
    return f"{len(facts)}:{hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]}"


def settings_sha256(tree: Any) -> str:
    """SHA-256 of a tree of plain values, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(tree, sort_keys=True, ensure_ascii=True).encode()).hexdigest()
