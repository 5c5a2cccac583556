"""The files that ``gesture extract`` leaves in the run folder, named after the inputs."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from gesture_core.archive.atomic import replacing
from gesture_core.archive.discovery import Input

_LONGEST = 120
_ODD = re.compile(r"[^\w .=@+-]|^\.+$")


def publish(stored: Path, target: Path) -> None:
    """Copy a file of the keypoint store to its place under ``<out>/keypoints/``."""
    with replacing(target) as temporary:
        shutil.copyfile(stored, temporary)


def keypoint_files(items: Sequence[Input], sources: Sequence[str]) -> dict[bytes, Path]:
    """Place of each input's file below ``keypoints/``, by the input's key.

    The folders below a source are kept: ``videos/a/b.mp4`` becomes ``a/b.mp4.parquet``. Names that
    another input claims too, that are long, or that hold odd characters get a hash of the input's path.
    """
    plain = {item.key: _place(item, [Path(source) for source in sources]) for item in items}
    claims = Counter(str(path).casefold() for path in plain.values())
    return {
        item.key: plain[item.key] if _plain(plain[item.key], claims) else _hashed(plain[item.key], item)
        for item in items
    }


def _place(item: Input, roots: Sequence[Path]) -> Path:
    inside = next(
        (item.path.relative_to(r) for r in roots if item.path != r and item.path.is_relative_to(r)), None
    )
    place = inside if inside is not None else Path(item.path.name or "input")
    return place.with_name(f"{place.name}{f'.{item.member}' if item.member else ''}".replace("/", "_"))


def _plain(path: Path, claims: Counter[str]) -> bool:
    ordinary = all(len(part) <= _LONGEST and not _ODD.search(part) for part in path.parts)
    return ordinary and claims[str(path).casefold()] == 1


def _hashed(path: Path, item: Input) -> Path:
    stem = _ODD.sub("_", os.fsencode(path.name).decode("ascii", "replace"))[:_LONGEST]
    return Path(f"{stem}-{hashlib.sha256(item.key).hexdigest()[:12]}")
