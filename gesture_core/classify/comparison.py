"""Distances as the decision sees them: warpings of body parts, mirrored examples, sizes, shared channels.

The channels of a pair are those that are salient in either; one that only one of the two has cannot
be compared.

A squared warping distance grows with the square of a movement's size. With one example of each
gesture a small gesture is then near to everything and a large one far even from its own kind: the
small ones become hubs (Radovanovic, Nanopoulos and Ivanovic 2010). Divided by the geometric mean of
both sizes, a distance is the share of the two movements that the warping could not match, like a
cosine between vectors.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError, InputError
from gesture_core.settings import Settings
from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals

Series = Signals | np.ndarray
_SIDE_OR_AXIS = re.compile(r"^(right|left)_|_[xy](?=[.@]|$)")


def compare(queries: Sequence[Series], examples: Sequence[Series], settings: Settings) -> np.ndarray:
    """Distances between every query and every example under ``settings``.

    With ``classify.mirror`` set, each example also stands for the same movement made with the other
    hand; the distance to that reading is multiplied by the factor, and the smaller one counts. With
    ``classify.separate``, a distance is the sum of one warping for each body part. With
    ``classify.relative`` and ``classify.coverage`` it is divided by `pair_divisors`.

    Parameters
    ----------
    queries, examples : sequences of Signals or (T, D) arrays
        Arrays have no channel names; they are warped as they are, all channels together.
    settings : Settings

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
    warp = partial(warping_distances, kernel=chosen.kernel, options=settings.options)
    if not isinstance(examples[0], Signals):
        return warp(queries, examples, settings.dtw)
    own, others = comparable(queries, settings), comparable(examples, settings)
    readings = [(others, 1.0)]
    if chosen.mirror is not None:
        readings.append(([mirrored(item) for item in others], chosen.mirror))
    distances = np.full((len(own), len(others)), np.inf)
    for series, factor in readings:
        if takes_parts(settings):
            found = _part_distances(own, series, settings.dtw, warp)
        else:
            found = warp(own, series, settings.dtw)
        if chosen.coverage or chosen.relative is not None:
            found = divided(found, pair_divisors(own, series, settings))
        distances = np.minimum(distances, factor * found)
    if settings.signals.still == "posture":
        # A person who stands still makes no gesture, so only still examples fit.
        still = np.array([is_still(item) for item in queries])
        moving = np.array([not is_still(item) for item in examples])
        distances = np.where(still[:, None] & moving, np.inf, distances)
    return distances


def check_settings(settings: Settings) -> None:
    """A ConfigError where the settings would multiply or divide a distance that has no such scale.

    Squares of sizes divide squared costs alone (`classify.relative`). A factor makes a negative
    distance nearer that should be farther, so soft distances, which may be negative, take none.
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

    ``name`` is what an element is called in the message.
    """
    model, other = (series[0], f"{name} 0") if example is None else (example, "the examples")
    for index, item in enumerate(series):
        if isinstance(item, Signals) != isinstance(model, Signals):
            raise InputError(
                f"{name} {index}: bare arrays and signals with channel names cannot be compared",
                remedy="all of one kind; GestureClassifier.signals(poses) makes signals",
                code="E_MIXED",
            )
        if isinstance(item, Signals) and isinstance(model, Signals) and item.channels != model.channels:
            raise InputError(
                f"{name} {index} has other channels than {other}",
                remedy="signals of one preset",
                code="E_DIMENSIONS",
            )


def is_still(item: Series) -> bool:
    """Whether no channel of a sequence is salient; False for arrays, of which nobody knows."""
    return isinstance(item, Signals) and not item.selected


def comparable(series: Sequence[Series], settings: Settings) -> list[Signals]:
    """Signals with every channel of the still ones selected, where these count as postures."""
    postures = settings.signals.still == "posture"
    return [
        replace(item, mask=np.ones(len(item.channels), bool)) if postures and is_still(item) else item
        for item in series
        if isinstance(item, Signals)
    ]


def takes_parts(settings: Settings) -> bool:
    """Whether each body part has a warping of its own; without a common path each channel has."""
    return settings.classify.separate and settings.dtw.mode == "dependent"


def parts(channels: Sequence[str]) -> dict[str, list[int]]:
    """Indices of the channels of each body part by its name, in the order of first appearance.

    A part is named like its channels without side and axis: ``right_wrist_x.energy`` and
    ``left_wrist_y.energy`` are ``wrist.energy``.
    """
    places: dict[str, list[int]] = {}
    for index, channel in enumerate(channels):
        places.setdefault(_SIDE_OR_AXIS.sub("", channel), []).append(index)
    return places


def _part_distances(
    queries: Sequence[Signals],
    examples: Sequence[Signals],
    spec: DtwSpec,
    warp: Callable[[Sequence[Signals], Sequence[Signals], DtwSpec], np.ndarray],
) -> np.ndarray:
    """(Q, N) sum of one warping for each body part: legs need not keep the time of the hands.

    Infinity where a pair has no channel in common; a part that one of the two lacks adds nothing.
    With ``reduce="mean"`` the sum is divided by the number of common channels.
    """
    from gesture_core.dtw.batches import check_weights

    channels = queries[0].channels
    check_weights(spec, len(channels))
    total = np.zeros((len(queries), len(examples)))
    found = np.zeros(total.shape, bool)
    for part in parts(channels).values():
        weights = None if spec.weights is None else tuple(spec.weights[i] for i in part)
        own = spec.replace(weights=weights, reduce="sum")
        distances = warp(_take(queries, part), _take(examples, part), own)
        finite = np.isfinite(distances)
        total += np.where(finite, distances, 0)
        found |= finite
    if spec.reduce == "mean":
        total /= np.maximum(common_sum(queries, examples, 1.0, 1.0), 1)
    return np.where(found, total, np.inf)


def _take(series: Sequence[Signals], part: list[int]) -> list[Signals]:
    """The channels of one part of every sequence."""
    names = tuple(series[0].channels[i] for i in part)
    out = []
    for item in series:
        mask, present = np.asarray(item.mask)[part], np.asarray(item.present)[part]
        out.append(replace(item, values=item.values[:, part], channels=names, mask=mask, present=present))
    return out


def divided(distances: np.ndarray, by: np.ndarray) -> np.ndarray:
    """``distances / by``; infinity where a distance above zero has nothing to be divided by."""
    out: np.ndarray = np.where(distances > 0, np.inf, 0.0)
    np.divide(distances, by, out=out, where=by > 0)
    return out


def pair_divisors(queries: Sequence[Signals], examples: Sequence[Signals], settings: Settings) -> np.ndarray:
    """(Q, N) what the warping distance of each pair is divided by; zero where it means nothing.

    With ``classify.coverage``, the share of the pair's salient channels that both have. With
    ``classify.relative``, the sizes of both to that power; the share is then that of their sizes.
    """
    chosen = settings.classify
    if chosen.relative is None:
        return common_share(queries, examples) if chosen.coverage else np.ones((len(queries), len(examples)))
    sizes, shares = pair_sizes(queries, examples, chosen.rest)
    divisors: np.ndarray = sizes**chosen.relative
    return divisors * shares if chosen.coverage else divisors


def pair_sizes(
    queries: Sequence[Signals], examples: Sequence[Signals], rest: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Geometric mean of the sizes of every pair, and the share of all that each holds in it.

    The size of a sequence is the sum of its squared values over frames and over the channels that
    the pair is compared on, and ``rest`` for each frame. By its share of the size, a missing leg
    counts little in a gesture of the hands, and much in a lunge.

    Returns
    -------
    sizes : (Q, N) float64
        Zero where one of the two holds nothing at all.
    shares : (Q, N) float64
        ``sizes`` over the same of all channels that each of the two has, 0 to 1.
    """
    squares_q, squares_e = _squares(queries), _squares(examples)
    rest_q = rest * np.fromiter(map(len, queries), np.float64)
    rest_e = rest * np.fromiter(map(len, examples), np.float64)
    size_q = common_sum(queries, examples, squares_q, 1.0) + rest_q[:, None]
    size_e = common_sum(queries, examples, 1.0, squares_e) + rest_e[None]
    # Differences of sums may fall below zero by rounding.
    sizes = np.sqrt(np.maximum(size_q, 0) * np.maximum(size_e, 0))
    whole = np.sqrt(np.outer(squares_q.sum(axis=1) + rest_q, squares_e.sum(axis=1) + rest_e))
    shares = np.zeros_like(sizes)
    np.divide(sizes, whole, out=shares, where=whole > 0)
    return sizes, shares


def _squares(series: Sequence[Signals]) -> np.ndarray:
    """(B, D) sums of squares over the frames."""
    return np.array([np.einsum("td,td->d", item.values, item.values, dtype=np.float64) for item in series])


def common_share(queries: Sequence[Signals], examples: Sequence[Signals]) -> np.ndarray:
    """(Q, N) share of the salient channels of a pair that both of them have."""
    salient_q, salient_e = _presence(queries)[1], _presence(examples)[1]
    wanted = salient_q.sum(axis=1)[:, None] + salient_e.sum(axis=1) - _products(salient_q, salient_e)
    shares = np.zeros(wanted.shape)
    np.divide(common_sum(queries, examples, 1.0, 1.0), wanted, out=shares, where=wanted > 0)
    return shares


def common_sum(
    queries: Sequence[Signals], examples: Sequence[Signals], q: np.ndarray | float, e: np.ndarray | float
) -> np.ndarray:
    """(Q, N) sum of ``q * e`` over the channels of each pair that both have.

    ``q`` is (Q, D) or one number, ``e`` is (N, D) or one number.
    """
    (present_q, salient_q), (present_e, salient_e) = _presence(queries), _presence(examples)
    # Salient channels are present on their own side; counted by inclusion and exclusion.
    either = _products(q * salient_q, e * present_e) + _products(q * present_q, e * salient_e)
    common: np.ndarray = either - _products(q * salient_q, e * salient_e)
    return common


def _presence(series: Sequence[Signals]) -> tuple[np.ndarray, np.ndarray]:
    """(B, D) of what is present, and of what is salient too, as 0.0 and 1.0."""
    present = np.array([item.present for item in series], bool)
    masks = np.array([item.mask for item in series], bool)
    return present.astype(np.float64), (masks & present).astype(np.float64)


def _products(q: np.ndarray, e: np.ndarray) -> np.ndarray:
    """``q @ e.T`` summed in the order of the channels, so that no pair's bits depend on its batch."""
    out: np.ndarray = np.zeros((len(q), len(e)))
    for channel in range(q.shape[1]):
        out += np.multiply.outer(q[:, channel], e[:, channel])
    return out
