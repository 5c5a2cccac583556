"""Signals of the same movement made with the other hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gesture_core.errors import SignalError
from gesture_core.joints import other_side
from gesture_core.types import Signals


def mirror_sign(channel: str) -> int:
    """-1 for a channel whose sign a mirror reverses, otherwise 1.

    It reverses what points to the side (``right_wrist_x``, ``right_wrist_x.velocity``) and the sense
    of a turn (``right_forearm.turning``), in three dimensions but for one around the x axis; the energy and
    the spread of a motion have no direction. The vector from one hand to the other also changes its ends, so
    that ``hands_y`` and ``hands_z`` are reversed instead of ``hands_x``.
    """
    name, _, kind = channel.partition("@")[0].partition(".")
    if kind in ("energy", "spread"):
        return 1
    if kind == "turning":
        return 1 if name.endswith("_x") else -1
    return -1 if name.endswith(("_y", "_z") if name.startswith("hands") else "_x") else 1


def mirrored(signals: Signals) -> Signals:
    """``signals`` as a mirror would show them: sides swapped, the sign of x reversed.

    The signals must have been normalised to a point on the body's middle line (the neck), as all
    built-in normalizers do.

    Raises
    ------
    SignalError
        E_MIRROR where a channel's counterpart on the other side is missing.
    """
    opposite = [other_side(name) for name in signals.channels]
    lost = [
        name for name, other in zip(signals.channels, opposite, strict=True) if other not in signals.channels
    ]
    if lost:
        raise SignalError(
            f"channel {lost[0]} has no counterpart on the other side",
            subject=signals.source,
            remedy="--set classify.mirror=none, or channels of both sides",
            code="E_MIRROR",
        )
    order = [signals.channels.index(other) for other in opposite]
    signs = np.array([mirror_sign(name) for name in signals.channels], np.float32)
    assert signals.mask is not None and signals.present is not None
    return replace(
        signals,
        values=signals.values[:, order] * signs,
        mask=signals.mask[order],
        present=signals.present[order],
    )
