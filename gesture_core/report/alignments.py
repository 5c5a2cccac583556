"""What a page shows of one decision: the query's time in both examples, and the channels that decided."""

from __future__ import annotations

from typing import Any

import numpy as np

from gesture_core.classify.explanation import Alignment, Explanation, contrast

POINTS = 40
"""Places of the query's time that are shown, at most."""
CHANNELS = 3


def alignment_record(found: Explanation, start: float, starts: dict[str, float]) -> dict[str, Any]:
    """An explanation as plain values, small enough for a page.

    Parameters
    ----------
    found : Explanation
    start : float
        Seconds in the input at which its preview begins.
    starts : dict
        The same of each example by its name.

    Returns
    -------
    dict
        ``time``: milliseconds of the query's preview. ``near`` and ``far``: the example's name, label,
        distance, whether it was mirrored, and ``time``, its milliseconds at those of the query.
        ``channels``: name, costs and values of those that decided, the examples' at the query's time.
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
                "distance": float(f"{side.distance:.4g}"),
                "mirrored": side.mirrored,
                "time": _milliseconds(
                    _at(query.times[shown], side, warped_time(side))
                    - starts.get(side.example, side.signals.times[0])
                ),
            }
    used = found.nearest.used | (found.nearest if found.runner_up is None else found.runner_up).used
    record["channels"] = [_channel(found, channel, shown) for channel in contrast(found) if used[channel]][
        :CHANNELS
    ]
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


def _channel(found: Explanation, channel: int, shown: np.ndarray) -> dict[str, Any]:
    query = found.nearest.query
    record: dict[str, Any] = {
        "name": query.channels[channel],
        "query": _short(query.values[shown, channel]),
    }
    for name, side in (("near", found.nearest), ("far", found.runner_up)):
        if side is not None and side.used[channel]:
            values = _matched(side.path_of(channel), side.signals.values[:, channel], len(side.query))
            record[name] = _short(_at(query.times[shown], side, values))
            record[f"{name}_cost"] = float(f"{side.costs[channel]:.3g}")
    return record


def _milliseconds(seconds: np.ndarray) -> list[int]:
    return [round(1000 * one) for one in seconds.tolist()]


def _short(values: np.ndarray) -> list[float]:
    return [float(f"{one:.3g}") for one in values.tolist()]
