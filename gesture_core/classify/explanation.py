"""Why a query got its label: the warpings, what each channel costs, and what each example adds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gesture_core.classify.classifiers import Fitted
from gesture_core.classify.comparison import Extents, comparable, pair_divisors, parts, takes_parts
from gesture_core.classify.decision import k_nearest, named_examples, votes_of
from gesture_core.classify.examples import ExampleLibrary
from gesture_core.errors import InputError
from gesture_core.plugin.abilities import Contributes, HasMembers
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
        Part of the distance that each channel adds; zero for channels that do not take part.
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
class Contribution:
    """What one example adds to the decision, where the classifier tells.

    Attributes
    ----------
    example, label : str
    distance : float
    added : float
        To the score of the class that won minus that of the runner-up.
    """

    example: str
    label: str
    distance: float
    added: float


@dataclass(frozen=True, eq=False)
class Explanation:
    """The query against its answer and against the runner-up.

    Attributes
    ----------
    nearest : Alignment
        The nearest example of the class that won. One of another class may be nearer still, where
        several neighbours vote or all examples decide.
    runner_up : Alignment or None
        The nearest example of the class with the second highest score; where neighbours vote, the nearest
        one of any other class; None with one class.
    contributions : tuple of Contribution
        Of all examples, the largest first, where the classifier tells; they add up to `lead`, or to what the
        one of its members that looks at distances adds.
    lead : float
        Score of the winner minus that of the runner-up; 0 where the nearest examples vote.
    members : tuple of (str, float)
        What each member of a classifier of several adds to `lead`.
    """

    nearest: Alignment
    runner_up: Alignment | None
    contributions: tuple[Contribution, ...] = ()
    lead: float = 0.0
    members: tuple[tuple[str, float], ...] = ()


def explain(
    query: Signals,
    library: ExampleLibrary,
    distances: np.ndarray,
    settings: Settings,
    fitted: Fitted,
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
    fitted : Fitted
        What decided, with what it has learned of these examples.

    Raises
    ------
    InputError
        E_NO_COMMON where no example can be compared with the query.
    """
    row, codes = np.where(np.isnan(distances), np.inf, distances)[None], library.codes
    votes = votes_of(fitted, row, [query])
    if votes.winners[0] < 0:
        raise InputError("no example has a dimension in common with this input", code="E_NO_COMMON")
    if not fitted.votes:
        sides = named_examples(row, codes, votes, 0)[0][:2]
    else:
        won = codes == votes.winners[0]
        near = k_nearest(np.concatenate([np.where(side, row, np.inf) for side in (won, ~won)]))
        sides = near.indices[np.isfinite(near.distances)]
    nearest = align(query, library, int(sides[0]), settings)
    if len(sides) == 1:
        return Explanation(nearest, None)
    runner_up = align(query, library, int(sides[1]), settings)
    if fitted.votes:
        return Explanation(nearest, runner_up)
    ours, theirs, asked = codes[sides[0]], codes[sides[1]], fitted.classifier
    contributions: list[Contribution] = []
    members: list[tuple[str, float]] = []
    if isinstance(asked, Contributes):
        scores = asked.contributions(fitted.state, row)[0]
        every = zip(library.names, library.labels, row[0], scores[:, ours] - scores[:, theirs], strict=True)
        contributions = [Contribution(n, str(label), float(d), float(added)) for n, label, d, added in every]
        contributions.sort(key=lambda one: -abs(one.added))
    if isinstance(asked, HasMembers):
        said = asked.members(fitted.state, [query], row).items()
        members = [(name, float(scores[0, ours] - scores[0, theirs])) for name, scores in said]
    lead = float(votes.scores[0, ours] - votes.scores[0, theirs])
    return Explanation(nearest, runner_up, tuple(contributions), lead, tuple(members))


def align(query: Signals, library: ExampleLibrary, index: int, settings: Settings) -> Alignment:
    """Warp ``query`` to example ``index``, as it is or mirrored, whichever is nearer."""
    query, example = comparable([query, library.series[index]], settings)
    readings = [(example, False, 1.0)]
    if settings.classify.mirror is not None:
        readings.append((mirrored(example), True, settings.classify.mirror))
    found = []
    for signals, flipped, factor in readings:
        costs, used, paths, places = channel_costs(query, signals, settings)
        divisor = float(pair_divisors(Extents.of([query]), Extents.of([signals]), settings)[0, 0])
        # As in the comparison: no distance is none at all, whatever it is divided by.
        costs = costs * (factor / divisor if divisor > 0 else 1.0)
        distance = float(costs.sum()) if used.any() and (divisor > 0 or not costs.any()) else np.inf
        name, label = library.names[index], str(library.labels[index])
        found.append(Alignment(name, label, distance, flipped, query, signals, costs, used, paths, places))
    return min(found, key=lambda alignment: alignment.distance)


def channel_costs(
    query: Signals, example: Signals, settings: Settings
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...], np.ndarray]:
    """What each channel adds to the warping distance of a pair, before anything divides it.

    Channels that share one path share its cost: by their local costs along it, for a Euclidean local
    cost in the ratio of the squared differences. A soft warping is shown by its hard path.

    Returns
    -------
    costs : (D,) float64
        They add up to the distance.
    used : (D,) bool
    paths : tuple of (K, 2) int64
        One for each warping.
    places : (D,) int64
        Index of each channel's path, -1 for unused channels.
    """
    from gesture_core.dtw.bands import allowed_cells
    from gesture_core.dtw.paths import backtrack, least_costs
    from gesture_core.dtw.reference import accumulate, local_costs

    used = np.asarray(query.mask) | np.asarray(example.mask)
    used &= np.asarray(query.present) & np.asarray(example.present)
    dimensions = np.flatnonzero(used)
    spec, one_sum = settings.dtw, settings.dtw.mode != "dependent"
    groups = [dimensions[i : i + 1] for i in range(len(dimensions))]
    if takes_parts(settings):
        spec, one_sum = spec.replace(reduce="sum"), True
        members = parts(query.channels, settings).values()
        groups = [np.array([i for i in part if used[i]], np.int64) for part in members]
    elif not one_sum:
        groups = [dimensions]
    shares = spec.replace(cost="squared") if spec.cost == "euclidean" else spec
    x, y = query.values.astype(np.float64), example.values.astype(np.float64)
    costs, places = np.zeros(len(used)), np.full(len(used), -1)
    paths: list[np.ndarray] = []
    groups = [group for group in groups if len(group)]
    local = [local_costs(x, y, spec, group) for group in groups]
    cells = allowed_cells(len(x), len(y), spec)
    tables = least_costs(np.stack(local), cells) if groups else ()
    for group, cost, table in zip(groups, local, tables, strict=True):
        path = backtrack(table)
        total = float(table[-1, -1] if spec.gamma is None else accumulate(cost, cells, spec.gamma)[-1, -1])
        if spec.length_norm:
            total /= len(x) + len(y)
        if spec.root:
            total = float(np.sqrt(total))
        own = np.array(
            [local_costs(x, y, shares, np.array([d]))[path[:, 0], path[:, 1]].sum() for d in group]
        )
        costs[group] = total * (own / own.sum() if own.sum() > 0 else np.full(len(group), 1 / len(group)))
        places[group] = len(paths)
        paths.append(path)
    if one_sum and settings.dtw.reduce == "mean":
        costs /= max(len(dimensions), 1)
    return costs, used, tuple(paths), places


def contrast(explanation: Explanation) -> list[int]:
    """Channels in the order of how much they favour the winner over the runner-up, or oppose it."""
    gain = explanation.nearest.costs
    if explanation.runner_up is not None:
        gain = explanation.runner_up.costs - gain
    return [int(i) for i in np.argsort(-np.abs(gain), kind="stable")]
