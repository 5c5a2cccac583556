"""Several streams of one recording, in step: channels of all of them at the times of the first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gesture_core.errors import KeypointError
from gesture_core.recordings import Recording

BEGAN = "began"
"""In the provenance of a stream: its first time on its own clock, in seconds."""


def files_of(folder: Path, streams: Sequence[str], suffixes: Sequence[str]) -> dict[str, Path]:
    """The file of each stream in a folder that has one of all of them; empty where it has not."""
    if not streams or not folder.is_dir():
        return {}
    found = {path.stem: path for path in sorted(folder.iterdir()) if path.suffix.lower() in suffixes}
    return {name: found[name] for name in streams} if set(streams) <= found.keys() else {}


def in_step(parts: Mapping[str, Recording], source: str) -> Recording:
    """One recording of several, from the moment when all have begun to the first end.

    Their clocks must be one: seconds of any origin that is the same for all. Streams without times all begin
    together. The first stream says when; the others are interpolated, and have nothing where they have gaps.
    """
    clocks = {name: BEGAN in part.provenance for name, part in parts.items()}
    if len(set(clocks.values())) > 1:
        without = [name for name, there in clocks.items() if not there]
        raise KeypointError(
            f"its stream {without[0]} has no times, and others have",
            subject=source,
            remedy="a column of times on one clock in each stream",
            code="E_KEYPOINTS_TIMES",
        )
    times = {name: part.times + float(part.provenance.get(BEGAN, 0)) for name, part in parts.items()}
    start, end = max(one[0] for one in times.values()), min(one[-1] for one in times.values())
    first = next(iter(parts))
    common = times[first][(times[first] >= start) & (times[first] <= end)]
    if len(common) < 2:
        raise KeypointError(
            "its streams have no time in common",
            subject=source,
            remedy="times on one clock in each stream",
            code="E_KEYPOINTS_TIMES",
        )
    values, channels = [], list[str]()
    for name, part in parts.items():
        values.append(np.stack([_at(common, times[name], column) for column in part.values.T], axis=1))
        channels += [_of_stream(one, name) for one in part.channels]
    facts = {key: value for part in parts.values() for key, value in part.provenance.items() if key != BEGAN}
    notes = [f"{name}: {p.provenance['notes']}" for name, p in parts.items() if "notes" in p.provenance]
    facts |= {"notes": "; ".join(notes)} if notes else {}
    return Recording(np.concatenate(values, axis=1), common - common[0], tuple(channels), source, facts)


def _of_stream(channel: str, stream: str) -> str:
    """``acc@imu/x[g]`` for ``acc/x[g]``: no name of a file has such a mark."""
    group, slash, rest = channel.partition("/")
    if not slash:
        group, bracket, rest = channel.partition("[")
        slash = bracket
    return f"{group}@{stream}{slash}{rest}"


def _at(common: np.ndarray, times: np.ndarray, column: np.ndarray) -> np.ndarray:
    """A channel at other times; NaN between two samples of which one is missing."""
    there = np.isfinite(column)
    if not there.any():
        return np.full(len(common), np.nan)
    after = np.clip(np.searchsorted(times, common), 0, len(times) - 1)
    before = np.clip(after - (times[after] > common), 0, len(times) - 1)
    found: np.ndarray = np.interp(common, times[there], column[there])
    return np.where(there[before] & there[after], found, np.nan)
