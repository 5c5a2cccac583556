"""One warping for each body part: legs need not keep the time of the hands."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gesture_core.classify.common import common_sum
from gesture_core.dtw.spec import DtwSpec
from gesture_core.types import Signals

_SIDE = re.compile(r"^(right|left)_")
_AXIS = re.compile(r"_[xy](?=[.@]|$)")


def part_of(channel: str) -> str:
    """What ``channel`` is a part of, without side and axis: ``right_wrist_x.energy`` -> ``wrist.energy``."""
    return _AXIS.sub("", _SIDE.sub("", channel))


def parts(channels: Sequence[str]) -> list[np.ndarray]:
    """Indices of the channels of each part, in the order of first appearance."""
    places: dict[str, list[int]] = {}
    for index, channel in enumerate(channels):
        places.setdefault(part_of(channel), []).append(index)
    return [np.array(indices) for indices in places.values()]


def part_spec(spec: DtwSpec, part: np.ndarray) -> DtwSpec:
    """``spec`` for the channels of one part alone, summed over them."""
    weights = None if spec.weights is None else tuple(spec.weights[i] for i in part)
    return spec.replace(weights=weights, reduce="sum")


def separate_distances(
    queries: Sequence[Signals],
    examples: Sequence[Signals],
    spec: DtwSpec,
    warp: Callable[[Sequence[Signals], Sequence[Signals], DtwSpec], np.ndarray],
) -> np.ndarray:
    """Sum of the warping distances of all parts.

    Parameters
    ----------
    queries, examples : sequences of Signals with the same channels
    spec : DtwSpec
        Of each warping; ``reduce="mean"`` divides the sum by the number of common channels.
    warp : callable
        Distances of two lists of sequences under a specification.

    Returns
    -------
    (Q, N) float64
        Infinity where a pair has no channel in common; a part that one of the two lacks adds nothing.

    Raises
    ------
    ConfigError
        Where ``spec`` has weights for another number of channels.
    """
    from gesture_core.dtw.batches import check_weights

    check_weights(spec, len(queries[0].channels))
    total = np.zeros((len(queries), len(examples)))
    found = np.zeros(total.shape, bool)
    for part in parts(queries[0].channels):
        distances = warp(take(queries, part), take(examples, part), part_spec(spec, part))
        there = np.isfinite(distances)
        total += np.where(there, distances, 0)
        found |= there
    if spec.reduce == "mean":
        total /= np.maximum(common_sum(queries, examples, 1.0, 1.0), 1)
    return np.where(found, total, np.inf)


def take(series: Sequence[Signals], part: np.ndarray) -> list[Signals]:
    """The channels of one part of every sequence."""
    names = tuple(series[0].channels[i] for i in part)
    out = []
    for item in series:
        assert item.mask is not None and item.present is not None
        masks = {"mask": item.mask[part], "present": item.present[part]}
        out.append(replace(item, values=item.values[:, part], channels=names, **masks))
    return out
