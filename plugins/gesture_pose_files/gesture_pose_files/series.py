"""Series of channels: tables of sensors in CSV, Parquet and NumPy's files, one recording each."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path

import numpy as np

from gesture_core.errors import GestureError, KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.recordings import Recording, dated, grouped, numbered, seconds, time_scale
from gesture_pose_files.arrow_table import size_of
from gesture_pose_files.files import COPY_AGAIN, MAX_CSV_BYTES, MAX_FRAMES, head_of, open_keypoints
from gesture_pose_files.npy import MAX_FILE_BYTES, read_array
from gesture_pose_files.npz import array_in, members_of, opened
from gesture_pose_files.reader import clip_called
from gesture_pose_files.series_archives import Series, is_archive, series_in
from gesture_pose_files.series_streams import BEGAN, files_of, in_step
from gesture_pose_files.table import number_in, numbers_of, rows_of, seconds_in, split_header

_LOOKED_AT = 20
_STILL = 10
"""Samples of one value from which on a channel is noted as never changing."""
_SHOWN = 5
_MOST_CELLS = 1 << 28
SUFFIXES = (".csv", ".tsv", ".parquet", ".npy", ".npz", ".ts", ".arff")
"""Of the files that are read."""
_MAGIC = {".parquet": b"PAR1", ".npy": b"\x93NUMPY", ".npz": b"PK"}
_STORED = "channel "
"""Before the names of channels in a file that ``gesture extract`` wrote."""


@dataclass(frozen=True)
class SeriesReader:
    """Reads channels over time, of any device.

    - ``.csv``, ``.tsv`` and ``.parquet``: a row for each sample. A column of times (``time``, ``time_us``,
      ``timestamp [ms]``, or dates as ISO 8601 writes them) says when; every other column of numbers is a
      channel, its group and unit in its name (``acc_x [g]``). Columns of text are left out, with a note.
    - ``.npy`` (T,) or (T, D); ``.npz`` with one such array for each recording, or, beside an array of times,
      for each group of channels.
    - Whole collections: ``.ts`` and ``.arff`` of the UEA archive, ``_TRAIN.tsv`` and ``_TEST.tsv`` of the UCR
      archive. A series is called by its label and its number.

    Parameters
    ----------
    options : ReadOptions
        Its ``fps`` is the rate of files without times.
    time : str
        The name of the column or array of times, where it is called otherwise.
    per_second : float
        Units of that column in a second; 0 where its name says it, or they are seconds.
    groups : mapping
        The group of a channel by the name of its column, where that does not say it.
    streams : sequence of str
        A folder that holds a file of each of these names is one recording of several devices in step.
    """

    options: ReadOptions = field(default_factory=ReadOptions)
    time: str = ""
    per_second: float = 0.0
    groups: Mapping[str, str] = field(default_factory=dict)
    streams: Sequence[str] = ()
    _known: dict[tuple[Path, int, int], dict[str, Series]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if not self.per_second >= 0:
            raise ValueError(f"per_second {self.per_second} is negative")
        if not isinstance(self.groups, Mapping):
            raise TypeError(f"groups {self.groups!r} are no table of columns and groups")
        if isinstance(self.streams, str) or not all(isinstance(name, str) for name in self.streams):
            raise TypeError(f"streams {self.streams!r} are no list of names")

    def accepts(self, path: Path) -> bool:
        """Whether ``path`` holds series, by its name and first bytes."""
        suffix = path.suffix.lower()
        if path.is_dir():
            return bool(files_of(path, self.streams, SUFFIXES))
        if path.stem in self.streams and files_of(path.parent, self.streams, SUFFIXES):
            return False  # it is a part of its folder
        if is_archive(path):
            return bool(head_of(path, 1))
        if suffix in _MAGIC:
            return head_of(path, 8).startswith(_MAGIC[suffix])
        return suffix in (".csv", ".tsv") and not self.refusal(path)

    def refusal(self, path: Path) -> str:
        """Why a table holds no channels."""
        try:
            with open_keypoints(path, MAX_CSV_BYTES) as file:
                names, rows = split_header(rows_of(file, printable(path)), lambda names: None)
                first = next(rows, None)
        except KeypointError as error:
            return error.cause
        if first is None:
            return "it has no row below its header" if names else "it has no row"
        clock = self._clock(names) if names else None
        if not any(number_in(cell) is not None for place, cell in enumerate(first) if place != clock):
            return f"its first row {','.join(first)[:60]!r} holds no number"
        return ""

    def members(self, path: Path) -> list[str]:
        """The series in a collection, or the arrays of an ``.npz``; ``[""]`` for a single recording."""
        if is_archive(path):
            return list(self._archive(path))
        if path.suffix.lower() == ".npz":
            with opened(path) as archive:
                names = list(members_of(archive, path))
            return [""] if self._clock(names) is not None or len(names) < 2 else names
        return [""]

    def read(self, path: Path, member: str = "") -> list[Recording]:
        """The recording."""
        source = printable(path)
        if path.is_dir() and not member:
            files = files_of(path, self.streams, SUFFIXES)
            if not files:
                cause = f"holds no file for each of {', '.join(self.streams) or 'no streams'}"
                raise KeypointError(cause, subject=source, code="E_KEYPOINTS_FORMAT")
            return [in_step({name: self.read(file)[0] for name, file in files.items()}, source)]
        if is_archive(path):
            one = clip_called(member, self._archive(path), path, "series")
            return [self._recording(one.values, numbered(one.values.shape[1]), None, source)]
        suffix = path.suffix.lower()
        if suffix == ".npz":
            return [self._zipped(path, member, source)]
        if member:
            cause = f"is one recording, it has no member {member!r}"
            raise KeypointError(cause, subject=source, code="E_KEYPOINTS_MEMBER")
        if suffix == ".npy":
            with open_keypoints(path, MAX_FILE_BYTES) as file:
                return [self._array(read_array(file, source), source)]
        return [self._parquet(path, source) if suffix == ".parquet" else self._text(path, source)]

    def _archive(self, path: Path) -> dict[str, Series]:
        facts = path.stat()
        key = (path, facts.st_mtime_ns, facts.st_size)
        if key not in self._known:
            found = series_in(path)
            self._known.clear()
            self._known[key] = found
        return self._known[key]

    def _clock(self, names: Sequence[str]) -> int | None:
        """Which of the columns is the time, None where none is."""
        if self.time:
            return next((place for place, name in enumerate(names) if name.strip() == self.time), None)
        return next((place for place, name in enumerate(names) if time_scale(name) is not None), None)

    def _recording(
        self,
        values: np.ndarray,
        channels: tuple[str, ...],
        clock: tuple[str, np.ndarray] | None,
        source: str,
        notes: Sequence[str] = (),
    ) -> Recording:
        provenance = {"reader": "series"}
        if clock is None:
            if self.time:
                raise KeypointError(
                    f"has no column {self.time!r}", subject=source, remedy="another --set series.time=…",
                    code="E_KEYPOINTS_TIMES",
                )  # fmt: skip
            times = np.arange(len(values)) / self.options.rate
            provenance["assumed"] = self.options.assumed(fps=self.options.rate)
        else:
            name, given = clock
            if np.isnan(given).any():
                row = int(np.isnan(given).argmax()) + 1
                raise KeypointError(f"has no time in row {row}", subject=source, code="E_KEYPOINTS_TIMES")
            scale = self.per_second or time_scale(name) or 1.0
            times = seconds(given, scale, source)
            provenance[BEGAN] = repr(float(given[0]) / scale)
        notes = [*notes, *_odd(values, channels)]
        if notes:
            provenance["notes"] = "; ".join(notes)
        return Recording(values, times, channels, source, provenance)

    def _table(
        self, columns: Mapping[str, np.ndarray], source: str, left_out: Sequence[str], named: bool
    ) -> Recording:
        """A recording from named columns, one of which may be the time."""
        names = list(columns)
        clock = self._clock(names) if named else None
        rest = [name for place, name in enumerate(names) if place != clock]
        if not rest:
            raise KeypointError("has no column of numbers", subject=source, code="E_KEYPOINTS_FORMAT")
        said = None if clock is None else (names[clock], columns[names[clock]])
        channels = grouped(rest, self.groups) if named else numbered(len(rest))
        notes = [f"left out, as they hold text: {', '.join(left_out)}"] if left_out else []
        values = np.stack([columns[name] for name in rest], axis=1)
        if not named and len(values) > 2 and (np.diff(values[:, 0]) > 0).all():
            notes.append("its first column only ascends: a header that calls it time makes it one")
        return self._recording(values, channels, said, source, notes)

    def _text(self, path: Path, source: str) -> Recording:
        with open_keypoints(path, MAX_CSV_BYTES) as file:
            names, rows = split_header(rows_of(file, source), lambda names: None)
            first = list(islice(rows, _LOOKED_AT))
            if not first:
                raise KeypointError("holds no row", subject=source, code="E_KEYPOINTS_EMPTY")
            width = len(first[0])
            called = [name.strip() or f"column {n + 1}" for n, name in enumerate(names or [""] * width)]
            if len(called) != width:
                cause = f"its header has {len(called)} cells, its first row {width}"
                raise KeypointError(cause, subject=source, code="E_KEYPOINTS_FORMAT")
            text = [
                column
                for column in range(width)
                if all(number_in(row[column]) is None for row in first if len(row) == width)
            ]
            clock = self._clock(called) if names else None
            if width * len(first) > _MOST_CELLS:
                raise KeypointError("is too wide", subject=source, code="E_KEYPOINTS_LIMIT")
            wanted = [column for column in range(width) if column not in text]
            table, rest = numbers_of(chain(first, rows), width, wanted, called, MAX_FRAMES, source)
        columns = {called[column]: table[:, column] for column in wanted}
        if len(columns) < len(wanted):
            twice = next(name for name in called if called.count(name) > 1)
            raise KeypointError(f"has two columns {twice!r}", subject=source, code="E_KEYPOINTS_FORMAT")
        if clock in text:
            place = text.index(clock)
            columns = {called[clock]: _dates([row[place] for row in rest], source), **columns}
            text.remove(clock)
        return self._table(columns, source, [called[column] for column in text], names is not None)

    def _array(self, values: np.ndarray, source: str) -> Recording:
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or 0 in values.shape:
            raise KeypointError(
                f"an array of shape {values.shape} is no series of channels",
                subject=source,
                remedy="(T, D), or a file for each recording",
                code="E_KEYPOINTS_SHAPE",
            )
        return self._recording(values, numbered(values.shape[1]), None, source)

    def _zipped(self, path: Path, member: str, source: str) -> Recording:
        with opened(path) as archive:
            infos: dict[str, zipfile.ZipInfo] = members_of(archive, path)
            clock = self._clock(list(infos))
            if clock is None:
                return self._array(
                    array_in(archive, clip_called(member, infos, path, "arrays"), source), source
                )
            arrays = {name: array_in(archive, info, source) for name, info in infos.items()}
        name = list(arrays)[clock]
        times, columns = arrays.pop(name), dict[str, np.ndarray]()
        for group, array in arrays.items():
            array = array[:, None] if array.ndim == 1 else array
            if array.ndim != 2 or times.ndim != 1 or len(array) != len(times):
                raise KeypointError(
                    f"its array {group} has shape {array.shape} beside {times.shape} times",
                    subject=source,
                    remedy="(T,) or (T, D) arrays beside T times",
                    code="E_KEYPOINTS_SHAPE",
                )
            ends = "xyz" if array.shape[1] in (2, 3) else [str(n + 1) for n in range(array.shape[1])]
            columns |= {
                f"{group}/{end}" if array.shape[1] > 1 else group: column
                for end, column in zip(ends, array.T, strict=False)
            }
        return self._table({name: times.astype(np.float64), **columns}, source, [], True)

    def _parquet(self, path: Path, source: str) -> Recording:
        import pyarrow as pa
        import pyarrow.parquet as pq

        with open_keypoints(path, MAX_FILE_BYTES) as file:
            try:
                parquet = pq.ParquetFile(file)
                rows, width = parquet.metadata.num_rows, parquet.metadata.num_columns
                if rows > MAX_FRAMES or size_of(parquet.metadata)[1] > _MOST_CELLS:
                    cause = f"holds {rows} rows of {width} columns, more than are read"
                    raise KeypointError(cause, subject=source, remedy="split it", code="E_KEYPOINTS_LIMIT")
                schema = parquet.schema_arrow
                kinds = {name: schema.field(name).type for name in schema.names}
                table = parquet.read([name for name, kind in kinds.items() if pa.types.is_primitive(kind)])
                columns: dict[str, np.ndarray] = {}
                for name in table.column_names:
                    kind, column = kinds[name], table.column(name)
                    if pa.types.is_timestamp(kind):
                        columns[name] = dated(column.to_numpy())
                    elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind):
                        columns[name.removeprefix(_STORED)] = column.to_numpy().astype(np.float64)
            except GestureError:
                raise
            except Exception as error:
                raise KeypointError(
                    f"is no whole Parquet file: {error}", subject=source, remedy=COPY_AGAIN,
                    code="E_KEYPOINTS_BROKEN",
                ) from error  # fmt: skip
        own = any(name.startswith(_STORED) for name in kinds)
        if own:
            columns.pop("person", None)
        left_out = [name for name in kinds if name.removeprefix(_STORED) not in columns and name != "person"]
        return self._table(columns, source, left_out, True)


def _odd(values: np.ndarray, channels: Sequence[str]) -> list[str]:
    """Clauses about channels that hold nothing, or one value all the time, as those of a dead sensor do."""
    there = np.isfinite(values)
    low, high = np.where(there, values, np.inf).min(axis=0), np.where(there, values, -np.inf).max(axis=0)
    dead = (low == high) & (there.sum(axis=0) >= _STILL)
    said = (("holds no value in", ~there.any(axis=0)), ("holds one value alone in", dead))
    return [
        f"{what} {', '.join(np.array(channels)[which][:_SHOWN])}" + (", …" if which.sum() > _SHOWN else "")
        for what, which in said
        if which.any()
    ]


def _dates(cells: Sequence[str], source: str) -> np.ndarray:
    """Seconds of dates as ISO 8601 writes them."""
    times = np.array([seconds_in(cell) for cell in cells], np.float64)
    if np.isnan(times).any():
        raise KeypointError(
            f"its times, such as {cells[0].strip()[:30]!r}, are neither numbers nor dates",
            subject=source,
            remedy="seconds, or dates such as 2024-05-01T12:00:00.250",
            code="E_KEYPOINTS_TIMES",
        )
    return times
