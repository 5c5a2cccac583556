"""A decision as a picture: film strips with what was matched, and the channels that differ most."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gesture_core.classify.explanation import Alignment, Explanation
from gesture_core.colours import ANSWER, GROUND, MATCH, QUERY, RUNNER_UP
from gesture_core.report.alignments import curves_of, deciding, warped_time
from gesture_core.report.channel_names import ChannelName, ChannelNames
from gesture_core.report.film_strips import Strips
from gesture_core.report.style import fitted, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CHANNELS = 3
_IN_A_ROW = 3
_THREADS = 28
# Inches. Half as wide, as in a narrow window, the smallest letters are still ten pixels high.
_WIDE, _EDGE, _SIDE, _STRIP, _THREAD = 13.3, 0.2, 2.15, 1.07, 0.55
_HEAD, _AXIS, _PANEL, _TITLE = 0.95, 0.75, 2.0, 0.75
_SMALL, _PLAIN, _LARGE = 11, 12, 17


def explanation_plot(
    explanation: Explanation,
    title: str,
    path: Path,
    names: ChannelNames,
    channels: int = CHANNELS,
    strips: Strips | None = None,
    facts: str = "",
) -> Path:
    """Draw ``explanation`` to a PNG.

    Above: the query between the nearest example and the runner-up, all on one scale of seconds, and lines
    between the moments that were matched; pictures, or the channel that differs most where there are none.
    Below: the channels that differ most, at the query's time. The query is black, the example of the
    answer green, that of the runner-up purple and broken.

    Parameters
    ----------
    explanation : Explanation
    title : str
    path : Path
        The ``.png``.
    names : ChannelNames
        Of the settings that decided.
    channels : int
        How many channels to draw, those first that count most for or against the decision.
    strips : Strips, optional
        From `film_strips.film_strips`.
    facts : str
        A line below the title.

    Raises
    ------
    MissingDependencyError
        Where matplotlib is not installed.
    """
    strips, shown = strips or Strips(), deciding(explanation)[:channels]
    sides = 1 if explanation.runner_up is None else 2
    rows = -(-len(shown) // _IN_A_ROW)
    block = (1 + sides) * _STRIP + sides * _THREAD + _AXIS
    high = _HEAD + block + 0.5 + rows * (_TITLE + _PANEL + _AXIS) + _EDGE
    figure = new_figure(_WIDE, high)
    figure.set_layout_engine("none")
    _write(figure, _EDGE, high - 0.35, title, _LARGE, weight="bold")
    _write(figure, _EDGE, high - 0.68, facts, _PLAIN)
    _films(figure, high - _HEAD, explanation, strips, names(explanation.nearest.query.channels[shown[0]]))
    top = high - _HEAD - block - 0.25
    _write(figure, _EDGE, top, "The channels that differ most", _PLAIN + 1, weight="bold")
    _legend(figure, top, explanation)
    for place, channel in enumerate(shown):
        row, column = divmod(place, _IN_A_ROW)
        foot = top - 0.25 - row * (_TITLE + _PANEL + _AXIS) - _TITLE - _PANEL
        each = (_WIDE - 2 * _EDGE) / _IN_A_ROW
        _panel(figure, _EDGE + column * each, foot, each, explanation, channel, names)
    return save(figure, path, trim=False)


def _films(figure: Figure, top: float, found: Explanation, strips: Strips, name: ChannelName) -> None:
    """The strips, one below the other, on one scale, and what was matched between them."""
    near, far = found.nearest, found.runner_up
    shown: list[tuple[str, Alignment, bool, str]] = [
        ("nearest", near, False, ANSWER),
        ("query", near, True, QUERY),
    ]
    if far is not None:
        shown.append(("runner_up", far, False, RUNNER_UP))
    lengths = [_length(side.query if query else side.signals) for _, side, query, _ in shown]
    longest, wide = max(*lengths, 1e-6), _WIDE - _SIDE - 2 * _EDGE
    for place, ((which, side, query, colour), length) in enumerate(zip(shown, lengths, strict=True)):
        foot = top - place * (_STRIP + _THREAD) - _STRIP
        axes = _axes(figure, _EDGE + _SIDE, foot, wide, _STRIP)
        axes.set_xlim(0, longest)
        axes.set_ylim(0, 1)
        _style(axes)
        axes.tick_params(left=False, labelleft=False, bottom=False, labelbottom=False)
        for edge in ("left", "bottom"):
            axes.spines[edge].set_visible(False)
        flipped = side.mirrored and not query
        if which in strips.pictures:
            _pictures(axes, strips.pictures[which], length, longest * _STRIP / wide, flipped=flipped)
        else:
            _curve(axes, side, colour, _first_channel(found), query=query)
        axes.plot([0, 0], [0, 1], color=colour, linewidth=5, solid_capstyle="butt", clip_on=False)
        _beside(figure, foot, side, which, strips, name)
        if place:
            _threads(_axes(figure, _EDGE + _SIDE, foot + _STRIP, wide, _THREAD), longest, near, far, place)
    axes.spines["bottom"].set_visible(True)
    axes.tick_params(bottom=True, labelbottom=True, labelsize=_SMALL)
    axes.set_xlabel("seconds from the beginning of each", fontsize=_SMALL)


def _beside(
    figure: Figure, foot: float, side: Alignment, which: str, strips: Strips, name: ChannelName
) -> None:
    """What a strip is, on its left."""
    if which == "query":
        lines = ["this input"]
    else:
        what = "its nearest" if which == "nearest" else "runner-up"
        lines = [side.label, f"{what}, at {_number(side.distance, 3)}", side.example.rpartition("/")[2]]
        lines += ["read as the other hand"] if side.mirrored else []
    if which not in strips.pictures:
        lines.append(name.words)
    for place, line in enumerate(lines):
        weight = "normal" if place else "bold"
        size = _SMALL if place else _PLAIN + 1
        _write(figure, _EDGE, foot + _STRIP - 0.16 - 0.24 * place, line, size, _SIDE - 0.15, weight=weight)


def _number(value: float, digits: int) -> str:
    """That many digits, and no exponent for a large value."""
    return f"{value:.{digits}g}" if value < 10**digits - 0.5 else f"{value:.0f}"


def _pictures(axes: Axes, strip: np.ndarray, length: float, width: float, *, flipped: bool) -> None:
    """Square pictures at even times on the ground of a film; ``width`` of one is in seconds."""
    count = max(1, strip.shape[1] // strip.shape[0])
    axes.axvspan(0, max(length, width), color=GROUND)
    for place, picture in enumerate(np.split(strip[:, : count * strip.shape[0]], count, axis=1)):
        middle = max(length * (place + 0.5) / count, width / 2)
        extent = (middle - width / 2, middle + width / 2, 0.0, 1.0)
        axes.imshow(picture[:, ::-1] if flipped else picture, extent=extent, aspect="auto", zorder=2)
    axes.set_ylim(0, 1)


def _curve(axes: Axes, side: Alignment, colour: str, channel: int, *, query: bool) -> None:
    """The channel that differs most, in the place of pictures."""
    signals = side.query if query else side.signals
    both = np.concatenate([side.query.values[:, channel], side.signals.values[:, channel]])
    low, high = float(both.min()), float(both.max())
    values = 0.1 + 0.8 * (signals.values[:, channel] - low) / (high - low or 1.0)
    axes.axvspan(0, _length(signals), color=MATCH, alpha=0.12)
    axes.plot(signals.times - signals.times[0], values, color=colour, linewidth=1.8)


def _threads(axes: Axes, longest: float, near: Alignment, far: Alignment | None, place: int) -> None:
    """Lines between matched moments of the query and of the example above it, or below it."""
    side = near if place == 1 or far is None else far
    chosen = np.unique(np.linspace(0, len(side.query) - 1, _THREADS).round().astype(int))
    asked = side.query.times[chosen] - near.query.times[0]
    matched = warped_time(side)[chosen] - side.signals.times[0]
    above, below = (matched, asked) if place == 1 else (asked, matched)
    axes.plot(np.stack([above, below]), [[1], [0]] * np.ones(len(chosen)), color=MATCH, linewidth=0.9)
    axes.set_xlim(0, longest)
    axes.set_ylim(0, 1)
    axes.set_axis_off()


def _panel(
    figure: Figure,
    left: float,
    foot: float,
    each: float,
    found: Explanation,
    channel: int,
    names: ChannelNames,
) -> None:
    """One channel over the query's time."""
    curves, times = curves_of(found, channel), found.nearest.query.times
    name = names(curves.channel)
    axes = _axes(figure, left + 0.95, foot, each - 1.15, _PANEL)
    for values, colour, style in (
        (curves.far, RUNNER_UP, "--"), (curves.near, ANSWER, "-"), (curves.query, QUERY, "-"),
    ):  # fmt: skip
        if values is not None:
            axes.plot(times - times[0], name.factor * values, color=colour, linestyle=style, linewidth=2)
    axes.set_xlabel("seconds of this input", fontsize=_SMALL)
    axes.set_ylabel((name.unit or "value").replace(" a second", "\na second"), fontsize=_SMALL)
    axes.margins(x=0)
    low, high = axes.get_ylim()
    if low < 0 < high:
        axes.axhline(0, color=MATCH, linewidth=0.6, zorder=1)
    axes.locator_params(nbins=5)
    axes.tick_params(labelsize=_SMALL)
    _style(axes)
    _write(figure, left, foot + _PANEL + 0.43, name.words, _PLAIN, each - 0.1, weight="bold")
    costs = [(found.nearest, curves.near_cost)]
    costs += [] if found.runner_up is None else [(found.runner_up, curves.far_cost)]
    said = ", ".join(f"{_number(cost, 2)} to {side.label}" for side, cost in costs)
    _write(figure, left, foot + _PANEL + 0.16, f"adds {said}", _SMALL, each - 0.1)


def _legend(figure: Figure, height: float, found: Explanation) -> None:
    from matplotlib.lines import Line2D

    line: Any = partial(Line2D, [], [], linewidth=2)
    shown = [
        ("this input", line(color=QUERY)),
        (f"{found.nearest.label}, its nearest example", line(color=ANSWER)),
    ]
    if found.runner_up is not None:
        shown.append((f"{found.runner_up.label}, runner-up", line(color=RUNNER_UP, linestyle="--")))
    place = (_WIDE - _EDGE) / _WIDE, height / figure.get_figheight()
    figure.legend(
        [one for _, one in shown], [words[:40] for words, _ in shown], ncols=3, fontsize=_PLAIN,
        frameon=False, loc="center right", bbox_to_anchor=place, borderaxespad=0,
    )  # fmt: skip


def _first_channel(found: Explanation) -> int:
    return deciding(found)[0]


def _length(signals: Any) -> float:
    """Seconds from the first frame to the last."""
    return float(signals.times[-1] - signals.times[0])


def _style(axes: Axes) -> None:
    for edge in ("top", "right"):
        axes.spines[edge].set_visible(False)


def _axes(figure: Figure, left: float, foot: float, wide: float, high: float) -> Axes:
    """Axes at a place in inches."""
    across, up = _WIDE, figure.get_figheight()
    return figure.add_axes((left / across, foot / up, wide / across, high / up))


def _write(
    figure: Figure,
    left: float,
    height: float,
    words: str,
    size: float,
    room: float = _WIDE - 2 * _EDGE,
    **style: Any,
) -> None:
    """Text at a place in inches, shortened in its middle where there is no room for it."""
    place = left / _WIDE, height / figure.get_figheight()
    fitted(figure.text(*place, words, fontsize=size, va="center", **style), room)
