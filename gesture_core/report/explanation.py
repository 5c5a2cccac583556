"""A decision as a picture: both warpings, what each channel costs, and the signals themselves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gesture_core.classify.explanation import Alignment, Explanation, contrast
from gesture_core.colours import ANSWER, MATCH, QUERY, RUNNER_UP
from gesture_core.report.style import new_figure, save
from gesture_core.types import Signals

_CHANNELS = 4
_BARS = 14
_MATCHES = 24
_SIDES = (("answer", ANSWER), ("runner-up", RUNNER_UP))


def explanation_plot(explanation: Explanation, title: str, path: Path, channels: int = _CHANNELS) -> Path:
    """Draw ``explanation`` to a PNG.

    Left column: the nearest example; right column: the runner-up class. Top: the warping paths, the
    largest parts of the distance, and the channels that tell the two apart. Below: these channels'
    signals over time, the query in black, the example in green (the answer) or purple (the runner-up), grey
    lines between matched frames.

    Parameters
    ----------
    explanation : Explanation
    title : str
    path : Path
        The ``.png``.
    channels : int
        How many channels to draw, those first that count most for or against the decision.

    Raises
    ------
    MissingDependencyError
        Where matplotlib is not installed.
    """
    sides = [side for side in (explanation.nearest, explanation.runner_up) if side is not None]
    used = explanation.nearest.used | sides[-1].used
    order = [c for c in contrast(explanation) if used[c]]
    shown = order[:channels]
    figure = new_figure(11, 3.6 + 1.9 * len(shown))
    grid = figure.add_gridspec(1 + len(shown), 2 * len(sides), height_ratios=[1.7] + [1.0] * len(shown))
    for column, side in enumerate(sides):
        _path(figure.add_subplot(grid[0, 2 * column]), side, shown[0], *_SIDES[column])
    _bars(figure.add_subplot(grid[0, 2 * len(sides) - 1]), sides, order)
    if len(sides) == 2:
        _bars_of_one(figure.add_subplot(grid[0, 1]), sides[0], order)
    for row, channel in enumerate(shown, 1):
        limits = [_span(side, channel) for side in sides]
        low, high = min(a for a, _ in limits), max(b for _, b in limits)
        for column, side in enumerate(sides):
            axes = figure.add_subplot(grid[row, 2 * column : 2 * column + 2])
            colour = _SIDES[column][1]
            _signals(axes, side, channel, low, high, colour, legend=row == 1, last=row == len(shown))
    figure.suptitle(title, fontsize=11)
    return save(figure, path)


def _path(axes: Any, side: Alignment, channel: int, which: str, colour: str) -> None:
    one = len(side.paths) == 1
    channel = channel if side.used[channel] else int(np.flatnonzero(side.used)[0])
    path = side.path_of(channel)
    rows, columns = _seconds(side.query), _seconds(side.signals)
    axes.plot(columns[path[:, 1]], rows[path[:, 0]], color=colour, linewidth=1.6)
    axes.plot([0, columns[-1]], [0, rows[-1]], color=MATCH, linewidth=0.8, linestyle=":")
    what = "" if one else f" ({side.query.channels[channel]})"
    axes.set_xlabel(f"example, seconds{what}", fontsize=8)
    axes.set_ylabel("query, seconds", fontsize=8)
    axes.tick_params(labelsize=7)
    mirror = " (mirrored)" if side.mirrored else ""
    axes.set_title(f"{which}: {side.label}{mirror}, {side.distance:.3g}", fontsize=9)


def _bars_of_one(axes: Any, side: Alignment, order: Sequence[int]) -> None:
    """The channels that make up most of the distance to the answer's nearest example."""
    top = sorted(order, key=lambda c: -side.costs[c])[: _BARS // 2]
    axes.barh(range(len(top)), [side.costs[c] for c in top], color=ANSWER)
    axes.set_yticks(range(len(top)), [side.query.channels[c] for c in top], fontsize=7)
    _few_ticks(axes)
    axes.invert_yaxis()
    axes.set_title("largest parts of its distance", fontsize=9)


def _bars(axes: Any, sides: Sequence[Alignment], order: Sequence[int]) -> None:
    """Cost of the channels that tell the two apart, side by side; of one, of what costs most."""
    top = order[: _BARS // 2]
    height = 0.8 / len(sides)
    for number, (side, (_, colour)) in enumerate(zip(sides, _SIDES, strict=False)):
        places = [row + number * height for row in range(len(top))]
        axes.barh(places, [side.costs[c] for c in top], height, color=colour, label=side.label)
    middle = height * (len(sides) - 1) / 2
    axes.set_yticks([r + middle for r in range(len(top))], [sides[0].query.channels[c] for c in top])
    _few_ticks(axes)
    axes.invert_yaxis()
    axes.legend(fontsize=7, loc="lower right")  # the longest bars are at the top
    axes.set_title("channels that decide" if len(sides) > 1 else "largest parts of its distance", fontsize=9)


def _few_ticks(axes: Any) -> None:
    axes.locator_params(axis="x", nbins=4)
    axes.tick_params(labelsize=7)


def _seconds(signals: Signals) -> np.ndarray:
    """(T,) seconds since the first frame."""
    seconds: np.ndarray = signals.times - signals.times[0]
    return seconds


def _span(side: Alignment, channel: int) -> tuple[float, float]:
    both = np.concatenate([side.query.values[:, channel], side.signals.values[:, channel]])
    return float(both.min()), float(both.max())


def _signals(
    axes: Any,
    side: Alignment,
    channel: int,
    low: float,
    high: float,
    colour: str,
    *,
    legend: bool,
    last: bool,
) -> None:
    query, example = side.query.values[:, channel], side.signals.values[:, channel]
    rows, columns = _seconds(side.query), _seconds(side.signals)
    span = high - low or 1.0
    if side.used[channel]:
        path = side.path_of(channel)
        for i, j in path[np.linspace(0, len(path) - 1, min(_MATCHES, len(path))).astype(int)]:
            axes.plot([rows[i], columns[j]], [query[i], example[j]], color=MATCH, linewidth=0.5, alpha=0.6)
    axes.plot(rows, query, color=QUERY, linewidth=1.5, label="query")
    axes.plot(columns, example, color=colour, linewidth=1.5, label=f"example: {side.label}")
    axes.set_ylim(low - 0.08 * span, high + (0.4 if legend else 0.08) * span)
    used = "" if side.used[channel] else " (not compared)"
    axes.set_title(f"{side.query.channels[channel]}{used}: cost {side.costs[channel]:.3g}", fontsize=8)
    axes.tick_params(labelsize=7)
    if legend:
        axes.legend(fontsize=7, loc="upper right", ncols=2)
    if last:
        axes.set_xlabel("seconds", fontsize=8)
