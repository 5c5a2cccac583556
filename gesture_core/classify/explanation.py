"""Why a query got its label: the warpings, what each channel costs, and what each example says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesture_core.classify.comparison import comparable, pair_factors, takes_parts
from gesture_core.classify.library import ExampleLibrary
from gesture_core.classify.neighbors import Votes, k_nearest, speakers, votes_of
from gesture_core.classify.separate import part_spec, parts, take
from gesture_core.classify.weighing import Weighing
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import InputError
from gesture_core.settings import Settings
from gesture_core.signals.mirror import mirrored
from gesture_core.types import Signals


@dataclass(frozen=True, eq=False)
class Alignment:
    """A query against one example.

    Attributes
    ----------
    example : str
    label : str
    distance : float
        As the decision saw it, factors included.
    mirrored : bool
        The example was read as the movement of the other hand.
    query, signals : Signals
        What was compared; ``signals`` is the example, mirrored where that was nearer.
    costs : (D,) float array
        Part of the distance that each channel contributes; zero for channels that do not take part.
    used : (D,) bool
        Channels that take part.
    paths : tuple of (K, 2) int arrays
        Matched frames, one array for each warping.
    places : (D,) int array
        Which of the paths is that of a channel; -1 for channels that do not take part.
    """

    example: str
    label: str
    distance: float
    mirrored: bool
    query: Signals
    signals: Signals
    costs: np.ndarray
    used: np.ndarray
    paths: tuple[np.ndarray, ...]
    places: np.ndarray

    def path_of(self, channel: int) -> np.ndarray:
        """The matched frames of one channel that takes part."""
        return self.paths[int(self.places[channel])]


@dataclass(frozen=True)
class Voice:
    """What one example says where all of them decide.

    Attributes
    ----------
    example, label : str
    distance : float
    similarity : float
        0 to 1.
    says : float
        What it adds to the score of the class that won minus that of the runner-up.
    """

    example: str
    label: str
    distance: float
    similarity: float
    says: float


@dataclass(frozen=True, eq=False)
class Explanation:
    """The query against its answer and against the runner-up.

    Attributes
    ----------
    nearest : Alignment
        The nearest example of the class that won. One of another class may be nearer still, where
        several neighbours vote or all examples decide.
    runner_up : Alignment or None
        The nearest example of the class with the second highest score where all examples decide,
        otherwise the nearest one of any other class; None with one class.
    voices : tuple of Voice
        Of all examples, the loudest first, where all of them decide; what they say adds up to `lead`.
    lead : float
        Score of the winner minus that of the runner-up; 0 where the nearest examples vote.
    """

    nearest: Alignment
    runner_up: Alignment | None
    voices: tuple[Voice, ...] = ()
    lead: float = 0.0


def explain(
    query: Signals,
    library: ExampleLibrary,
    distances: np.ndarray,
    settings: Settings,
    weighing: Weighing | None = None,
) -> Explanation:
    """Explain one row of distances.

    Parameters
    ----------
    query : Signals
    library : ExampleLibrary
        Of Signals.
    distances : (N,) float array
        The query's distances to the examples, as `comparison.compare` gives them.
    settings : Settings
        With the number of neighbours that vote, where ``weighing`` is not given.
    weighing : Weighing, optional
        What each example says, where all of them decide.

    Raises
    ------
    InputError
        E_NO_COMMON where no example can be compared with the query.
    """
    row, codes = np.where(np.isnan(distances), np.inf, distances)[None], library.codes
    neighbors = min(max(1, settings.classify.neighbors), len(library))
    votes = votes_of(row, codes, len(library.classes), neighbors, weighing)
    if votes.winners[0] < 0:
        raise InputError("no example has a dimension in common with this input", code="E_NO_COMMON")
    first, *others = _best_two(row, codes, votes)
    nearest = align(query, library, first, settings)
    if not others:
        return Explanation(nearest, None)
    runner_up = align(query, library, others[0], settings)
    if weighing is None:
        return Explanation(nearest, runner_up)
    said = weighing.voices(row)[0]
    says = said[:, codes[first]] - said[:, codes[others[0]]]
    voices = [
        Voice(library.names[i], str(library.labels[i]), float(row[0, i]), float(similarity), float(says[i]))
        for i, similarity in enumerate(weighing.similarities(row)[0])
    ]
    loudest = tuple(sorted(voices, key=lambda voice: -abs(voice.says)))
    return Explanation(nearest, runner_up, loudest, float(says.sum()))


def _best_two(row: np.ndarray, codes: np.ndarray, votes: Votes) -> list[int]:
    """The nearest example of the winner and that of the runner-up, if any, in a row (1, N) of distances."""
    if votes.order is not None:
        return speakers(row, codes, votes)[0][:2].tolist()
    own = codes == votes.winners[0]
    sides = [k_nearest(np.where(side, row, np.inf)) for side in (own, ~own)]
    return [int(side.indices[0, 0]) for side in sides if np.isfinite(side.distances[0, 0])]


def align(query: Signals, library: ExampleLibrary, index: int, settings: Settings) -> Alignment:
    """Warp ``query`` to example ``index``, as it is or mirrored, whichever is nearer."""
    query, example = comparable([query, library.series[index]], settings)  # type: ignore[assignment]
    assert isinstance(example, Signals)
    readings = [(example, False, 1.0)]
    if settings.classify.mirror is not None:
        readings.append((mirrored(example), True, settings.classify.mirror))
    found = []
    for signals, flipped, factor in readings:
        costs, used, paths, places = pair_costs(query, signals, settings)
        divisor = float(pair_factors([query], [signals], settings)[0, 0])
        # As in the comparison: no distance is none at all, whatever it is measured by.
        costs = costs * (factor / divisor if divisor > 0 else 1.0)
        distance = float(costs.sum()) if used.any() and (divisor > 0 or not costs.any()) else np.inf
        name, label = library.names[index], str(library.labels[index])
        found.append(Alignment(name, label, distance, flipped, query, signals, costs, used, paths, places))
    return min(found, key=lambda alignment: alignment.distance)


def pair_costs(
    query: Signals, example: Signals, settings: Settings
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...], np.ndarray]:
    """What each channel adds to the warping distance of a pair, before anything divides it.

    Returns
    -------
    costs : (D,) float64
    used : (D,) bool
    paths : tuple of (K, 2) int64
    places : (D,) int64
        Index of each channel's path, -1 for unused channels.
    """
    spec = settings.dtw
    if not takes_parts(settings):
        costs, used, paths = channel_costs(query, example, spec)
        order = np.cumsum(used) - 1 if spec.mode == "independent" else np.zeros(len(used), np.int64)
        return costs, used, paths, np.where(used, order, -1)
    width = len(query.channels)
    costs, used, places = np.zeros(width), np.zeros(width, bool), np.full(width, -1)
    ways: list[np.ndarray] = []
    for part in parts(query.channels):
        some, other = take([query, example], part)
        costs[part], used[part], found = channel_costs(some, other, part_spec(spec, part))
        places[part] = np.where(used[part], len(ways), -1)
        ways += found
    if spec.reduce == "mean":
        costs /= max(int(used.sum()), 1)
    return costs, used, tuple(ways), places


def channel_costs(
    query: Signals, example: Signals, spec: DtwSpec
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    """What each channel adds to the warping distance of a pair.

    In dependent mode all channels share one path, and a channel's part is its local cost along it
    (for a Euclidean local cost, in the ratio of the squared differences). The parts add up to the
    distance.

    Returns
    -------
    costs : (D,) float64
    used : (D,) bool
    paths : tuple of (K, 2) int64
    """
    from gesture_core.dtw.reference import local_costs

    width = len(query.channels)
    masks = np.asarray(query.mask) | np.asarray(example.mask)
    used = masks & np.asarray(query.present) & np.asarray(example.present)
    costs = np.zeros(width)
    dimensions = np.flatnonzero(used)
    if len(dimensions) == 0:
        return costs, used, ()
    x, y = query.values.astype(np.float64), example.values.astype(np.float64)
    paths = []
    groups = (
        [dimensions] if spec.mode == "dependent" else [dimensions[i : i + 1] for i in range(len(dimensions))]
    )
    for group in groups:
        path, total = _warp(x, y, spec, group)
        paths.append(path)
        total = _finish(total, len(x) + len(y), spec)
        if spec.mode != "dependent" and spec.reduce == "mean":
            total /= len(dimensions)
        squared = spec.replace(cost="squared") if spec.cost == "euclidean" else spec
        parts = np.array(
            [local_costs(x, y, squared, np.array([d]))[path[:, 0], path[:, 1]].sum() for d in group]
        )
        share = parts / parts.sum() if parts.sum() > 0 else np.full(len(group), 1 / len(group))
        costs[group] = total * share
    return costs, used, tuple(paths)


def _warp(x: np.ndarray, y: np.ndarray, spec: DtwSpec, group: np.ndarray) -> tuple[np.ndarray, float]:
    """The cheapest path and its accumulated cost; a soft warping is shown by its hard path."""
    from gesture_core.dtw.bands import allowed_cells
    from gesture_core.dtw.paths import backtrack, least_costs
    from gesture_core.dtw.reference import accumulate, local_costs

    cost, cells = local_costs(x, y, spec, group), allowed_cells(len(x), len(y), spec)
    table = least_costs(cost, cells)
    total = table[-1, -1] if spec.gamma is None else accumulate(cost, cells, spec.gamma)[-1, -1]
    return backtrack(table), float(total)


def _finish(total: float, length: int, spec: DtwSpec) -> float:
    if spec.length_norm:
        total /= length
    return float(np.sqrt(total)) if spec.root else total


def contrast(explanation: Explanation) -> Sequence[int]:
    """Channels in the order of how much they speak for the winner against the runner-up."""
    near = explanation.nearest.costs
    far = np.zeros_like(near) if explanation.runner_up is None else explanation.runner_up.costs
    gain = far - near if explanation.runner_up is not None else near
    return [int(i) for i in np.argsort(-np.abs(gain), kind="stable")]
