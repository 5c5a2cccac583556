"""Distances as the decision sees them: warping distances, mirrored examples, trust in what was seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

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
    other has, and is divided by the share of common channels.

    Parameters
    ----------
    queries, examples : sequences of Signals or (T, D) arrays
        Arrays have no channel names and are never mirrored.
    settings : Settings
    kernel : str, optional
        Instead of the one that the settings name.

    Returns
    -------
    (Q, N) float array
        Infinity where a pair has no dimension in common.
    """
    from gesture_core.dtw.distances import warping_distances

    chosen = settings.classify
    apart = _still_apart(queries, examples, settings)
    queries, examples = comparable(queries, settings), comparable(examples, settings)
    name = kernel or chosen.kernel
    named = all(isinstance(item, Signals) for item in (*queries, *examples))
    flipped = named and chosen.mirror is not None
    every = list(examples)
    if flipped:
        every += [mirrored(item) for item in examples if isinstance(item, Signals)]
    distances = warping_distances(queries, every, spec=settings.dtw, kernel=name, options=settings.options)
    if named and chosen.coverage:
        share = common_share(queries, every)  # type: ignore[arg-type]
        distances = np.divide(
            distances, share, out=np.full(distances.shape, np.inf, distances.dtype), where=share > 0
        )
    if flipped:
        same, other = np.split(distances, 2, axis=1)
        distances = np.minimum(same, other * chosen.mirror)
    return np.where(apart, np.inf, distances)


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


def common_share(queries: Sequence[Signals], examples: Sequence[Signals]) -> np.ndarray:
    """(Q, N) share of the salient channels of a pair that both of them have.

    The channels of a pair are those that are salient in either; one that only one of the two has
    cannot be compared.
    """
    seen_q, salient_q = _presence(queries)
    seen_e, salient_e = _presence(examples)
    # Salient channels are present on their own side; counted by inclusion and exclusion.
    both = salient_q @ salient_e.T
    wanted = salient_q.sum(axis=1)[:, None] + salient_e.sum(axis=1)[None] - both
    common = salient_q @ seen_e.T + seen_q @ salient_e.T - both
    return np.divide(common, wanted, out=np.zeros_like(common), where=wanted > 0)


def _presence(series: Sequence[Signals]) -> tuple[np.ndarray, np.ndarray]:
    """(B, D) of what is present, and of what is salient too, as 0.0 and 1.0."""
    present = np.array([item.present for item in series], bool)
    masks = np.array([item.mask for item in series], bool)
    return present.astype(np.float64), (masks & present).astype(np.float64)
