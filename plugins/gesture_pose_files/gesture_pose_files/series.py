"""Series of channels: tables of sensors in CSV, Parquet and NumPy's files, one recording each."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gesture_core.channel_names import grouped, is_channel, numbered, time_scale, unit_of_time
from gesture_core.errors import GestureError, KeypointError
from gesture_core.files import printable
from gesture_core.plugin.reading import ReadOptions
from gesture_core.recordings import Recording, dated, seconds
from gesture_pose_files.arrow_table import size_of
from gesture_pose_files.files import COPY_AGAIN, MAX_FRAMES, head_of, open_keypoints
from gesture_pose_files.layout import check_clock
from gesture_pose_files.npy import MAX_FILE_BYTES, read_array
from gesture_pose_files.npz import array_in, members_of, opened
from gesture_pose_files.reader import clip_called
from gesture_pose_files.series_archives import Series, is_archive, series_in
from gesture_pose_files.series_streams import BEGAN, files_of, in_step
from gesture_pose_files.series_table import lacking, read_text
from gesture_pose_files.series_wave import samples_in

_STILL = 10
"""Samples of one value from which on a channel is noted as never changing."""
_SHOWN = 5
_SLOW, _PAUSE = 0.5, 0.5
"""Seconds from sample to sample, and without any, that are noted."""
_MOST_CELLS = 1 << 28
TEXTS = (".csv", ".tsv", ".txt", ".dat")
SUFFIXES = (*TEXTS, ".parquet", ".npy", ".npz", ".wav", ".ts", ".arff")
"""Of the files that are read."""
_MAGIC = {".parquet": b"PAR1", ".npy": b"\x93NUMPY", ".npz": b"PK", ".wav": b"RIFF"}
_STORED = "channel "
"""Before the names of channels in a file that ``gesture extract`` wrote."""


@dataclass(frozen=True)
class SeriesReader:
    """Reads channels over time, of any device.

    - ``.csv``, ``.tsv``, ``.txt``, ``.dat`` and ``.parquet``: a row for each sample. A column of times
      (``time``, ``time_us``, ``timestamp [ms]``, or dates) says when; every other column of numbers is a
      channel, its group and unit in its name (``acc_x [g]``). Columns of text, and those that count or label
      by their names, are left out, with a note; so are lines above the table.
    - ``.npy`` (T,) or (T, D); ``.npz`` with one such array for each recording, or, beside an array of times,
      for each group of channels.
    - ``.wav``: samples of PCM, each -1 to 1, at the rate that it says.
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
        The group of a channel by the name of its column, where that does not say it, or says that it is none.
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
        if files_of(path.parent, self.streams, SUFFIXES):
            return False  # it is a part of its folder
        if is_archive(path):
            return bool(head_of(path, 1))
        if suffix in _MAGIC:
            return head_of(path, 8).startswith(_MAGIC[suffix])
        return suffix in TEXTS and not self.refusal(path)

    def refusal(self, path: Path) -> str:
        """Why a table holds no channels."""
        return lacking(path, self._clock)

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
        if suffix == ".wav":
            values, rate, notes = samples_in(path)
            return [self._recording(values, numbered(values.shape[1]), None, source, notes, rate)]
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
        rate: float = 0.0,
    ) -> Recording:
        provenance = {"reader": "series"}
        if clock is None:
            if self.time:
                raise KeypointError(
                    f"has no column {self.time!r}", subject=source, remedy="another --set series.time=…",
                    code="E_KEYPOINTS_TIMES",
                )  # fmt: skip
            times = np.arange(len(values)) / (rate or self.options.rate)
            if not rate:
                provenance["assumed"] = self.options.assumed(fps=self.options.rate)
        else:
            name, given = clock
            if np.isnan(given).any():
                row = int(np.isnan(given).argmax()) + 1
                raise KeypointError(f"has no time in row {row}", subject=source, code="E_KEYPOINTS_TIMES")
            times = seconds(given, name, source, self.per_second)
            provenance[BEGAN] = repr(float(times[0]))
            times = times - times[0]
            check_clock(times, source, "samples")
        notes = [*notes, *_odd(values, channels), *_odd_times(times), *_odd_shape(values)]
        if notes:
            provenance["notes"] = "; ".join(notes)
        return Recording(values, times, channels, source, provenance)

    def _table(
        self,
        columns: Mapping[str, np.ndarray],
        source: str,
        left_out: Sequence[str],
        named: bool,
        clock: str | None = None,
        rate: float = 0.0,
        notes: Sequence[str] = (),
    ) -> Recording:
        """A recording from named columns, one of which, ``clock``, may be the time."""
        other = [name for name in columns if name != clock and self._no_channel(name, columns[name], named)]
        rising = [name for name, one in columns.items() if _rises(one)]
        if clock is None and not rate:
            clock = next((name for name in other if name in rising and unit_of_time(name)), None)
            other = [name for name in other if name != clock]
        rest = [name for name in columns if name != clock and name not in other]
        if not rest:
            raise KeypointError(
                "has no column of numbers" + (f" but {', '.join(other)}" if other else ""),
                subject=source, code="E_KEYPOINTS_FORMAT",
            )  # fmt: skip
        said = None if clock is None else (clock, columns[clock])
        channels = grouped(rest, self.groups) if named else numbered(len(rest))
        notes = list(notes)
        if left_out:
            notes.append(f"left out, as they hold text: {', '.join(left_out)}")
        if other:
            notes.append(f"left out, as they count or label: {', '.join(other)} (series.groups keeps them)")
        values = np.stack([columns[name] for name in rest], axis=1)
        times = [name for name in rising if (np.diff(columns[name]) != 1).any()]
        if clock is None and not rate and len(values) >= _STILL and times:
            notes.append(
                f"{times[0]} only ascends: if it is the time, --set series.time={times[0]!r}, "
                f"without which the samples come at {self.options.rate:g} a second"
            )
        return self._recording(values, channels, said, source, notes, rate)

    def _no_channel(self, name: str, values: np.ndarray, named: bool) -> bool:
        """Whether a column counts or labels.

        One without a name among ``named`` ones is an index where it ascends in whole numbers; without any
        names, where it is as even as the rows.
        """
        if name in self.groups:
            return False
        if name.startswith("column ") and len(values) > 1:
            return not is_channel("index", values) if named else bool((np.diff(values) == 1).all())
        return not is_channel(name, values)

    def _text(self, path: Path, source: str) -> Recording:
        table = read_text(path, self._clock)
        return self._table(
            table.columns, source, table.left_out, table.named, table.clock, table.rate, table.notes
        )

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
        return self._table({name: times.astype(np.float64), **columns}, source, [], True, name)

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
                index = [
                    n for n in kinds if n.startswith("__index_level_") and pa.types.is_timestamp(kinds[n])
                ]
                table = parquet.read([name for name, kind in kinds.items() if pa.types.is_primitive(kind)])
                columns: dict[str, np.ndarray] = {}
                for name in table.column_names:
                    kind, column = kinds[name], table.column(name)
                    if pa.types.is_timestamp(kind):
                        columns["time" if name in index else name] = dated(column.to_numpy())
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
        left_out = [
            name
            for name in kinds
            if name.removeprefix(_STORED) not in columns and name not in ("person", *index)
        ]
        clock = self._clock(list(columns))
        return self._table(columns, source, left_out, True, None if clock is None else list(columns)[clock])


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


def _rises(values: np.ndarray) -> bool:
    return len(values) > 1 and bool(np.isfinite(values).all() and (np.diff(values) > 0).all())


def _odd_times(times: np.ndarray) -> list[str]:
    """Clauses about times that are far apart, or that several samples share."""
    steps = np.diff(times)
    if not (steps > 0).any():
        return []
    usual, shared, longest = float(np.median(steps[steps > 0])), int((steps == 0).sum()), float(steps.max())
    notes = [f"its samples are {usual:g} s apart"] if usual >= _SLOW else []
    if shared > len(steps) / 10:
        notes.append(f"{shared} samples have the time of the one before")
    if longest > max(_PAUSE, 5 * usual):
        notes.append(f"no sample for {longest:.3g} s after {times[int(steps.argmax())]:.3g} s")
    return notes


def _odd_shape(values: np.ndarray) -> list[str]:
    """A clause about what may have its channels first."""
    samples, channels = values.shape
    few = samples * 4 <= channels and samples < _STILL
    return [f"{samples} samples of {channels} channels: if each row is one, transpose it"] if few else []
