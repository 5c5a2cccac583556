"""`Recording`: what sensors and other devices give instead of people, channels over time; and its names.

Channels belong to groups that share a unit, such as the axes of an accelerometer. A group is what stands in
the name of a channel before a ``/``; `grouped` finds it in the names of columns as devices write them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from gesture_core.errors import SignalError

_UNIT = re.compile(r"\s*[\[(]\s*(?P<unit>[^\[\]()]{1,20}?)\s*[\])]\s*$")
_AXIS = re.compile(r"(?P<stem>.*?)[\s_.:-]*(?P<axis>[xyzwXYZW])")
_ODD = re.compile(r"[\s/.@\[\]]+")
_TIME = re.compile(
    r"(?:(?:sample|sensor|system|unix)[\s_]?)?(?:t|time|times|timestamps?|seconds?|secs?)", re.I
)
_PER_SECOND = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e3, "msec": 1e3, "millis": 1e3,
    "us": 1e6, "µs": 1e6, "micros": 1e6, "ns": 1e9, "nanos": 1e9,
}  # fmt: skip
_SLOWEST = 60.0
"""Seconds from sample to sample: a movement is over by then, or these are no seconds."""

_LATEST = 1e11
"""Seconds of a date: the year 5138."""


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

    @property
    def seen(self) -> np.ndarray:
        """(T, D) bool: the sample is there."""
        return np.asarray(~np.isnan(self.values))

    @property
    def frames_with_pose(self) -> int:
        """Samples in which any channel has a value: what a `PoseSequence` calls so."""
        return int(self.seen.any(axis=1).sum())


def grouped(names: Sequence[str], groups: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """Channels for columns that are called ``names``.

    Names that differ in a last letter x, y, z or w are one group; any other channel is one by itself. A name
    with a ``/`` says its group. ``groups`` are those of channels by the name of their column.

    Examples
    --------
    >>> grouped(["accX", "accY", "gyro_z [deg/s]", "gyro_x [deg/s]", "force"])
    ('acc/x', 'acc/y', 'gyro/z[deg/s]', 'gyro/x[deg/s]', 'force')
    """
    units = [_UNIT.search(name) for name in names]
    bare = [name[: unit.start()] if unit else name for name, unit in zip(names, units, strict=True)]
    axes = [_AXIS.fullmatch(name.strip()) for name in bare]
    stems = Counter(axis["stem"].casefold() for axis in axes if axis and axis["stem"])
    channels = []
    for own, name, axis, unit in zip(names, bare, axes, units, strict=True):
        group, slash, rest = name.partition("/")
        if own in (groups or {}):
            group, slash, rest = (groups or {})[own], "/", name
        elif not slash and axis and stems[axis["stem"].casefold()] > 1:
            group, slash, rest = axis["stem"], "/", axis["axis"].lower()
        plain = [_ODD.sub("_", part.strip()) for part in (group, rest)]
        channels.append(f"{plain[0]}{slash}{plain[1]}" + (f"[{_plain_unit(unit['unit'])}]" if unit else ""))
    return tuple(channels)


def _plain_unit(unit: str) -> str:
    return _ODD.sub("_", unit.replace("/", "|")).replace("|", "/")


def numbered(count: int) -> tuple[str, ...]:
    """Channels without names: one group, as nobody says that their units differ."""
    return tuple(f"channel/{number}" for number in range(1, count + 1))


def time_scale(name: str) -> float | None:
    """Units in a second of a column of times that is called ``name``; None where it is none.

    Examples
    --------
    >>> [time_scale(name) for name in ("time", "Timestamp [ms]", "time_us", "temperature")]
    [1.0, 1000.0, 1000000.0, None]
    """
    unit, text = _UNIT.search(name), name.strip().casefold()
    if unit:
        text, said = name[: unit.start()].strip().casefold(), unit["unit"].casefold()
    else:
        text, _, said = (
            text.rpartition("_")
            if "_" in text and text.rpartition("_")[2] in _PER_SECOND
            else (text, "", "s")
        )
    return _PER_SECOND.get(said) if _TIME.fullmatch(text) else None


def seconds(values: np.ndarray, per_second: float, source: str) -> np.ndarray:
    """Times in seconds since the first; E_SIGNAL_TIMES where they can be none."""
    times = np.asarray(values, np.float64)
    if len(times) and abs(float(times[0]) / per_second) > _LATEST:
        raise SignalError(
            f"its times begin at {times[0] / per_second:g} s, which is no date: they are of another unit",
            subject=source,
            remedy="the unit in the name of the column of times, such as time_ms",
            code="E_SIGNAL_TIMES",
        )
    times = (times - times[0]) / per_second if len(times) else times
    if len(times) > 1 and not times.any():
        raise SignalError(
            f"all its {len(times)} times are the same", subject=source, remedy="a column of times that go on",
            code="E_SIGNAL_TIMES",
        )  # fmt: skip
    usual = float(np.median(np.abs(np.diff(times)))) if len(times) > 1 else 0.0
    if usual > _SLOWEST:
        raise SignalError(
            f"its samples are {usual:g} s apart, which shows no movement",
            subject=source,
            remedy="the unit in the name of the column of times, such as time_ms",
            code="E_SIGNAL_TIMES",
        )
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
    columns = {str(name): _numbers(item[name], source, f"column {name!r}") for name in names}
    clocks = [name for name in columns if time_scale(name) is not None]
    for name in clocks[:1]:
        times = seconds(columns.pop(name), time_scale(name) or 1.0, source)
    if not columns:
        raise SignalError("holds no channel", subject=source, code="E_SIGNAL_SHAPE")
    values = np.stack(list(columns.values()), axis=1)
    return Recording(
        values, times if clocks else np.arange(len(values)) / fps, grouped(list(columns)), source
    )


def columns_of(item: Any) -> list[Any] | None:
    """The names of a frame's columns; None for what is no frame."""
    names = getattr(item, "column_names", None)  # of PyArrow, whose columns are arrays
    names = getattr(item, "columns", None) if names is None else names
    return None if names is None else list(names)


def _numbers(item: Any, source: str, what: str) -> np.ndarray:
    values: np.ndarray = np.ma.asarray(item) if isinstance(item, np.ma.MaskedArray) else np.asarray(item)
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
