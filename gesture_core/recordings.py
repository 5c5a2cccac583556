"""`Recording`: what sensors and other devices give instead of people, channels over time; and its times."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any, ClassVar

import numpy as np

from gesture_core.channel_names import grouped, is_channel, numbered, per_second_of, time_scale, unit_of_time
from gesture_core.errors import SignalError

_SLOWEST, _UNSAID = 60.0, 2.0
"""Seconds from sample to sample: a movement is over by then, or these are no seconds; and the same of times
whose unit nobody says."""
_LATEST = 1e11
"""Seconds of a date: the year 5138."""
_DATES = 9.4e8, 4.1e9
"""Seconds since 1970 of the years 2000 to 2100: nothing else has such numbers, in whatever unit."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Channels over time, of one device or several in step.

    Attributes
    ----------
    values : (T, D) float32
        In the unit of each channel; NaN where a sample is missing.
    times : (T,) float64
        Seconds, never decreasing; steps and gaps may be of any length.
    channels : tuple of D str
        ``group/name``, or a name alone for a channel that is a group by itself; each once. A unit stands in
        brackets at the end: ``acc/x[g]``.
    source : str
        The input, as the user named it.
    provenance : mapping
        What made it: reader, notes, what was assumed; as in `PoseSequence`.

    Raises
    ------
    SignalError
        E_SIGNAL_SHAPE, E_SIGNAL_TIMES, E_SIGNAL_CHANNELS for two channels of one name, E_SIGNAL_VALUE for
        infinite values.

    Examples
    --------
    >>> import numpy as np
    >>> recording = Recording(np.zeros((3, 2)), np.arange(3) / 50, ("acc/x[g]", "acc/y[g]"))
    >>> len(recording), recording.frames_with_pose
    (3, 3)
    """

    values: np.ndarray
    times: np.ndarray
    channels: tuple[str, ...]
    source: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)
    person: ClassVar[int] = 0
    box: ClassVar[tuple[float, ...]] = ()

    def __post_init__(self) -> None:
        values = np.array(np.ma.filled(np.ma.asarray(self.values, np.float64), np.nan), np.float32)
        times = np.array(self.times, np.float64)
        if values.ndim != 2 or values.shape != (len(times), len(self.channels)) or 0 in values.shape:
            raise SignalError(
                f"values have shape {values.shape} beside {np.shape(times)} times and "
                f"{len(self.channels)} channels",
                subject=self.source,
                remedy="(T, D) values with T times, neither of them 0",
                code="E_SIGNAL_SHAPE",
            )
        if twice := [name for name, count in Counter(self.channels).items() if count > 1]:
            cause = f"has two channels called {twice[0]}"
            raise SignalError(cause, subject=self.source, remedy="another name", code="E_SIGNAL_CHANNELS")
        if np.isinf(values).any():
            bad = self.channels[int(np.isinf(values).any(axis=0).argmax())]
            raise SignalError(
                f"channel {bad} holds infinity", subject=self.source, remedy="NaN where a sample is missing",
                code="E_SIGNAL_VALUE",
            )  # fmt: skip
        back = np.flatnonzero(~(np.diff(times) >= 0))
        if len(back) or not np.isfinite(times).all():
            cause = f"time runs backwards after sample {back[0] + 1}" if len(back) else "a time is not finite"
            raise SignalError(
                cause, subject=self.source, remedy="samples in the order of their times",
                code="E_SIGNAL_TIMES",
            )  # fmt: skip
        values.flags.writeable = times.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "channels", tuple(self.channels))

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        span = self.times[-1] - self.times[0]
        return (
            f"Recording({self.source!r}, {len(self)} samples of {len(self.channels)} channels, {span:.2f} s)"
        )

    def part(self, samples: slice) -> Recording:
        """The same recording, of these samples alone."""
        return replace(self, values=self.values[samples], times=self.times[samples])

    @property
    def seen(self) -> np.ndarray:
        """(T, D) bool: the sample is there."""
        return np.asarray(~np.isnan(self.values))

    @property
    def frames_with_pose(self) -> int:
        """Samples in which any channel has a value: what a `PoseSequence` calls so."""
        return int(self.seen.any(axis=1).sum())


def seconds(values: np.ndarray, name: str, source: str, per_second: float = 0.0) -> np.ndarray:
    """Times in seconds, of a column called ``name``; E_SIGNAL_TIMES where they can be none.

    Parameters
    ----------
    values : (T,) array
        Without a unit in the name, dates of this century say theirs by their size.
    per_second : float
        Units in a second; 0 where the name says it, or they are seconds.
    """
    times = np.asarray(values, np.float64)
    said = per_second or unit_of_time(name)
    scale = per_second or per_second_of(name)
    first = abs(float(times[0])) if len(times) else 0.0
    if not said:
        dates = [unit for unit in (1.0, 1e3, 1e6, 1e9) if _DATES[0] < first / unit < _DATES[1]]
        scale = dates[0] if dates else scale
        said = bool(dates)
    remedy = "the unit in the name of the column of times, such as time_ms, or --set series.per_second=1000"
    if first / scale > _LATEST:
        raise SignalError(
            f"its times begin at {first / scale:g} s, which is no date: they are of another unit",
            subject=source, remedy=remedy, code="E_SIGNAL_TIMES",
        )  # fmt: skip
    times = times / scale
    if len(times) > 1 and not np.ptp(times):
        raise SignalError(
            f"all its {len(times)} times are the same", subject=source, remedy="a column of times that go on",
            code="E_SIGNAL_TIMES",
        )  # fmt: skip
    usual = float(np.median(np.abs(np.diff(times)))) if len(times) > 1 else 0.0
    if usual > (_SLOWEST if said else _UNSAID):
        cause = f"its samples are {usual:g} s apart, which shows no movement"
        raise SignalError(cause, subject=source, remedy=remedy, code="E_SIGNAL_TIMES")
    return times


def dated(stamps: np.ndarray) -> np.ndarray:
    """Seconds since 2000 of dates (datetime64), to the microsecond; NaN where there is none."""
    exact = stamps.astype("datetime64[ns]")
    since: np.ndarray = (exact - np.datetime64("2000-01-01", "ns")).astype(np.float64) / 1e9
    return np.where(np.isnat(exact), np.nan, since)


def as_recording(item: Any, source: str, fps: float) -> Recording:
    """A `Recording` of an array or a data frame.

    Parameters
    ----------
    item : (T,) or (T, D) array, or a data frame
        NaN where a sample is missing. Of a frame (of pandas, polars or PyArrow, or any with ``columns``) a
        column of times says when; otherwise they are the numbers of the rows over ``fps``.
    source : str
        What errors call it.
    fps : float

    Raises
    ------
    SignalError
        Those of `Recording`, and E_DTYPE for what holds no numbers.
    """
    names = columns_of(item)
    if names is None:
        values = _numbers(item, source, "the array")
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2:
            cause = f"an array of shape {values.shape}"
            raise SignalError(cause, subject=source, remedy="(T, D)", code="E_SIGNAL_SHAPE")
        return Recording(values, np.arange(len(values)) / fps, numbered(values.shape[1]), source)
    clock = next((name for name in names if time_scale(str(name)) is not None), None)
    others = [name for name in names if name != clock and not _is_channel(str(name), item[name])]
    if others and len(others) + (clock is not None) < len(names):
        warnings.warn(
            f"left out, as their names say that they count or label: {', '.join(map(str, others))}; "
            "rename what is a channel",
            stacklevel=2,
        )
        names = [name for name in names if name not in others]
    columns = {str(name): _numbers(item[name], source, f"column {name!r}") for name in names}
    times = np.arange(len(next(iter(columns.values()), ()))) / fps
    if clock is not None:
        times = seconds(columns.pop(str(clock)), str(clock), source)
    elif (index := getattr(item, "index", None)) is not None and getattr(index, "dtype", None) is not None:
        times = _by_index(_moments(np.asarray(index)), times, source)
    if not columns:
        raise SignalError("holds no channel", subject=source, code="E_SIGNAL_SHAPE")
    return Recording(
        np.stack(list(columns.values()), axis=1), times - times[:1], grouped(list(columns)), source
    )


def _is_channel(name: str, column: Any) -> bool:
    """The same of a column of a frame, where text that is called a label is no channel either."""
    values = np.asarray(column)
    return is_channel(name, values if values.dtype.kind in "fiub" else np.zeros(0))


def _by_index(index: np.ndarray, otherwise: np.ndarray, source: str) -> np.ndarray:
    """The times that the index of a frame tells, in dates, durations or fractions of seconds."""
    if index.dtype.kind == "M":
        return dated(index)
    if index.dtype.kind == "m":
        return index / np.timedelta64(1, "s")
    return seconds(index, "", source) if index.dtype.kind == "f" else otherwise


def _moments(values: np.ndarray) -> np.ndarray:
    """Dates with a time zone, which are objects in NumPy, as dates of UTC; other values as they are."""
    if values.dtype.kind != "O" or not all(isinstance(value, datetime) for value in values.flat):
        return values
    plain = [value.astimezone(UTC).replace(tzinfo=None) if value.tzinfo else value for value in values.flat]
    return np.array(plain, "datetime64[us]")


def columns_of(item: Any) -> list[Any] | None:
    """The names of a frame's columns; None for what is no frame."""
    names = getattr(item, "column_names", None)  # of PyArrow, whose columns are arrays
    names = getattr(item, "columns", None) if names is None else names
    return None if names is None else list(names)


def _numbers(item: Any, source: str, what: str) -> np.ndarray:
    values: np.ndarray = np.ma.asarray(item) if isinstance(item, np.ma.MaskedArray) else np.asarray(item)
    values = _moments(values)
    if values.dtype.kind == "M":
        return dated(values)
    if values.dtype.kind not in "fiub":
        raise SignalError(
            f"{what} holds {values.dtype}, expected real numbers",
            subject=source,
            remedy="numbers alone, NaN where a sample is missing",
            code="E_DTYPE",
        )
    return values
