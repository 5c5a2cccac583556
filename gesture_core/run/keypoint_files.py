"""The files that ``gesture extract`` leaves in the run folder, named after the inputs."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from gesture_core.files import replacing
from gesture_core.run.inputs import Input
from gesture_core.run.results import Results

_LONGEST = 120
_ODD = re.compile(r"[^\w .=@+-]|^\.+$")


class KeypointFiles:
    """The folder ``<out>/keypoints/``: one file for each input that has keypoints, as the results know them.

    Parameters
    ----------
    out : Path
        The run folder.
    results : Results
    inputs : sequence of Input
        Of this run.
    sources : sequence of str
        What they were found in.
    """

    def __init__(self, out: Path, results: Results, inputs: Sequence[Input], sources: Sequence[str]) -> None:
        self._folder, self._removed = out / "keypoints", out / "removed"
        self._results = results
        self._inputs = {item.place for item in inputs}
        self._known, own = results.published(), {item.key for item in inputs}
        others = [file for key, file in self._known.items() if key not in own]
        self._names = file_names(inputs, sources, others)
        self._claims = Counter(self._known.values())

    def lacking(self) -> set[bytes]:
        """Keys of inputs that have rows with keypoints, and no file of the right name."""
        return {
            key
            for key in self._results.with_keypoints() & self._names.keys()
            if self._known.get(key) != self._names[key] or not (self._folder / self._names[key]).is_file()
        }

    def put(self, item: Input, stored: Path) -> None:
        """Copy a file of the keypoint store to its place."""
        name = self._names[item.key]
        if self._known.get(item.key) != name:
            self._drop(self._known.keys() & {item.key})
            self._claims[name] += 1
        self._results.publish(item.key, name)  # first, so that no file is ever unknown
        self._known[item.key] = name
        with replacing(self._folder / name) as temporary:
            shutil.copyfile(stored, temporary)

    def sweep(self) -> None:
        """Take out the files of inputs that have no keypoints any more, unless they are inputs themselves.

        They go to ``<out>/removed/``: where the video is deleted, its keypoints are all that is left of it.
        """
        self._drop(self._known.keys() - self._results.with_keypoints(), self._removed)

    def _drop(self, keys: Iterable[bytes], to: Path | None = None) -> None:
        gone = []
        for key in keys:
            path = self._folder / self._known[key]
            if os.fsencode(os.path.normpath(path.absolute())) in self._inputs:
                continue
            name = self._known.pop(key)
            self._claims[name] -= 1
            if not self._claims[name]:  # another source may have given it to another input by now
                _take_out(path, None if to is None else to / name)
            gone.append(key)
        if gone:
            self._results.retract(gone)


def _take_out(path: Path, to: Path | None) -> None:
    """Move a file, if it is there, or delete it."""
    if to is None or not path.is_file():
        path.unlink(missing_ok=True)
        return
    to.parent.mkdir(parents=True, exist_ok=True)
    path.replace(to)


def file_names(items: Sequence[Input], sources: Sequence[str], taken: Iterable[str] = ()) -> dict[bytes, str]:
    """Name of each input's file below ``keypoints/``, by the input's key.

    The folders below a source are kept: ``videos/a/b.mp4`` becomes ``a/b.mp4.parquet``. Names that
    another input claims too or that are ``taken``, that are long, or that hold odd characters get a hash
    of the input's path.
    """
    plain = {item.key: _place(item, [Path(source) for source in sources]) for item in items}
    claims = Counter(f"{path}.parquet".casefold() for path in plain.values())
    claims.update(name.casefold() for name in taken)
    return {
        item.key: f"{place if _plain(place, claims) else _hashed(place, item)}.parquet"
        for item in items
        for place in [plain[item.key]]
    }


def _place(item: Input, roots: Sequence[Path]) -> Path:
    inside = next(
        (item.path.relative_to(r) for r in roots if item.path != r and item.path.is_relative_to(r)), None
    )
    place = inside if inside is not None else Path(item.path.name or "input")
    return place.with_name(f"{place.name}{f'.{item.member}' if item.member else ''}".replace("/", "_"))


def _plain(path: Path, claims: Counter[str]) -> bool:
    ordinary = all(len(part) <= _LONGEST and not _ODD.search(part) for part in path.parts)
    return ordinary and claims[f"{path}.parquet".casefold()] == 1


def _hashed(path: Path, item: Input) -> Path:
    stem = _ODD.sub("_", os.fsencode(path.name).decode("ascii", "replace"))[:_LONGEST]
    return Path(f"{stem}-{hashlib.sha256(item.key).hexdigest()[:12]}")
