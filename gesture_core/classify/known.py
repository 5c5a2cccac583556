"""Distances of pairs that were compared before, by the content of both: each pair is compared once."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gesture_core.errors import InputError
from gesture_core.files import read_arrays, write_arrays
from gesture_core.types import Signals

LARGEST = 64 << 20
"""Bytes of distances that a file keeps, its first rows: beyond, pairs are compared again."""
_BYTES = 16
"""Of a mark."""


class KnownDistances:
    """A table of the distances of pairs; its rows and columns are named by `mark_of`.

    Parameters
    ----------
    settings : str
        A hash of everything else that decides a distance.
    """

    def __init__(self, settings: str) -> None:
        self._settings = settings
        self._rows: dict[bytes, int] = {}
        self._columns: dict[bytes, int] = {}
        self._values: np.ndarray = np.full((0, 0), np.nan)

    def find(self, rows: Sequence[bytes], columns: Sequence[bytes]) -> np.ndarray:
        """(len(rows), len(columns)) float64; NaN where a pair has not been compared."""
        found: np.ndarray = np.full((len(rows), len(columns)), np.nan)
        places = (
            [self._rows.get(mark, -1) for mark in rows],
            [self._columns.get(mark, -1) for mark in columns],
        )
        own = [np.flatnonzero(np.array(place) >= 0) for place in places]
        there = [np.array(place)[known] for place, known in zip(places, own, strict=True)]
        found[np.ix_(*own)] = self._values[np.ix_(*there)]
        return found

    def learn(self, rows: Sequence[bytes], columns: Sequence[bytes], values: np.ndarray) -> None:
        """Take the distances of all pairs of ``rows`` and ``columns``."""
        for known, marks in ((self._rows, rows), (self._columns, columns)):
            for mark in marks:
                known.setdefault(mark, len(known))
        height, width = self._values.shape
        if len(self._rows) > height or len(self._columns) > width:
            wider: np.ndarray = np.full((2 * len(self._rows), len(self._columns)), np.nan)
            wider[:height, :width] = self._values
            self._values = wider
        self._values[np.ix_([self._rows[m] for m in rows], [self._columns[m] for m in columns])] = values

    def write(self, path: Path) -> None:
        """Keep the table in a file, as many of its first rows as `LARGEST` allows."""
        rows = list(self._rows)[: LARGEST // (8 * max(len(self._columns), 1))]
        arrays = {"values": self._values[: len(rows), : len(self._columns)]}
        for name, marks in (
            ("settings", [self._settings.encode()]),
            ("rows", rows),
            ("columns", self._columns),
        ):
            arrays[name] = np.frombuffer(b"".join(marks), np.uint8)
        write_arrays(path, arrays)

    @classmethod
    def read(cls, path: Path, settings: str) -> KnownDistances:
        """The table in a file; an empty one where there is none, or one that does not fit.

        It is a copy of what can be computed: one that was made under other settings, or is damaged, is
        computed again.
        """
        known = cls(settings)
        try:
            arrays = read_arrays(path, 2 * LARGEST)
            names = [arrays[name].astype(np.uint8).tobytes() for name in ("settings", "rows", "columns")]
            values = arrays["values"].astype(np.float64)
        except (InputError, KeyError, ValueError):
            return known
        rows, columns = ([name[i : i + _BYTES] for i in range(0, len(name), _BYTES)] for name in names[1:])
        if names[0] == settings.encode() and values.shape == (len(rows), len(columns)):
            known.learn(rows, columns, values)
        return known


def mark_of(item: Signals) -> bytes:
    """A hash of all in ``item`` that decides its distances."""
    digest = hashlib.sha256(repr((item.channels, item.values.shape)).encode())
    for part in (item.values, np.asarray(item.mask), np.asarray(item.present)):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.digest()[:_BYTES]
