"""``gesture cache``: what the program has kept to save work, where, how much; and deleting it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import cyclopts
from cyclopts import Parameter

from gesture_core.cli.output import counted, print_list, say
from gesture_core.files import cache_dir

_PARTS = {
    "keypoints": "of videos and keypoint files, by their content; every run uses them",
    "previews": "small videos of the rows of reports, by the content of their inputs",
    "probed": "pose networks that have passed their trial",
    "downloads": "networks of which a part has arrived: 'gesture models get' goes on from there",
    "fetched": "copies of objects of an archive that is no folder, until their turn comes",
    "etags": "content hashes of such objects",
    "numba": "compiled distance kernels, where the package's own folder cannot be written",
}
"""Folders in the cache, and what is in them."""

app = cyclopts.App(
    name="cache",
    help="Show or delete what the program has kept to save work.",
    help_format="plaintext",
    default_parameter=Parameter(negative=()),
)


@app.command
def info() -> int:
    """Show what is in the cache, and where it is. GESTURE_CACHE names another place."""
    rows = []
    for name, what in _PARTS.items():
        sizes = [size for _, size in _files(cache_dir() / name)]
        rows.append((name, str(len(sizes)), f"{sum(sizes) / 2**20:.1f}", str(cache_dir() / name), what))
    print_list(("part", "files", "MiB", "folder", "what it is"), rows)
    return 0


@app.command
def clear() -> int:
    """Delete all that is in the cache. Run folders, their rows and fitted examples stay as they are.

    A run that goes on at the same time misses its keypoints: its rows say so, and --retry-errors mends it.
    """
    gone = freed = 0
    for name in _PARTS:
        for path, size in list(_files(cache_dir() / name)):
            with suppress(FileNotFoundError):
                path.unlink()
                gone, freed = gone + 1, freed + size
    say(f"deleted {counted(gone, 'file')} of {freed / 2**20:.1f} MiB in {cache_dir()}")
    return 0


app.default(info)


def _files(folder: Path) -> Iterator[tuple[Path, int]]:
    """The files below ``folder`` and their sizes."""
    for place, _, names in os.walk(folder):
        for name in names:
            path = Path(place, name)
            with suppress(FileNotFoundError):
                yield path, path.lstat().st_size
