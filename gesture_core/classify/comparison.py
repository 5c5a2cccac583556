"""Distances as the decision sees them: warping distances, mirrored examples, trust in what was seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.classify.common import common_share
from gesture_core.classify.relative import divided, pair_sizes, size_shares
from gesture_core.classify.separate import separate_distances
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError, InputError
from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals

if TYPE_CHECKING:
    from gesture_core.settings import Settings

Series = Signals | np.ndarray


def compare(
    queries: Sequence[Series], examples: Sequence[Series], settings: Settings, kernel: str | None = None
) -> np.ndarray:
    """Distances between every query and every example under ``settings``.

    With ``classify.mirror`` set, each example also stands for the same movement made with the other
    hand; that reading's distance is multiplied by the factor and the smaller one counts. With
    ``classify.coverage``, a distance rests on less where one of the two lacks channels that the
    other has, and is divided by the share of common channels. With ``classify.separate``, it is the
    sum of one warping for each body part; with ``classify.relative``, it is measured by the size of
    the two sequences, and so is the share of what they have in common.

    Parameters
    ----------
    queries, examples : sequences of Signals or (T, D) arrays
        Arrays have no channel names; they are warped as they are, all channels together.
    settings : Settings
    kernel : str, optional
        Instead of the one that the settings name.

    Returns
    -------
    (Q, N) float array
        Infinity where a pair has no dimension in common.

    Raises
    ------
    ConfigError
        See `check_settings`.
    InputError
        For a mixture of arrays and Signals, whose distances have different units, or of different
        channels.
    """
    from gesture_core.dtw.distances import warping_distances

    check_settings(settings)
    if not queries or not examples:
        return np.empty((len(queries), len(examples)))
    check_alike(examples, "example")
    check_alike(queries, "query", examples[0])
    chosen = settings.classify
    name = kernel or chosen.kernel

    def warp(some: Sequence[Series], others: Sequence[Series], spec: DtwSpec) -> np.ndarray:
        return warping_distances(some, others, spec=spec, kernel=name, options=settings.options)

    apart = _still_apart(queries, examples, settings)
    queries, examples = comparable(queries, settings), comparable(examples, settings)
    if not all(isinstance(item, Signals) for item in (*queries, *examples)):
        return np.where(apart, np.inf, warp(queries, examples, settings.dtw))
    readings = [(examples, 1.0)]
    if chosen.mirror is not None:
        readings.append(([mirrored(item) for item in examples], chosen.mirror))  # type: ignore[arg-type]
    distances = np.full(apart.shape, np.inf)
    for series, factor in readings:
        found = _measured(queries, series, settings, warp)  # type: ignore[arg-type]
        distances = np.minimum(distances, factor * found)
    return np.where(apart, np.inf, distances)


def check_settings(settings: Settings) -> None:
    """A ConfigError where the decision would multiply or divide what is no measure of it.

    Squares of sizes divide squared costs alone (`classify.relative`), and a factor makes a negative
    distance nearer that should be farther: soft distances may be below zero, and take none.
    """
    chosen = settings.classify
    factors = {
        "neighbors=1": chosen.neighbors == 0,
        "mirror=none": chosen.mirror is not None,
        "coverage=false": chosen.coverage,
        "relative=none": chosen.relative is not None,
    }
    if settings.dtw.gamma is not None and any(factors.values()):
        sets = " ".join(f"--set classify.{without}" for without, there in factors.items() if there)
        raise ConfigError(
            "dtw.gamma makes distances that may be negative, which cannot be weighed by a factor",
            remedy=f"--set dtw.gamma=none, or {sets}",
            code="E_OPTION",
        )
    if chosen.relative is not None and (settings.dtw.cost != "squared" or settings.dtw.root):
        raise ConfigError(
            f"classify.relative divides sums of squares, and dtw.cost = {settings.dtw.cost}, "
            f"dtw.root = {str(settings.dtw.root).lower()} are none",
            remedy="--set classify.relative=none --set classify.reject=none",
            code="E_OPTION",
        )


def check_alike(series: Sequence[Series], name: str, example: Series | None = None) -> None:
    """An InputError where ``series`` cannot be compared with each other, or with ``example``.

    ``name`` is what an element is called.
    """
    other = f"{name} 0" if example is None else "the examples"
    model = _channels(series[0] if example is None else example)
    for index, item in enumerate(series):
        if (_channels(item) is None) != (model is None):
            raise InputError(
                f"{name} {index}: bare arrays and signals with channel names cannot be compared",
                remedy="all of one kind; GestureClassifier.signals(poses) makes signals",
                code="E_MIXED",
            )
        if _channels(item) != model:
            raise InputError(
                f"{name} {index} has other channels than {other}",
                remedy="signals of one preset",
                code="E_DIMENSIONS",
            )


def _channels(item: Series) -> tuple[str, ...] | None:
    """The names of an element's channels; None for arrays."""
    return item.channels if isinstance(item, Signals) else None


def pair_factors(queries: Sequence[Signals], examples: Sequence[Signals], settings: Settings) -> np.ndarray:
    """(Q, N) what the warping distance of each pair is divided by; zero where it means nothing."""
    chosen = settings.classify
    by = np.ones((len(queries), len(examples)))
    if chosen.relative is not None:
        by = pair_sizes(queries, examples, chosen.rest) ** chosen.relative
    if chosen.coverage and chosen.relative is not None:
        by = by * size_shares(queries, examples, chosen.rest)
    elif chosen.coverage:
        by = common_share(queries, examples)
    return by


def takes_parts(settings: Settings) -> bool:
    """Whether each body part has a warping of its own; without a common path each channel has."""
    return settings.classify.separate and settings.dtw.mode == "dependent"


def _measured(
    queries: Sequence[Signals],
    examples: Sequence[Signals],
    settings: Settings,
    warp: Callable[[Sequence[Series], Sequence[Series], DtwSpec], np.ndarray],
) -> np.ndarray:
    """Distances to one reading of the examples."""
    if takes_parts(settings):
        distances = separate_distances(queries, examples, settings.dtw, warp)
    else:
        distances = warp(queries, examples, settings.dtw)
    if not settings.classify.coverage and settings.classify.relative is None:
        return distances
    return divided(distances, pair_factors(queries, examples, settings))


def is_still(item: Series) -> bool:
    """Whether no channel of a sequence is salient; arrays have no such notion."""
    return isinstance(item, Signals) and not item.selected


def comparable(series: Sequence[Series], settings: Settings) -> list[Series]:
    """``series`` with every channel of the still ones selected, where they count as postures."""
    if settings.signals.still != "posture":
        return list(series)
    return [
        replace(item, mask=np.ones(len(item.channels), bool))
        if isinstance(item, Signals) and is_still(item)
        else item
        for item in series
    ]


def _still_apart(queries: Sequence[Series], examples: Sequence[Series], settings: Settings) -> np.ndarray:
    """(Q, N) bool: a person who stands still makes no gesture, so only still examples fit."""
    apart = np.zeros((len(queries), len(examples)), bool)
    if settings.signals.still == "posture":
        still = np.array([is_still(item) for item in queries], bool)
        moving = np.array([not is_still(item) for item in examples], bool)
        apart = still[:, None] & moving[None]
    return apart
