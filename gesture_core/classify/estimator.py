"""`GestureClassifier`: the whole decision behind the names of scikit-learn, which it does not need."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from numbers import Integral, Real
from typing import Any

import numpy as np

from gesture_core.classify.comparison import check_alike, check_settings, compare, is_still
from gesture_core.classify.decide import decide
from gesture_core.classify.habits import ClassifierHabits
from gesture_core.classify.labels import warn_of_contradictions
from gesture_core.classify.library import ExampleLibrary, medoids
from gesture_core.classify.neighbors import Votes, k_nearest, votes_of
from gesture_core.classify.rejection import calibrated_thresholds, refusals
from gesture_core.classify.weighing import Weighing, weighing_of
from gesture_core.errors import ConfigError, GestureError, InputError, WarpingError
from gesture_core.plugin import registry
from gesture_core.settings import DEFAULT_PRESET, Settings, load_settings
from gesture_core.signals.chain import Chain
from gesture_core.types import PoseSequence, Prediction, SignalBatch, Signals

# Examples are compared with each other in blocks of so many rows at most, and of about so many seconds.
_MOST_ROWS, _SECONDS = 256, 2.0

Item = PoseSequence | Signals | np.ndarray


class GestureClassifier(ClassifierHabits):
    """Nearest examples by warping distance (Schneider et al. 2019, and what came after it).

    Parameters
    ----------
    preset : str or Settings
        Name of a preset, a TOML file, or ready settings.
    kernel : str
        Distance kernel; ``auto`` leaves the choice to the preset, then to the machine.
    n_neighbors : int, optional
        Examples that vote; 0: all of them, weighed. The preset's number by default.
    reject : float or "calibrated" or None
        Largest distance that gets a label; ``"calibrated"`` takes mean + ``reject_sd`` (of the
        preset, otherwise 3) standard deviations of the distances inside each class. None leaves
        it to the preset, whose largest distance is one of signals and is not asked of bare arrays.
    rejected_label : object
        What `predict` answers where it gives no label: None, or a label of your own for metrics
        that compare strings.

    Attributes
    ----------
    n_neighbors_ : int
        Examples that vote; 0 where all of them decide.
    settings_ : Settings
        What `fit` resolved, ``kernel`` and ``n_neighbors`` included; later changes of files and of the
        environment do not reach it.
    classes_ : (C,) array
        The labels, each once, sorted.
    library_ : ExampleLibrary
        The examples that queries are compared with.
    example_indices_ : (N,) int64
        Where each of them stood in the ``X`` of `fit`.
    thresholds_ : (C,) float array or None
        Rejection threshold of each class.
    weighing_ : Weighing or None
        What each example of `library_` says for each class, where all of them decide.

    Notes
    -----
    ``X`` is a sequence of `PoseSequence`, of `Signals`, or of (T, D) arrays, which are compared
    as they are, in float64. All elements have the same channels, and are all arrays or none is.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core import GestureClassifier
    >>> up, down = np.linspace(0, 1, 20)[:, None], np.linspace(1, 0, 25)[:, None]
    >>> GestureClassifier(kernel="numpy").fit([up, down], ["up", "down"]).predict([up[::2]]).tolist()
    ['up']
    """

    def __init__(
        self,
        preset: str | Settings = DEFAULT_PRESET,
        kernel: str = "auto",
        n_neighbors: int | None = None,
        reject: float | str | None = None,
        rejected_label: object = None,
    ) -> None:
        self.preset = preset
        self.kernel = kernel
        self.n_neighbors = n_neighbors
        self.reject = reject
        self.rejected_label = rejected_label

    def fit(
        self,
        X: Sequence[Item],
        y: Sequence[object],
        names: Sequence[str] | None = None,
        *,
        alive: Callable[[], None] = lambda: None,
    ) -> GestureClassifier:
        """Keep ``X`` as examples with the labels ``y``.

        Where all examples decide, or a threshold or representatives are asked for, every example is
        compared with every other one; ``alive`` is called while that goes on.

        Warns
        -----
        UserWarning
            Where equal examples have different labels.

        Raises
        ------
        GestureError
            Where an example or a label cannot be used; the message names it. A fitted classifier
            then stays as it was.
        """
        if len(X) != len(y):
            raise InputError(f"{len(X)} examples and {len(y)} labels", code="E_EXAMPLES")
        settings = self._resolve()
        check_settings(settings)
        chosen = settings.classify
        library = ExampleLibrary.of(_through(Chain.from_settings(settings), X, "example"), list(y), names)
        check_alike(library.series, "example")
        if not isinstance(library.series[0], Signals):
            SignalBatch.of(library.series, np.float64, name="example")
            # One precision whatever a query has, so that no row depends on the others of its batch.
            library = replace(library, series=tuple(np.array(item, np.float64) for item in library.series))
        if chosen.kernel != "auto":
            registry().find("kernel", chosen.kernel)
        codes, count = library.codes, len(library.classes)
        _check_neighbors(chosen.neighbors, count if chosen.representative else len(library))
        limit, calibrated = self._rejection(settings, library)
        warn_of_contradictions(library.series, library.labels, library.names, stacklevel=2)
        indices = np.arange(len(library))
        thresholds = None if limit is None else np.full(count, limit)
        weighing = None
        if chosen.representative or calibrated or chosen.neighbors == 0:
            within = _among(library.series, settings, alive)
            if chosen.representative:
                indices = medoids(within, codes)
            if calibrated:
                sd = 3.0 if chosen.reject_sd is None else chosen.reject_sd
                own = calibrated_thresholds(within, codes, count, sd, indices)
                thresholds = own if thresholds is None else np.minimum(thresholds, own)
            weighing = weighing_of(within[np.ix_(indices, indices)], codes[indices], count, chosen)
        self.settings_: Settings = settings
        self.n_neighbors_: int = chosen.neighbors
        self.thresholds_: np.ndarray | None = thresholds
        self.weighing_: Weighing | None = weighing
        self.library_: ExampleLibrary = library.take(indices)
        self.example_indices_: np.ndarray = indices
        self.classes_: np.ndarray = self.library_.classes
        return self

    def predict(self, X: Sequence[Item]) -> np.ndarray:
        """(Q,) labels, of the type of ``y``; ``rejected_label`` where no label is warranted: nothing
        moves, or the nearest example is too far. One of another type makes it an array of objects.

        Raises
        ------
        GestureError
            Where a query cannot be used. `predictions` gives it a row instead.
        """
        self._check_fitted()
        signals = self.signals(X)
        votes = self._votes(self.distances(signals))
        for index in np.flatnonzero(votes.winners < 0):
            if not is_still(signals[index]):
                raise InputError(
                    f"query {index} has no dimension in common with any example",
                    remedy="predictions() gives it a row instead",
                    code="E_NO_COMMON",
                )
        codes = refusals(votes, self.thresholds_, self.settings_.classify.margin)
        return self._labels(votes.winners, np.array(codes, str) != "")

    def predictions(self, X: Sequence[Item]) -> list[Prediction]:
        """One `Prediction` for each query: label, distance, margin, neighbours, or why there is none.

        Raises
        ------
        GestureError
            Where the settings or the distance kernel are at fault, and not a query.
        """
        self._check_fitted()
        out: dict[int, Prediction] = {}
        usable: list[tuple[int, Signals | np.ndarray]] = []
        chain = self._chain()
        for place, item in enumerate(X):
            try:
                usable += [(place, series) for series in _through(chain, [item], "query", place)]
            except GestureError as error:
                out[place] = Prediction(None, "error", code=error.code, message=error.message)
        out.update(self._decided(usable))
        return [out[place] for place in sorted(out)]

    def _decided(self, queries: Sequence[tuple[int, Signals | np.ndarray]]) -> dict[int, Prediction]:
        """A prediction for each query by its place; halves of what cannot be compared, down to one."""
        if not queries:
            return {}
        series = [item for _, item in queries]
        try:
            distances = compare(series, self.library_.series, self.settings_)
        except (InputError, WarpingError) as error:
            if len(queries) > 1:
                half = len(queries) // 2
                return self._decided(queries[:half]) | self._decided(queries[half:])
            place = queries[0][0]
            # Alone it was the first of its batch.
            message = error.message.replace("query 0", f"query {place}")
            return {place: Prediction(None, "error", code=error.code, message=message)}
        decided = decide(
            distances,
            series,
            self.library_,
            self.n_neighbors_,
            self.thresholds_,
            self.weighing_,
            self.settings_.classify.margin,
        )
        return {place: prediction for (place, _), prediction in zip(queries, decided, strict=True)}

    def kneighbors(self, X: Sequence[Item], n_neighbors: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(Q, k) distances and indices into the ``X`` of `fit`, nearest first."""
        near = k_nearest(self.distances(X), max(1, self.n_neighbors_) if n_neighbors is None else n_neighbors)
        return near.distances, self.example_indices_[near.indices]

    def score(
        self, X: Sequence[Item], y: Sequence[object], sample_weight: Sequence[float] | None = None
    ) -> float:
        """Share of queries, weighted where asked for, whose label is right; a rejected one's is not."""
        if len(X) == 0 or len(X) != len(y):
            raise InputError(f"{len(X)} queries and {len(y)} labels to score", code="E_EXAMPLES")
        right = [a == b for a, b in zip(self.predict(X), y, strict=True)]
        return float(np.average(right, weights=sample_weight))

    def distances(self, X: Sequence[Item]) -> np.ndarray:
        """(Q, N) warping distances to the examples of `library_`."""
        self._check_fitted()
        return compare(self.signals(X), self.library_.series, self.settings_)

    def signals(self, X: Sequence[Item]) -> list[Signals | np.ndarray]:
        """``X`` as the chain of the preset sees it; Signals and arrays pass unchanged."""
        return _through(self._chain(), X, "sequence")

    def __repr__(self) -> str:
        preset = self.preset.preset if isinstance(self.preset, Settings) else self.preset
        params = self.get_params() | {"preset": preset}
        return f"GestureClassifier({', '.join(f'{name}={value!r}' for name, value in params.items())})"

    def _settings(self) -> Settings:
        return self.settings_ if hasattr(self, "settings_") else self._resolve()

    def _resolve(self) -> Settings:
        """The settings of the next `fit`: those of the preset, with what the constructor says instead."""
        settings = self.preset if isinstance(self.preset, Settings) else load_settings(self.preset)
        changes: dict[str, Any] = {}
        if self.kernel != "auto":
            changes["kernel"] = self.kernel
        if self.n_neighbors is not None:
            if not isinstance(self.n_neighbors, Integral) or self.n_neighbors < 0:
                raise ConfigError(
                    f"n_neighbors={self.n_neighbors!r}",
                    remedy="a whole number, 0 for all examples",
                    code="E_NEIGHBORS",
                )
            changes["neighbors"] = int(self.n_neighbors)
        return replace(settings, classify=replace(settings.classify, **changes))

    def _chain(self) -> Chain:
        return Chain.from_settings(self._settings())

    def _votes(self, distances: np.ndarray) -> Votes:
        return votes_of(distances, self.library_.codes, len(self.classes_), self.n_neighbors_, self.weighing_)

    def _labels(self, winners: np.ndarray, refused: np.ndarray) -> np.ndarray:
        """The label of each winner, and ``rejected_label`` where one was refused."""
        labels = self.classes_[winners]
        if not refused.any():
            return labels
        instead = np.asarray(self.rejected_label)
        if instead.ndim == 0 and instead.dtype.kind == labels.dtype.kind:
            return np.where(refused, instead, labels)
        mixed = labels.astype(object)
        for index in np.flatnonzero(refused):
            mixed[index] = self.rejected_label
        return mixed

    def _rejection(self, settings: Settings, library: ExampleLibrary) -> tuple[float | None, bool]:
        """The largest distance that gets a label, and whether each class has a calibrated one as well."""
        chosen = settings.classify
        if self.reject is None:
            # A preset's distance is in the unit of its own chain; it says nothing of bare arrays.
            known = all(isinstance(item, Signals) for item in library.series)
            return (chosen.reject if known else None), chosen.reject_sd is not None
        if isinstance(self.reject, str) and self.reject == "calibrated":
            return None, True
        number = isinstance(self.reject, Real) and not isinstance(self.reject, bool)
        if not number or np.isnan(self.reject):
            raise ConfigError(f"reject={self.reject!r}", remedy="a distance or 'calibrated'", code="E_REJECT")
        return float(self.reject), False

    def _check_fitted(self) -> None:
        if not hasattr(self, "library_"):
            raise InputError(
                "the classifier has no examples yet", remedy="fit(X, y) first", code="E_EXAMPLES"
            )


def _through(chain: Chain, X: Sequence[Item], name: str, first: int = 0) -> list[Signals | np.ndarray]:
    """``X`` with keypoints made signals; an error says of which element, ``name`` and number, it is."""
    if isinstance(X, PoseSequence | Signals):
        raise InputError(f"one {type(X).__name__} instead of a sequence of them", remedy="a list: [it]")
    out: list[Signals | np.ndarray] = []
    for index, item in enumerate(X, first):
        try:
            out.append(chain(item) if isinstance(item, PoseSequence) else item)
        except GestureError as error:
            error.about(f"{name} {index}")
            raise
    return out


def _check_neighbors(wanted: int, examples: int) -> None:
    if wanted > examples:
        raise ConfigError(
            f"{wanted} neighbours were asked for and there are {examples} examples",
            remedy=f"n_neighbors from 0, for all of them, to {examples}",
            code="E_NEIGHBORS",
        )


def _among(
    series: Sequence[Signals | np.ndarray], settings: Settings, alive: Callable[[], None]
) -> np.ndarray:
    """(N, N) distances among the examples, as many rows at a time as a kernel does in seconds."""
    blocks: list[np.ndarray] = []
    start, rows = 0, 1
    while start < len(series):
        begun = time.monotonic()
        blocks.append(compare(series[start : start + rows], series, settings))
        alive()
        start += rows
        rows = max(1, min(_MOST_ROWS, int(rows * _SECONDS / max(time.monotonic() - begun, 1e-3))))
    return np.concatenate(blocks)
