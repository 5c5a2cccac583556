"""What a channel is called in pictures, and its values in a unit that a person knows."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gesture_core.settings import Settings

_LENGTHS = {"shoulder": "shoulder widths"} | dict.fromkeys(("torso", "upright", "view"), "trunk lengths")
"""The length that is 1 after each normalizer."""
_CHANNEL = re.compile(
    r"(?P<side>right_|left_)?(?P<part>[a-z_]+?)(?P<member>/[a-z]+)?(_(?P<axis>[xyz]))?"
    r"(\.(?P<kind>[a-z]+))?(@(?P<share>[0-9.]+))?"
)
_TO, _MOVED = ("sideways", "upwards", "in depth"), ("sideways", "up and down", "in depth")
_WORDS = {
    "": ("", ("sideways", "height", "depth")),
    "direction": ("direction ", _TO), "velocity": ("velocity ", _TO),
    "energy": ("speed ", _MOVED), "spread": ("reach ", _MOVED), "turning": ("turning ", _MOVED),
    "bend": ("bend, ", ("sine", "cosine", "")),
}  # fmt: skip
"""Of each kind of channel, by its axis."""
_SIGNED = ("", "direction", "velocity")
"""Kinds that point somewhere: their y is turned round, as pictures count it downwards."""


@dataclass(frozen=True)
class ChannelName:
    """How a channel is shown.

    Attributes
    ----------
    words : str
    unit : str
        Empty where there is none.
    factor : float
        What turns the values that were compared into that unit.
    """

    words: str
    unit: str
    factor: float = 1.0


class ChannelNames:
    """Names of the channels that some settings make; called with that of a `Signals`.

    Parameters
    ----------
    settings : Settings
    spotted : bool
        The channels are those in which events are looked for.
    """

    def __init__(self, settings: Settings, spotted: bool = False) -> None:
        self._filters = (settings.spot.chain if spotted else ()) or settings.signals.filters
        self._length = _LENGTHS.get(settings.signals.normalizer, "")
        self._joints = settings.signals.input != "channels"
        parts = next((name for name in self._filters if name.partition(":")[0] == "parts"), None)
        self._weights = None if parts is None else _terms(settings.options.get(parts, {}).get("weights", {}))

    def __call__(self, channel: str) -> ChannelName:
        """The name of a channel; as it is where nothing better is known."""
        found = _CHANNEL.fullmatch(channel) if self._joints and self._length else None
        if found is None or (found["kind"] or "") not in _WORDS:
            return ChannelName(channel, "")
        kind, axis, share = found["kind"] or "", found["axis"], float(found["share"] or 0)
        factor = 1.0
        if self._weights is not None:
            own = self._weights.get((found["part"], kind), {})
            weight = own.get(share, sum(own.values()))  # a stream subtracts no mean, and adds the terms up
            if not weight:
                return ChannelName(channel, "")
            factor = weight**-0.5
        unit = self._length
        if kind in ("velocity", "energy"):  # they are of a tenth of a second
            unit, factor = f"{unit} a second", 10 * factor
        elif kind == "turning":
            unit, factor = f"square {unit} a second", factor * 10 / 3
        elif kind == "direction":
            unit = "of a vector of length 1"
        elif kind == "bend":
            unit = ""
        if axis == "y" and kind in _SIGNED:
            factor = -factor
        part = "".join(found[name] or "" for name in ("side", "part", "member"))
        part = part.replace("_", " ").replace("/", ", ")
        begin, axes = _WORDS[kind]
        what = f"{begin}{axes['xyz'.index(axis)]}" if axis else begin.rstrip(", ")
        centred = share or (self._weights is None and "center" in self._filters)
        about = " about its mean" if centred and not kind else ""
        part = "hand to hand" if part == "hands" else part
        return ChannelName(f"{part}: {what}{about}" if what else part, unit, factor)


def _terms(weights: Mapping[str, Any]) -> dict[tuple[str, str], dict[float, float]]:
    """Weights of each part and kind, by the share of the mean that is subtracted."""
    terms: dict[tuple[str, str], dict[float, float]] = {}
    for text, weight in weights.items():
        name, _, share = text.partition("@")
        part, _, kind = name.partition(".")
        terms.setdefault((part, kind), {})[float(share or 0)] = float(weight)
    return terms
