"""Keypoints in HDF5: SLEAP's analysis files, and the tables that DeepLabCut writes through pandas."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.types import PoseSequence
from gesture_pose_files.deeplabcut import Column, individuals
from gesture_pose_files.files import COPY_AGAIN, MAX_ARRAY_BYTES, head_of, open_keypoints
from gesture_pose_files.named import joints_among, people_of
from gesture_pose_files.reader import OneClipReader

if TYPE_CHECKING:
    import h5py

_MAGIC = b"\x89HDF\r\n\x1a\n"
_SUFFIXES = (".h5", ".hdf5")
_MAX_FILE_BYTES = 2 << 30
_MAX_LABELS = 1 << 16
_AS_TABLE = "to_parquet or to_csv, for a data frame with columns such as nose_x, nose_y"


class Hdf5Reader(OneClipReader):
    """Reads ``.h5`` of SLEAP (*export analysis HDF5*) and of DeepLabCut.

    Nothing in the file leads out of it: links to other files and virtual datasets are refused. The names of
    DeepLabCut's columns are pickled; they are read as lists, tuples and text, and as nothing else. The option
    ``order`` is for body parts that have names of their own.
    """

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` is called ``.h5`` and is HDF5."""
        return path.suffix.lower() in _SUFFIXES and head_of(path, 8) == _MAGIC

    def refusal(self, path: Path) -> str:
        """That it is no HDF5."""
        return f"it is no HDF5, it begins with {head_of(path, 8)!r}"

    def sequences(self, path: Path, source: str) -> list[PoseSequence]:
        """The tracks or individuals in the file."""
        with _opened(path, source) as file:
            names = list(file)
            if "tracks" in names and "node_names" in names:
                return self.best(self._tracks(file, source), source)
            for name in names:
                if "pandas_type" in _group(file, name, source).attrs:
                    columns, values, numbers = _pandas(_group(file, name, source), source)
                    found = individuals(columns, values, numbers, self.options, source, "hdf5")
                    return self.best(found, source)
        shown = ", ".join(map(repr, names[:6])) + (", …" if names[6:] else "")
        raise _refused(
            f"holds {shown or 'nothing'}: neither SLEAP's 'tracks' and 'node_names' nor DeepLabCut's table",
            source,
            "in SLEAP: File, Export Analysis HDF5",
        )

    def _tracks(self, file: h5py.File, source: str) -> list[PoseSequence]:
        """Those of SLEAP."""
        nodes = [_text(name) for name in _array(file, "node_names", source).reshape(-1)]
        points, scores = _frames_first(_array(file, "tracks", source), file, len(nodes), source)
        named = joints_among(nodes, self.options, source)
        return people_of(named, points, scores, self.options, source=source, reader="hdf5")


def _frames_first(
    tracks: np.ndarray, file: h5py.File, nodes: int, source: str
) -> tuple[np.ndarray, np.ndarray]:
    """(tracks, frames, nodes, 2) and (tracks, frames, nodes) scores, from either order that SLEAP writes."""
    given = _array(file, "point_scores", source) if "point_scores" in file else None
    if tracks.ndim == 4 and tracks.shape[1:3] == (2, nodes):  # (tracks, 2, nodes, frames)
        points = tracks.transpose(0, 3, 2, 1)
        scores = given.transpose(0, 2, 1) if given is not None and given.ndim == 3 else None
    elif tracks.ndim == 4 and tracks.shape[2:] == (nodes, 2):  # (frames, tracks, nodes, 2)
        points = tracks.transpose(1, 0, 2, 3)
        scores = given.transpose(1, 0, 2) if given is not None and given.ndim == 3 else None
    else:
        raise _refused(f"has tracks of shape {tracks.shape} for {nodes} nodes", source)
    if scores is None or scores.shape != points.shape[:3]:
        scores = np.ones(points.shape[:3])
    return points, scores


def _pandas(group: h5py.Group, source: str) -> tuple[list[Column], np.ndarray, list[int | None]]:
    """The columns, (T, C) values, and numbers of the frames."""
    if "table" in group:  # written with format="table"
        table = _array(group, "table", source)
        if "values_block_0" not in (table.dtype.names or ()):
            raise _refused("has a table without values", source)
        values = table["values_block_0"].reshape(len(table), -1)
        labels = _unpickled(_dataset(group, "table", source).attrs.get("values_block_0_kind"), source)
        index = table["index"] if "index" in (table.dtype.names or ()) else np.arange(len(table))
    else:  # with format="fixed"
        if int(group.attrs.get("nblocks", 0)) != 1:
            raise _refused("is a table of several kinds of values", source)
        levels = int(group.attrs.get("block0_items_nlevels", 0))
        names = [_array(group, f"block0_items_level{level}", source) for level in range(levels)]
        codes = [_array(group, f"block0_items_label{level}", source) for level in range(levels)]
        labels = list(
            zip(
                *([_text(known[c]) for c in code] for known, code in zip(names, codes, strict=True)),
                strict=True,
            )
        )
        values = _array(group, "block0_values", source)
        index = _array(group, "axis1", source) if "axis1" in group else np.arange(len(values))
    if not isinstance(labels, list) or not all(
        isinstance(label, tuple) and len(label) in (3, 4) and all(isinstance(part, str) for part in label)
        for label in labels
    ):
        raise _refused(
            "has columns of other than scorer, (individual,) body part and coordinate", source, _AS_TABLE
        )
    if values.ndim != 2 or len(labels) != values.shape[1] or len(index) != len(values):
        cause = f"has {len(labels)} columns of scorer, body part and coordinate for {values.shape} values"
        raise _refused(cause, source, _AS_TABLE)
    whole = index.ndim == 1 and index.dtype.kind in "iu"
    columns = [("" if len(label) == 3 else label[1], label[-2], label[-1]) for label in labels]
    return columns, values.astype(np.float64), [int(number) if whole else None for number in index]


class _PlainUnpickler(pickle.Unpickler):
    """Reads pickled lists, tuples, text and numbers; no class or function can be named, so none is called."""

    def find_class(self, module: str, name: str) -> NoReturn:
        raise pickle.UnpicklingError(f"names {module}.{name}")

    def persistent_load(self, pid: Any) -> NoReturn:
        raise pickle.UnpicklingError("names an object outside")


def _unpickled(held: object, source: str) -> object:
    data = bytes(held) if isinstance(held, bytes) else b""
    if len(data) > _MAX_LABELS * 16:
        raise _refused("has too many columns", source)
    try:
        return _PlainUnpickler(io.BytesIO(data)).load()
    except Exception as error:  # a damaged pickle raises anything, and can do nothing else
        raise _refused(f"does not name its columns: {error}", source) from error


@contextmanager
def _opened(path: Path, source: str) -> Iterator[h5py.File]:
    import h5py

    with open_keypoints(path, _MAX_FILE_BYTES) as raw:
        try:
            with h5py.File(raw, "r") as file:
                yield file
        except (
            OSError, RuntimeError, ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError,
            MemoryError,
        ) as error:  # fmt: skip
            raise KeypointError(
                f"is damaged: {str(error).splitlines()[0] if str(error) else type(error).__name__}",
                subject=source,
                remedy=COPY_AGAIN,
                code="E_KEYPOINTS_BROKEN",
            ) from error


Loaders = dict[str, tuple[tuple[int, ...], Callable[[], np.ndarray]]]
"""Shape of each array by its name, and what loads it."""


@contextmanager
def arrays_in(path: Path, source: str) -> Iterator[Loaders]:
    """Shape of each array of numbers at the top of a file of MATLAB 7.3, with what loads it; by rows."""
    try:
        import h5py
    except ImportError as error:
        raise KeypointError(
            "is of MATLAB 7.3, which needs h5py",
            subject=source,
            remedy="pip install 'gesture-core[hdf5]', or save(…, '-v7')",
            code="E_MISSING_DEPENDENCY",
        ) from error
    with _opened(path, source) as file:
        held: Loaders = {}
        for name in file:
            found = _group(file, name, source)
            if isinstance(found, h5py.Dataset) and found.dtype.kind in "fiub":
                held[name] = found.shape[::-1], partial(_by_rows, file, name, source)
        yield held


def _by_rows(file: h5py.File, name: str, source: str) -> np.ndarray:
    return _array(file, name, source).T


def _group(parent: h5py.Group, name: str, source: str) -> h5py.Group | h5py.Dataset:
    """What ``name`` is in the file itself; a link to another file is refused."""
    import h5py

    if not isinstance(parent.get(name, getlink=True), h5py.HardLink):
        raise _refused(f"has {name!r} elsewhere, as a link", source)
    return parent[name]


def _dataset(parent: h5py.Group, name: str, source: str) -> h5py.Dataset:
    import h5py

    found = _group(parent, name, source)
    if not isinstance(found, h5py.Dataset):
        raise _refused(f"has {name!r} as a group, expected an array", source)
    return found


def _array(parent: h5py.Group, name: str, source: str) -> np.ndarray:
    """The array ``name``, its size checked before any memory is taken."""
    found = _dataset(parent, name, source)
    if found.is_virtual or found.external:
        raise _refused(f"keeps {name!r} in other files", source)
    size = prod(found.shape or ()) * found.dtype.itemsize
    if size > MAX_ARRAY_BYTES:
        raise KeypointError(
            f"claims {size} bytes in {name!r}, more than the {MAX_ARRAY_BYTES} allowed",
            subject=source,
            remedy="split it",
            code="E_KEYPOINTS_LIMIT",
        )
    return np.asarray(found[()])


def _text(name: object) -> str:
    return name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name)


def _refused(cause: str, source: str, remedy: str = "") -> KeypointError:
    return KeypointError(cause, subject=source, remedy=remedy, code="E_KEYPOINTS_FORMAT")
