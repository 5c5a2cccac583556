"""Distances of pairs that were compared before, by the content of both: each pair is compared once."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gesture_core.errors import InputError
from gesture_core.files import read_arrays, write_arrays
from gesture_core.types import Signals

LARGEST = 64 << 20
"""Bytes of distances that are kept, those of the first rows: beyond, pairs are compared again."""
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

    def completed(
        self,
        queries: Sequence[Any],
        columns: Sequence[bytes],
        compute: Callable[[Sequence[Any], np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """(Q, N) distances of ``queries`` to the examples with the marks ``columns``.

        ``compute(queries, indices)`` gives those of some queries to the examples at some indices; it is asked
        for pairs that are not known, once for all queries that lack the same ones.
        """
        marks = mark_all(queries)
        found = self.find(marks, columns)
        unknown = np.isnan(found)
        patterns, which = np.unique(unknown, axis=0, return_inverse=True)
        for number, pattern in enumerate(patterns):
            rows, missing = np.flatnonzero(which.reshape(-1) == number), np.flatnonzero(pattern)
            if len(missing):
                found[np.ix_(rows, missing)] = compute([queries[i] for i in rows.tolist()], missing)
        if unknown.any():
            self.learn(marks, columns, found)
        return found

    def find(self, rows: Sequence[bytes], columns: Sequence[bytes]) -> np.ndarray:
        """(len(rows), len(columns)) float64; NaN where a pair has not been compared."""
        found: np.ndarray = np.full((len(rows), len(columns)), np.nan)
        high, wide = (
            np.array([known.get(mark, -1) for mark in marks], np.int64)
            for known, marks in ((self._rows, rows), (self._columns, columns))
        )
        own = np.ix_(high >= 0, wide >= 0)
        found[own] = self._values[np.ix_(high[high >= 0], wide[wide >= 0])]
        return found

    def learn(self, rows: Sequence[bytes], columns: Sequence[bytes], values: np.ndarray) -> None:
        """Take the distances of all pairs of ``rows`` and ``columns``, while there is room (`LARGEST`)."""
        for mark in columns:
            self._columns.setdefault(mark, len(self._columns))
        most = LARGEST // (8 * max(1, len(self._columns)))
        self._rows = dict(list(self._rows.items())[:most])
        for mark in rows:
            if len(self._rows) < most:
                self._rows.setdefault(mark, len(self._rows))
        height, width = self._values.shape
        if len(self._rows) > height or len(self._columns) > width:
            wider: np.ndarray = np.full((min(2 * len(self._rows), most), len(self._columns)), np.nan)
            kept = min(height, most)
            wider[:kept, :width] = self._values[:kept]
            self._values = wider
        own = [i for i, mark in enumerate(rows) if mark in self._rows]
        places = [self._rows[rows[i]] for i in own], [self._columns[mark] for mark in columns]
        self._values[np.ix_(*places)] = values[own]

    def write(self, path: Path) -> None:
        """Keep the table in a file."""
        arrays = {"values": self._values[: len(self._rows), : len(self._columns)]}
        for name, marks in (
            ("settings", [self._settings.encode()]),
            ("rows", self._rows),
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


def mark_all(series: Sequence[Any]) -> list[bytes]:
    """A hash of each of ``series``; none at all of bare arrays, which are not kept."""
    return [mark_of(item) for item in series if isinstance(item, Signals)]


def mark_of(item: Signals) -> bytes:
    """A hash of all in ``item`` that decides its distances."""
    digest = hashlib.sha256(repr((item.channels, item.values.shape)).encode())
    for part in (item.values, np.asarray(item.mask), np.asarray(item.present)):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.digest()[:_BYTES]
