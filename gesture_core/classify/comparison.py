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
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gesture_core.classify.known import KnownDistances, mark_all
from gesture_core.errors import ConfigError, InputError
from gesture_core.files import printable
from gesture_core.settings import Settings
from gesture_core.signals.mirror import mirrored
from gesture_core.types import SignalBatch, Signals

Series = Signals | np.ndarray
_CHOICES = 4
"""Choices of examples that stay prepared: those that some queries still have to be compared with."""
_SIDE = re.compile(r"^(right|left)_")
_AXIS = re.compile(r"_[xyz](?=[.@]|$)|/[^.@\[]*|\[[^\]]*\]")


def compare(queries: Sequence[Series], examples: Sequence[Series], settings: Settings) -> np.ndarray:
    """Distances between every query and every example under ``settings``; see `Comparison`.

    Parameters
    ----------
    queries, examples : sequences of Signals or (T, D) arrays
    settings : Settings

    Returns
    -------
    (Q, N) float array
        Infinity where a pair has no dimension in common.
    """
    check_settings(settings)
    if not queries or not examples:
        return np.empty((len(queries), len(examples)))
    return Comparison(examples, settings).distances(queries)


class Comparison:
    """Examples, prepared once, to be compared with queries under ``settings``.

    With ``classify.mirror`` set, each example also stands for the same movement made with the other
    hand; the distance to that reading is multiplied by the factor, and the smaller one counts. With
    ``classify.separate``, a distance is the sum of one warping for each body part. With
    ``classify.relative`` and ``classify.coverage`` it is divided by `pair_divisors`.

    Parameters
    ----------
    examples : sequence of Signals or (T, D) arrays, at least one
        Arrays have no channel names; they are warped as they are, all channels together.
    settings : Settings
    known : KnownDistances, optional
        Pairs that need not be compared again; it learns those that are.

    Raises
    ------
    ConfigError
        See `check_settings`.
    InputError
        For a mixture of arrays and Signals, whose distances have different units, or of different
        channels.
    """

    def __init__(
        self, examples: Sequence[Series], settings: Settings, known: KnownDistances | None = None
    ) -> None:
        check_settings(settings)
        check_alike(examples, "example")
        self._examples, self._settings, self._known = examples, settings, known
        self._moving = ~np.fromiter(map(is_still, examples), bool)
        self._marks = [] if known is None else mark_all(examples)
        self._made: dict[bytes, list[_Reading]] = {}

    def distances(self, queries: Sequence[Series]) -> np.ndarray:
        """(Q, N) distances; infinity where a pair has no dimension in common."""
        check_alike(queries, "query", self._examples[0])
        if not self._marks:
            return self._computed(queries, np.arange(len(self._examples)))
        assert self._known is not None
        return self._known.completed(queries, self._marks, self._computed)

    def _computed(self, queries: Sequence[Series], columns: np.ndarray) -> np.ndarray:
        """(Q, M) distances to the examples at ``columns``."""
        from gesture_core.dtw.distances import warping_distances

        settings = self._settings
        if not isinstance(self._examples[0], Signals):
            return warping_distances(
                queries, self._examples, settings.dtw, settings.classify.kernel, settings.options
            )
        own = comparable(queries, settings)
        batch, extents = SignalBatch.of(own, name="query"), Extents.of(own)
        distances = np.full((len(own), len(columns)), np.inf)
        for reading in self._readings(columns):
            by = pair_divisors(extents, reading.extents, settings)
            distances = np.minimum(distances, reading.factor * divided(reading.warped(batch, extents), by))
        if settings.signals.still == "posture":
            # A person who stands still makes no gesture, so only still examples fit.
            still = np.fromiter(map(is_still, queries), bool)
            distances = np.where(still[:, None] & self._moving[columns], np.inf, distances)
        return distances

    def _readings(self, columns: np.ndarray) -> list[_Reading]:
        """What the examples at ``columns`` stand for, made once for each choice of columns."""
        found = self._made.get(columns.tobytes())
        if found is None:
            others = comparable([self._examples[i] for i in columns], self._settings)
            found, factor = [_Reading(others, 1.0, self._settings)], self._settings.classify.mirror
            if factor is not None:
                found.append(_Reading(list(map(mirrored, others)), factor, self._settings))
            if len(self._made) == _CHOICES:
                self._made.clear()
            self._made[columns.tobytes()] = found
        return found


def check_settings(settings: Settings) -> None:
    """A ConfigError where the settings ask of a distance or score what it has no scale for.

    Squares of sizes divide squared costs alone (`classify.relative`). A factor makes a negative
    distance nearer that should be farther, so soft distances, which may be negative, take none.
    """
    chosen = settings.classify
    factors = {
        "neighbors=1" if chosen.classifier == "auto" else "classifier=nearest": not chosen.votes,
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
    if chosen.min_score is not None and chosen.votes:
        raise ConfigError(
            "classify.min_score is about scores, and the nearest examples vote by their distances",
            remedy="--set classify.reject=… instead, or --set classify.neighbors=0",
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
            where = f" ({printable(item.source)})" if example is None and item.source else ""
            raise InputError(
                f"{name} {index}{where} has other channels than {other}"
                + _unlike(item.channels, model.channels),
                remedy="signals of one preset, and series with the same channels in the same units",
                code="E_DIMENSIONS",
            )


def _unlike(own: Sequence[str], others: Sequence[str]) -> str:
    """The first channels that only one of two sequences has."""
    more, less = (
        [name for name in one if name not in two][:3] for one, two in ((own, others), (others, own))
    )
    said = [
        f"{verb} {' and '.join(names)}" for verb, names in (("it has", more), ("it lacks", less)) if names
    ]
    return f": {', '.join(said)}" if said else ""


def is_still(item: Series) -> bool:
    """Whether no channel of a sequence is salient; False for arrays, of which nobody knows."""
    return isinstance(item, Signals) and not item.selected


def comparable(series: Sequence[Series], settings: Settings) -> list[Signals]:
    """Signals with every channel of the still ones selected, where these count as postures."""
    found = [item for item in series if isinstance(item, Signals)]
    if settings.signals.still != "posture":
        return found
    whole = np.ones(len(found[0].channels) if found else 0, bool)
    return [replace(item, mask=whole) if is_still(item) else item for item in found]


def takes_parts(settings: Settings) -> bool:
    """Whether each body part has a warping of its own; without a common path each channel has."""
    return settings.classify.separate and settings.dtw.mode == "dependent"


def parts(channels: Sequence[str], settings: Settings) -> dict[str, list[int]]:
    """Indices of the channels of each body part, or group, by its name, in the order of first appearance.

    A part is named like its channels without side, axis and member: ``right_wrist_x.energy`` and
    ``left_wrist_y.energy`` are ``wrist.energy``, ``left_fingers/thumb_x`` is ``fingers``. Groups of sensors
    keep their side: ``left_acc/x[g].velocity`` is ``left_acc.velocity``.
    """
    places: dict[str, list[int]] = {}
    for index, channel in enumerate(channels):
        name = channel if settings.signals.input == "channels" else _SIDE.sub("", channel)
        places.setdefault(_AXIS.sub("", name), []).append(index)
    return places


class _Reading:
    """What some examples stand for, as they are or mirrored, prepared for the kernel."""

    def __init__(self, series: Sequence[Signals], factor: float, settings: Settings) -> None:
        from gesture_core.dtw.distances import choose_kernel

        self.factor, self.extents = factor, Extents.of(series)
        self._spec, self._batch = settings.dtw, SignalBatch.of(series, name="example")
        self._name, self._kernel = choose_kernel(settings.classify.kernel, settings.dtw, settings.options)
        self._separate = takes_parts(settings)
        channels = series[0].channels
        one = {"": list(range(len(channels)))}
        self._parts = list((parts(channels, settings) if self._separate else one).values())
        self._made: list[tuple[SignalBatch, Any]] = []

    def warped(self, queries: SignalBatch, extents: Extents) -> np.ndarray:
        """(Q, N) warping distances, infinite where a pair has no channel in common.

        Of body parts that are warped separately the sum: legs need not keep the time of the hands. A part
        that one of the two lacks adds nothing. With ``reduce="mean"`` the sum is divided by the number of
        common channels.
        """
        from gesture_core.dtw.batches import check_batches
        from gesture_core.dtw.distances import check_distances

        check_batches(queries, self._batch, self._spec, bare=False)
        total = np.zeros((len(queries), len(self._batch)))
        met = np.zeros(total.shape, bool)
        for place, part in enumerate(self._parts):
            if len(self._made) == place:  # the examples, and what the kernel keeps of them
                weights = self._spec.weights
                own = self._spec.replace(
                    weights=None if weights is None else tuple(weights[i] for i in part),
                    reduce="sum" if self._separate else self._spec.reduce,
                )
                examples = _channels(self._batch, part)
                self._made.append((examples, self._kernel.prepare(examples, own)))
            asked, (examples, state) = _channels(queries, part), self._made[place]
            found = np.asarray(self._kernel.distances(state, asked))
            found = check_distances(found, asked, examples, self._name)
            if not self._separate:
                return found
            finite = np.isfinite(found)
            total += np.where(finite, found, 0)
            met |= finite
        if self._spec.reduce == "mean":
            total /= np.maximum(common_sum(extents, self.extents, 1.0, 1.0), 1)
        return np.where(met, total, np.inf)


def _channels(batch: SignalBatch, part: list[int]) -> SignalBatch:
    """Some channels of every series."""
    values, masks, present = (
        np.ascontiguousarray(array[..., part]) for array in (batch.values, batch.masks, batch.present)
    )
    return SignalBatch(values, batch.lengths, masks, present)


def divided(distances: np.ndarray, by: np.ndarray) -> np.ndarray:
    """``distances / by``; infinity where a distance above zero has nothing to be divided by."""
    out: np.ndarray = np.where(distances > 0, np.inf, 0.0)
    np.divide(distances, by, out=out, where=by > 0)
    return out


@dataclass(frozen=True, eq=False)
class Extents:
    """What decides how two sequences are divided.

    Attributes
    ----------
    present, salient : (B, D) float64
        0 or 1; what is salient is present.
    squares : (B, D) float64
        Sums of squares over the frames.
    frames : (B,) float64
    """

    present: np.ndarray
    salient: np.ndarray
    squares: np.ndarray
    frames: np.ndarray

    @classmethod
    def of(cls, series: Sequence[Signals]) -> Extents:
        """Those of ``series``, which have the same channels."""
        present = np.array([item.present for item in series], bool)
        masks = np.array([item.mask for item in series], bool)
        squares = [np.einsum("td,td->d", item.values, item.values, dtype=np.float64) for item in series]
        frames = np.fromiter(map(len, series), np.float64)
        return cls(
            present.astype(np.float64), (masks & present).astype(np.float64), np.array(squares), frames
        )


def pair_divisors(queries: Extents, examples: Extents, settings: Settings) -> np.ndarray:
    """(Q, N) what the warping distance of each pair is divided by; zero where it means nothing.

    With ``classify.coverage``, the share of the pair's salient channels that both have. With
    ``classify.relative``, the sizes of both to that power; the share is then that of their sizes.
    """
    chosen = settings.classify
    if chosen.relative is None:
        alike = np.ones((len(queries.frames), len(examples.frames)))
        return common_share(queries, examples) if chosen.coverage else alike
    sizes, shares = pair_sizes(queries, examples, chosen.rest)
    divisors: np.ndarray = sizes**chosen.relative
    return divisors * shares if chosen.coverage else divisors


def pair_sizes(queries: Extents, examples: Extents, rest: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
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
    rest_q, rest_e = rest * queries.frames, rest * examples.frames
    size_q = common_sum(queries, examples, queries.squares, 1.0) + rest_q[:, None]
    size_e = common_sum(queries, examples, 1.0, examples.squares) + rest_e[None]
    # Differences of sums may fall below zero by rounding.
    sizes = np.sqrt(np.maximum(size_q, 0) * np.maximum(size_e, 0))
    whole_q, whole_e = queries.squares.sum(axis=1) + rest_q, examples.squares.sum(axis=1) + rest_e
    whole = np.sqrt(np.outer(whole_q, whole_e))
    shares = np.zeros_like(sizes)
    np.divide(sizes, whole, out=shares, where=whole > 0)
    return sizes, shares


def common_share(queries: Extents, examples: Extents) -> np.ndarray:
    """(Q, N) share of the salient channels of a pair that both of them have."""
    salient_q, salient_e = queries.salient, examples.salient
    wanted = salient_q.sum(axis=1)[:, None] + salient_e.sum(axis=1) - _products(salient_q, salient_e)
    shares = np.zeros(wanted.shape)
    np.divide(common_sum(queries, examples, 1.0, 1.0), wanted, out=shares, where=wanted > 0)
    return shares


def common_sum(
    queries: Extents, examples: Extents, q: np.ndarray | float, e: np.ndarray | float
) -> np.ndarray:
    """(Q, N) sum of ``q * e`` over the channels of each pair that both have.

    ``q`` is (Q, D) or one number, ``e`` is (N, D) or one number.
    """
    # Salient channels are present on their own side; counted by inclusion and exclusion.
    either = _products(q * queries.salient, e * examples.present)
    either += _products(q * queries.present, e * examples.salient)
    common: np.ndarray = either - _products(q * queries.salient, e * examples.salient)
    return common


def _products(q: np.ndarray, e: np.ndarray) -> np.ndarray:
    """``q @ e.T`` summed in the order of the channels, so that no pair's bits depend on its batch."""
    out: np.ndarray = np.zeros((len(q), len(e)))
    for channel in range(q.shape[1]):
        out += np.multiply.outer(q[:, channel], e[:, channel])
    return out
