"""The built-in classifiers, and `Fitted`: one of any kind with what it has learned of some examples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.classify.learning import ExampleWeights, calibrated_thresholds, learn_weights, medoids
from gesture_core.errors import ConfigError, InputError, PluginError
from gesture_core.plugin.abilities import LeavesOut, OrdersClasses
from gesture_core.plugin.hooks import KINDS
from gesture_core.plugin.registry import calling, name_of, registry
from gesture_core.settings import ClassifySettings, Settings
from gesture_core.types import Signals

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import Classifier

_MOST = 200
"""Times that examples are left out."""
_TEACHING = 6
"""Times as many examples teach as there are landmarks, at most: what more would add is noise."""
_FRAMES = 64
"""Frames of what orders the examples."""

Series = Sequence[Signals | np.ndarray]
State = Mapping[str, np.ndarray]
Table = np.ndarray | None
"""Distances, where a classifier compares examples."""


@dataclass(frozen=True)
class Nearest:
    """The vote of the nearest examples (Cover and Hart 1967), as in the paper.

    Its scores are minus the distance to the nearest example of each class; of several neighbours, the votes
    of a class, less d / (1 + d) of that distance.
    """

    neighbors: int = 1
    least = 1
    compares = False

    def fit(
        self, examples: Series, codes: np.ndarray, classes: int, distances: Table, marks: np.ndarray
    ) -> State:
        """Nothing is learned."""
        return {"codes": np.asarray(codes)[marks], "classes": np.array(classes)}

    def scores(self, state: State, queries: Series, distances: np.ndarray) -> np.ndarray:
        """(Q, C)."""
        return self.ordered(state, queries, distances)[0]

    def ordered(self, state: State, queries: Series, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The scores, and the votes of each class; one neighbour needs none."""
        codes, classes = state["codes"], int(state["classes"])
        nearest, _ = nearest_of(distances, codes, classes)
        there = np.isfinite(nearest)
        votes = np.zeros(nearest.shape)
        near = np.where(there, nearest, 0.0)
        if self.neighbors <= 1:
            return -near, votes
        order = np.argsort(distances, axis=1, kind="stable")[:, : self.neighbors]
        for query, indices in enumerate(order):
            voters = codes[indices[np.isfinite(distances[query, indices])]]
            votes[query] = np.bincount(voters, minlength=classes)
        return votes - near / (1 + np.abs(near)), votes


@dataclass(frozen=True)
class Weighed:
    """All examples decide: a linear discriminant on the similarities to them; see `learn_weights`."""

    sharpness: float = 3.0
    shrinkage: float = 0.1
    least = 1
    compares = True

    def fit(
        self, examples: Series, codes: np.ndarray, classes: int, distances: Table, marks: np.ndarray
    ) -> State:
        """Weights of the examples at ``marks``, learned from all."""
        assert distances is not None
        found = learn_weights(distances, codes, classes, self.sharpness, self.shrinkage, marks)
        return {"scales": found.scales, "weights": found.weights}

    def weights(self, state: State) -> ExampleWeights:
        """What was learned."""
        return ExampleWeights(state["scales"], state["weights"], self.sharpness)

    def scores(self, state: State, queries: Series, distances: np.ndarray) -> np.ndarray:
        """(Q, C) sum of what all examples add."""
        return self.ordered(state, queries, distances)[0]

    def ordered(self, state: State, queries: Series, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The scores, and the same without the factor that makes those of what is far away vanish."""
        raw, factors = self.weights(state).scores(distances)
        return raw * factors[:, None], raw

    def contributions(self, state: State, distances: np.ndarray) -> np.ndarray:
        """(Q, M, C) what each example adds to the score of each class."""
        return self.weights(state).contributions(distances)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A classifier and what it has learned; made by `fit`.

    Attributes
    ----------
    classifier : Classifier
    state : mapping of str to array
        As its `fit` returned it.
    codes : (M,) int64
        Class of each example that queries are compared with.
    classes : int
    votes : int
        How many neighbours vote; 0 where scores decide.
    temperature : float, optional
        What turns scores into probabilities (`gesture_core.classify.decision.temperature_of`).
    """

    classifier: Classifier
    state: State
    codes: np.ndarray
    classes: int
    votes: int = 0
    temperature: float | None = None

    @classmethod
    def fit(
        cls,
        settings: Settings,
        examples: Series,
        codes: np.ndarray,
        classes: int,
        distances: np.ndarray | None,
        marks: np.ndarray | None = None,
    ) -> Fitted:
        """Have the classifier of ``settings`` learn; see `Classifier.fit` for the rest.

        Raises
        ------
        InputError
            E_EXAMPLES where a class has fewer examples than the classifier needs.
        """
        classifier = choose_classifier(settings)
        codes = np.asarray(codes, np.int64)
        marks = np.arange(len(codes)) if marks is None else marks
        members = np.bincount(codes, minlength=classes)
        few = members[members > 0].min(initial=classifier.least)
        if few < classifier.least:
            raise InputError(
                f"{name_of(classifier)} needs {classifier.least} examples of each class, and one has {few}",
                remedy="more examples, or --set classify.classifier=auto",
                code="E_EXAMPLES",
            )
        with calling(classifier):
            state = {
                name: np.asarray(array)
                for name, array in classifier.fit(examples, codes, classes, distances, marks).items()
            }
        return cls(classifier, state, codes[marks], classes, settings.classify.votes)

    def with_temperature(self, temperature: float | None) -> Fitted:
        """The same, and probabilities."""
        return replace(self, temperature=temperature)

    def ordered(self, queries: Series, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(Q, C) scores, and numbers by which the classes are ordered.

        Raises
        ------
        PluginError
            Where the classifier raises, or breaks its contract.
        """
        asked = self.classifier
        with calling(asked):
            if isinstance(asked, OrdersClasses):
                found = asked.ordered(self.state, queries, distances)
            else:
                found = (asked.scores(self.state, queries, distances),) * 2
            scores, ranks = (np.asarray(array, np.float64) for array in found)
        wanted = (len(distances), self.classes)
        if scores.shape != wanted or ranks.shape != wanted:
            raise PluginError(
                f"{name_of(asked)} returned scores of shape {scores.shape}, expected {wanted}",
                code="E_PLUGIN_CONTRACT",
            )
        if not (np.isfinite(scores).all() and np.isfinite(ranks).all()):
            raise PluginError(
                f"{name_of(asked)} returned scores that are not finite",
                remedy="another --set classify.classifier=…, and a report to its author",
                code="E_PLUGIN_CONTRACT",
            )
        return scores, ranks


def choose_classifier(settings: Settings) -> Classifier:
    """The classifier that ``settings`` name, with its options and the parameters of [classify] that it takes.

    Raises
    ------
    GestureError
        Where it cannot be used.
    """
    chosen, plugins = settings.classify, registry()
    name = chosen.decides
    own = {key: getattr(chosen, key) for key in KINDS["classifier"].offered}
    if chosen.votes:
        own["neighbors"] = chosen.votes
    taken = {key: value for key, value in own.items() if plugins.takes("classifier", name, key)}
    made: Classifier = plugins.make("classifier", name, settings.options.get(name, {}), **taken)
    return made


def left_out(
    classifier: Classifier, examples: Series, codes: np.ndarray, classes: int, distances: np.ndarray
) -> np.ndarray:
    """(N, C) scores of the examples, each decided by others; minus infinity where none of a class is left.

    ``distances`` are (N, N). Of many examples several are left out together (`_MOST`).
    """
    distances = np.where(np.isnan(distances), np.inf, distances)
    if isinstance(classifier, LeavesOut):
        return np.asarray(classifier.left_out(examples, codes, classes, distances), np.float64)
    count = len(codes)
    scores: np.ndarray = np.full((count, classes), -np.inf)
    order = content_order(examples) if count > _MOST and len(examples) else np.arange(count)
    for start in range(min(count, _MOST)):
        out = np.sort(order[start::_MOST])
        rest = np.delete(np.arange(count), out)
        known, asked = ([examples[i] for i in some.tolist()] if len(examples) else () for some in (rest, out))
        within, block = distances[np.ix_(rest, rest)], distances[np.ix_(out, rest)]
        state = classifier.fit(known, codes[rest], classes, within, np.arange(len(rest)))
        there = np.isfinite(nearest_of(block, codes[rest], classes)[0])
        scores[out] = np.where(there, classifier.scores(state, asked, block), -np.inf)
    return scores


def nearest_of(distances: np.ndarray, codes: np.ndarray, classes: int) -> tuple[np.ndarray, np.ndarray]:
    """(Q, C) distance to the nearest example of each class, and which one that is; infinity without any."""
    nearest: np.ndarray = np.full((len(distances), classes), np.inf)
    firsts = np.full((len(distances), classes), len(codes))
    rows = np.arange(len(distances))
    for code in np.unique(codes):
        own = np.flatnonzero(codes == code)
        firsts[:, code] = own[distances[:, own].argmin(axis=1)]
        nearest[:, code] = distances[rows, firsts[:, code]]
    return nearest, firsts


def landmarks(series: Series, codes: np.ndarray, chosen: ClassifySettings) -> np.ndarray:
    """Indices of the examples with the given (N,) codes that the others have to be compared with.

    All of them, or as many as ``classify.landmarks`` allows: of each class its share, one at least, evenly
    spread over the `content_order` of ``series``. A Nystrom approximation (Williams and Seeger 2001) of the
    similarities among all.
    """
    return _spread(series, codes, chosen, chosen.landmarks)


def teaching(series: Series, codes: np.ndarray, settings: Settings) -> np.ndarray:
    """Indices of the examples with the given (N,) codes that are learned from.

    All of them; but where they are compared with the landmarks for it, `_TEACHING` times as many as these at
    most, spread in the same way.
    """
    chosen = settings.classify
    most = _TEACHING * chosen.landmarks if needs_distances(settings) else len(codes)
    return _spread(series, codes, chosen, most)


def _spread(series: Series, codes: np.ndarray, chosen: ClassifySettings, most: int) -> np.ndarray:
    """All indices, or about ``most``: of each class its share, one at least, evenly spread."""
    if chosen.votes or chosen.representative or len(codes) <= most:
        return np.arange(len(codes))
    marks, order = [], content_order(series) if len(series) else np.arange(len(codes))
    for code in np.unique(codes):
        own = order[codes[order] == code]
        count = max(1, most * len(own) // len(codes))
        marks.append(own[np.linspace(0, len(own) - 1, count).round().astype(int)])
    return np.sort(np.concatenate(marks))


def content_order(series: Series) -> np.ndarray:
    """Indices of ``series`` in an order of their own, whatever the one in which they are given.

    That of a random projection of each: unlike the order of a hash it does not turn over where a last digit
    differs, as between machines, and what is added moves the others by one place at most.
    """
    weights = np.random.default_rng(0).normal(size=resampled(series[0], _FRAMES).shape)
    return np.argsort([np.sum(weights * resampled(item, _FRAMES)) for item in series], kind="stable")


def resampled(item: Signals | np.ndarray, frames: int) -> np.ndarray:
    """(D, frames) float64 by linear interpolation from the first frame to the last one; zero where absent."""
    values = np.asarray(item.values if isinstance(item, Signals) else item, np.float64)
    if isinstance(item, Signals):
        values = np.where(np.asarray(item.present), values, 0.0)
    places = np.linspace(0, len(values) - 1, frames)
    before = np.minimum(places.astype(int), len(values) - 1)
    after, share = np.minimum(before + 1, len(values) - 1), (places - places.astype(int))[:, None]
    found: np.ndarray = (values[before] * (1 - share) + values[after] * share).T
    return found


def needs_distances(settings: Settings) -> bool:
    """Whether what is fitted needs the distances among the examples."""
    chosen = settings.classify
    calibrates = chosen.reject_sd is not None or chosen.confidence is not None
    return chosen.representative or calibrates or choose_classifier(settings).compares


def learn(
    settings: Settings, series: Series, codes: np.ndarray, classes: int, within: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray | None, Fitted]:
    """What the settings ask for of N examples with the given (N,) codes, 0 to ``classes - 1``.

    ``within`` are the (N, M) distances of all of them to their `landmarks`, row example as the query; those
    of an example to itself are ignored. `needs_distances` tells where they may be left out. A class may
    have no example. ``series`` may be empty where the classifier looks at distances alone.

    Returns
    -------
    kept : (K,) int64
        The examples that queries are compared with: the landmarks, or the medoid of each class.
    thresholds : (C,) float array or None
        Largest distance at which each class gives its label.
    fitted : Fitted

    Raises
    ------
    ConfigError
        E_REJECT where a threshold cannot be calibrated, E_NEIGHBORS where more neighbours are to vote than
        there are examples.
    """
    chosen = settings.classify
    kept = landmarks(series, codes, chosen)
    thresholds = None if chosen.reject is None else np.full(classes, chosen.reject)
    if within is not None and chosen.representative:
        kept = medoids(within, codes)
        within = within[:, kept]
    if within is not None and chosen.reject_sd is not None:
        own = calibrated_thresholds(within, codes, classes, chosen.reject_sd, kept)
        thresholds = own if thresholds is None else np.minimum(thresholds, own)
    if chosen.votes > len(kept):
        raise ConfigError(
            f"{chosen.votes} neighbours were asked for and there are {len(kept)} examples",
            remedy=f"classify.neighbors between 1 and {len(kept)}",
            code="E_NEIGHBORS",
        )
    marks = kept
    if chosen.representative:  # the medoids alone, as if there were no other examples
        within = None if within is None else within[kept]
        codes, series, marks = codes[kept], [series[i] for i in kept] if series else (), np.arange(len(kept))
    return kept, thresholds, Fitted.fit(settings, series, codes, classes, within, marks)
