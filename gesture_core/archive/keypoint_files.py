"""The files that ``gesture extract`` leaves in the run folder, named after the inputs."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from gesture_core.archive.atomic import replacing
from gesture_core.archive.discovery import Input
from gesture_core.archive.run import RunRequest


def publish(stored: Path, item: Input, request: RunRequest) -> Path:
    """Give a file of the keypoint store its place under ``<out>/keypoints/``.

    The folders below the source are kept: ``videos/a/b.mp4`` becomes ``keypoints/a/b.mp4.parquet``.
    """
    target = request.out / "keypoints" / keypoint_file(item, request.sources)
    with replacing(target) as temporary:
        try:
            os.link(stored, temporary)
        except OSError:  # another file system, or one without links
            shutil.copyfile(stored, temporary)
    return target


def keypoint_file(item: Input, sources: tuple[str, ...]) -> Path:
    """Path of an input's keypoint file below ``keypoints/``."""
    roots = [Path(source) for source in sources if item.path != Path(source)]
    inside = next((item.path.relative_to(r) for r in roots if item.path.is_relative_to(r)), None)
    place = inside if inside is not None else Path(item.path.name)
    member = f".{item.member.replace('/', '_')}" if item.member else ""
    return place.with_name(f"{place.name}{member}.parquet")
