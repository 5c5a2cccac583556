"""What columns of a log are, by their names as devices write them: times, units, groups, no channels.

A group is what stands in the name of a channel before a ``/``: channels that share a unit, such as the
axes of an accelerometer.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

_UNIT = re.compile(r"\s*[\[(]\s*(?P<unit>(?:[^\[\]()]|\([^()]*\)){1,20}?)\s*[\])]\s*$")
_BETWEEN = r"[\s_.:-]"
_AXIS = re.compile(rf"(?P<stem>.*?){_BETWEEN}*(?P<axis>[xyzwXYZW])")
_INNER = re.compile(rf"(?P<stem>|.*?{_BETWEEN}+)(?P<axis>[xyzwXYZW])(?:{_BETWEEN}+(?P<rest>.+))?")
_QUATERNION = re.compile(rf"(?P<stem>.*?(?:quat|quaternion|\bq|_q)){_BETWEEN}*q?(?P<axis>[0-4])", re.I)
_AXES = "axis"
"""The group of channels that are called x, y and z alone."""
_ODD = re.compile(r"[\s/.@\[\]]+")
_TIME = re.compile(
    r"(?:(?:sample|sensor|system|unix)[\s_]?)?(?:t|time|times|timestamps?|seconds?|secs?|epoch|elapsed)"
    r"|millis|micros|seconds_elapsed|elapsed[\s_]time",
    re.I,
)
_PER_SECOND = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e3, "msec": 1e3, "millis": 1e3,
    "us": 1e6, "µs": 1e6, "micros": 1e6, "ns": 1e9, "nanos": 1e9,
}  # fmt: skip
_NUMBER = re.compile(
    r"|index|unnamed|indexlevel|(?:sub)?frames?(?:no|number|nr|id|index)?"
    r"|(?:logging)?samples?(?:no|number|nr|id|index)?|(?:packet)?counter|seq|sequence(?:no|number)?|row|id|line"
    r"|labels?|(?:class|activity|gesture|subject|participant|user|person|session|trial)(?:s?id)?|target"
)
"""What counts or labels, where it is a whole number; an index ascends besides, or it is a finger."""
_NO_CHANNEL = re.compile(
    r"lat|lon|lng|(?:location|gps|geo)?(?:latitude|longitude|altitude)|(?:location|gps)(?![xyz]$).*"
    r"|.*timestamp.*|.*sampletimefine|(?:.*[^a-z])?epoch|.*elapsed.*|dates?|datetime|.*uptime"
)


def time_scale(name: str) -> float | None:
    """Units in a second of a column of times that is called ``name``; None where it is none.

    Examples
    --------
    >>> [time_scale(name) for name in ("time", "Timestamp [ms]", "time_us", "temperature")]
    [1.0, 1000.0, 1000000.0, None]
    """
    return _PER_SECOND.get(unit_of_time(name) or "s") if _time(name) else None


def unit_of_time(name: str) -> str:
    """The unit of time that a name says, empty where it says none."""
    unit, word = _UNIT.search(name), _time(name)
    said = unit["unit"].casefold() if unit else word[1] if word else ""
    return said if said in _PER_SECOND else ""


def per_second_of(name: str) -> float:
    """Units in a second of a column of times; 1 where its name says none."""
    return _PER_SECOND[unit_of_time(name) or "s"]


def _time(name: str) -> tuple[str, str] | None:
    """The word for time in a name and the unit behind it; None where there is no such word."""
    unit, text = _UNIT.search(name), name.strip().casefold()
    if unit:
        text, said = name[: unit.start()].strip().casefold(), unit["unit"].casefold()
    else:
        stem, _, tail = text.rpartition("_")
        text, said = (stem, tail) if stem and tail in _PER_SECOND else (text, "")
    said = said or {"millis": "ms", "micros": "us"}.get(text, "")
    return (text, said) if _TIME.fullmatch(text) else None


def is_channel(name: str, values: np.ndarray) -> bool:
    """Whether a column may be a movement: it neither counts rows, nor tells times, labels, people or places.

    Examples
    --------
    >>> import numpy as np
    >>> [is_channel(name, np.arange(9)) for name in ("acc_x", "frame", "Unnamed: 0", "index", "timestamp_2")]
    [True, False, False, False, False]
    >>> [is_channel(name, np.sin(np.arange(9))) for name in ("sample", "index", "location_x", "latitude")]
    [True, True, True, False]
    """
    unit = _UNIT.search(name)
    bare = re.sub(r"[\s_.:#-]+", "", (name[: unit.start()] if unit else name).casefold())
    word = bare.rstrip("0123456789")
    if time_scale(name) is not None or _NO_CHANNEL.fullmatch(word):
        return False
    if not _NUMBER.fullmatch(word) or (bare and not word):  # columns may have numbers for names
        return True
    seen = values[np.isfinite(values)]
    return bool((seen % 1 != 0).any() or (word == "index" and (np.diff(seen) <= 0).any()))


def grouped(names: Sequence[str], groups: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """Channels for columns that are called ``names``.

    Names that differ in a letter x, y, z or w alone, last or by itself, are one group, and so are the four
    numbers of a quaternion; any other channel is one by itself. A name with a ``/`` says its group.
    ``groups`` are those of channels by the name of their column.

    Examples
    --------
    >>> grouped(["accX", "accY", "gyro_z [deg/s]", "gyro_x [deg/s]", "force"])
    ('acc/x', 'acc/y', 'gyro/z[deg/s]', 'gyro/x[deg/s]', 'force')
    >>> grouped(["x-axis (g)", "y-axis (g)", "gyro_x_dps", "gyro_y_dps"])
    ('axis/x[g]', 'axis/y[g]', 'gyro/x[dps]', 'gyro/y[dps]')
    """
    found = [_UNIT.search(name) for name in names]
    bare = [name[: unit.start()] if unit else name for name, unit in zip(names, found, strict=True)]
    units = [unit["unit"] if unit else "" for unit in found]
    own = _alike([_axis(name.strip()) for name in bare])
    channels = []
    for name, plain, axis, unit in zip(names, bare, own, units, strict=True):
        group, slash, rest = plain.partition("/")
        if name in (groups or {}):
            group, slash, rest = (groups or {})[name], "/", plain
        elif not slash and axis:
            group, slash, rest = axis[0], "/", axis[1]
            unit = unit or axis[2]
        parts = [_ODD.sub("_", part.strip()) for part in (group, rest)]
        channels.append(f"{parts[0]}{slash}{parts[1]}" + (f"[{_plain_unit(unit)}]" if unit else ""))
    return tuple(channels)


def _axis(name: str) -> tuple[str, str, str] | None:
    """Group, axis and unit that a name may say."""
    if found := _QUATERNION.fullmatch(name):
        return found["stem"], found["axis"], ""
    found = _AXIS.fullmatch(name)
    if found and found["stem"]:
        return found["stem"], found["axis"].lower(), ""
    found = _INNER.fullmatch(name)
    if not found:
        return None
    stem, rest = re.sub(rf"{_BETWEEN}+$", "", found["stem"]), found["rest"] or ""
    if stem and is_unit(rest):
        return stem, found["axis"].lower(), rest
    return "_".join(filter(None, (stem, rest))) or _AXES, found["axis"].lower(), ""


def _alike(axes: list[tuple[str, str, str] | None]) -> list[tuple[str, str, str] | None]:
    """Those of which another one has the same group: all four, where axes are numbered."""
    kinds = [(axis[0].casefold(), axis[1].isdigit()) if axis else None for axis in axes]
    count = Counter(kinds)
    return [
        axis if kind and count[kind] >= (4 if kind[1] else 2) else None
        for axis, kind in zip(axes, kinds, strict=True)
    ]


_UNITS = {
    "s", "ms", "us", "µs", "ns", "g", "mg", "m/s2", "m/s^2", "m/s²", "ms2", "mps2", "ms^-2", "dps", "deg/s",
    "°/s", "rad/s", "rads", "radps", "deg", "°", "rad", "ut", "µt", "gauss", "mgauss", "mm", "cm", "m", "v",
    "mv", "hz", "n", "nm", "%", "bpm", "pa", "kpa", "hpa", "c", "°c", "nounits", "unitless", "local", "a.u.",
}  # fmt: skip


def is_unit(text: str) -> bool:
    """Whether a word by itself is the unit of a sensor."""
    return re.sub(r"[\s_()\[\]]+", "", text).casefold() in _UNITS


def _plain_unit(unit: str) -> str:
    return re.sub(r"[()]", "", _ODD.sub("_", unit.strip().replace("/", "|")).replace("|", "/"))


def numbered(count: int) -> tuple[str, ...]:
    """Channels without names: one group, as nobody says that their units differ."""
    return tuple(f"channel/{number}" for number in range(1, count + 1))
