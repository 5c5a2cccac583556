"""What a page shows of one decision: the query's time in both examples, and the channels that differ most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gesture_core.classify.explanation import Alignment, Explanation, contrast
from gesture_core.report.channel_names import ChannelName, ChannelNames

POINTS = 40
"""Places of the query's time that are shown, at most."""
CHANNELS = 3


def alignment_record(
    found: Explanation, start: float, starts: Mapping[str, float], names: ChannelNames
) -> dict[str, Any]:
    """An explanation as plain values, small enough for a page.

    Parameters
    ----------
    found : Explanation
    start : float
        Seconds in the input at which its preview begins.
    starts : mapping
        The same of each example by its name.
    names : ChannelNames

    Returns
    -------
    dict
        ``time``: milliseconds of the query's preview. ``near`` and ``far``: the example's name, label,
        distance, whether it was mirrored, and ``time``, its milliseconds at those of the query.
        ``channels``: name, unit, costs and values of those that differ most, the examples' at the
        query's time.
    """
    query = found.nearest.query
    shown = np.unique(np.linspace(0, len(query) - 1, min(POINTS, len(query))).round().astype(int))
    sides = {"near": found.nearest, "far": found.runner_up}
    record: dict[str, Any] = {"time": _milliseconds(query.times[shown] - start)}
    for name, side in sides.items():
        if side is not None:
            record[name] = {
                "example": side.example,
                "label": side.label,
                "distance": float(f"{side.distance:.6g}"),
                "mirrored": side.mirrored,
                "time": _milliseconds(
                    _at(query.times, side, warped_time(side))[shown]
                    - starts.get(side.example, side.signals.times[0])
                ),
            }
    curves = [curves_of(found, channel) for channel in deciding(found)[:CHANNELS]]
    record["channels"] = [_channel(one, shown, names(one.channel)) for one in curves]
    return record


def warped_time(side: Alignment) -> np.ndarray:
    """(T,) seconds of the example that lie beside each frame of the query.

    Where every body part has a warping of its own, the mean of them, each weighed by how much moves in it.
    """
    moves = np.var(side.query.values, axis=0) + np.var(side.signals.values, axis=0)
    total, weights = np.zeros(len(side.query)), 0.0
    for number, path in enumerate(side.paths):
        weight = float(moves[side.places == number].sum()) + 1e-12
        total += weight * _matched(path, side.signals.times, len(side.query))
        weights += weight
    return total / weights


def _matched(path: np.ndarray, values: np.ndarray, length: int) -> np.ndarray:
    """(length,) mean of the example's ``values`` over the frames that match each frame of the query."""
    sums = np.bincount(path[:, 0], values[path[:, 1]], length)
    return np.asarray(sums / np.bincount(path[:, 0], minlength=length))


def _at(times: np.ndarray, side: Alignment, values: np.ndarray) -> np.ndarray:
    """``values`` of a side's query at other times: the runner-up of an event may begin later, or earlier."""
    return np.asarray(np.interp(times, side.query.times, values))


@dataclass(frozen=True, eq=False)
class Curves:
    """One channel of the query and of both examples, at the query's frames, as it was compared.

    Attributes
    ----------
    channel : str
    query : (T,) array
    near, far : (T,) array or None
        Of the examples; None where it was not compared.
    near_cost, far_cost : float
    """

    channel: str
    query: np.ndarray
    near: np.ndarray | None
    far: np.ndarray | None
    near_cost: float
    far_cost: float


def deciding(found: Explanation) -> list[int]:
    """Channels that were compared, those first that count most for or against the decision."""
    used = found.nearest.used | (found.nearest if found.runner_up is None else found.runner_up).used
    return [channel for channel in contrast(found) if used[channel]]


def curves_of(found: Explanation, channel: int) -> Curves:
    """One channel at the query's time."""
    times = found.nearest.query.times
    sides: list[np.ndarray | None] = []
    costs: list[float] = []
    for side in (found.nearest, found.runner_up):
        costs.append(np.nan if side is None else float(side.costs[channel]))
        if side is None or not side.used[channel]:
            sides.append(None)
            continue
        values = _matched(side.path_of(channel), side.signals.values[:, channel], len(side.query))
        sides.append(_at(times, side, values))
    query = found.nearest.query
    return Curves(query.channels[channel], query.values[:, channel], sides[0], sides[1], costs[0], costs[1])


def _channel(curves: Curves, shown: np.ndarray, name: ChannelName) -> dict[str, Any]:
    record: dict[str, Any] = {"name": name.words, "unit": name.unit}
    for which, values in (("query", curves.query), ("near", curves.near), ("far", curves.far)):
        if values is not None:
            record[which] = _short(name.factor * values[shown])
    for which, cost in (("near_cost", curves.near_cost), ("far_cost", curves.far_cost)):
        if which.partition("_")[0] in record:
            record[which] = float(f"{cost:.3g}")
    return record


def _milliseconds(seconds: np.ndarray) -> list[int]:
    return [round(1000 * one) for one in seconds.tolist()]


def _short(values: np.ndarray) -> list[float]:
    return [float(f"{one:.3g}") for one in values.tolist()]
