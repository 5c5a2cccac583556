"""`GestureClassifier`: the whole decision behind the names of scikit-learn, which it does not need."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from inspect import signature
from typing import Any

import numpy as np

from gesture_core.classify.comparison import check_alike, check_settings, compare, is_still
from gesture_core.classify.decide import decide
from gesture_core.classify.library import ExampleLibrary, medoids
from gesture_core.classify.neighbors import Votes, k_nearest, votes_of
from gesture_core.classify.rejection import calibrated_thresholds, refusals
from gesture_core.classify.weighing import Weighing, learn_weights
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.plugin import registry
from gesture_core.settings import DEFAULT_PRESET, Settings, load_settings
from gesture_core.signals.chain import Chain
from gesture_core.types import PoseSequence, Prediction, SignalBatch, Signals

# Examples are compared with each other in blocks of so many rows at most, and of about so many seconds.
_MOST_ROWS, _SECONDS = 256, 2.0

Item = PoseSequence | Signals | np.ndarray


class GestureClassifier:
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
        it to the preset.
    rejected_label : object
        What `predict` answers where it gives no label: None, or a label of your own for metrics
        that compare strings.

    Attributes
    ----------
    n_neighbors_ : int
        Examples that vote; 0 where all of them decide.
    settings_ : Settings
        What `fit` resolved; later changes of files and of the environment do not reach it.
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
    as they are. All elements have the same channels, and are all arrays or none is.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core import GestureClassifier
    >>> up, down = np.linspace(0, 1, 20)[:, None], np.linspace(1, 0, 25)[:, None]
    >>> GestureClassifier(kernel="numpy").fit([up, down], ["up", "down"]).predict([up[::2]]).tolist()
    ['up']
    """

    _estimator_type = "classifier"

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

        Raises
        ------
        GestureError
            Where an example cannot be used; the message names it.
        """
        if len(X) != len(y):
            raise InputError(f"{len(X)} examples and {len(y)} labels", code="E_EXAMPLES")
        self.settings_ = settings = self._resolve()
        check_settings(settings)
        self.n_neighbors_ = settings.classify.neighbors if self.n_neighbors is None else self.n_neighbors
        library = ExampleLibrary.of(self.signals(X), list(y), names)
        _check_series(library.series, "example")
        if settings.classify.kernel != "auto":
            registry().find("kernel", settings.classify.kernel)
        indices = np.arange(len(library))
        limit, calibrated = self._rejection(settings, library)
        self.thresholds_: np.ndarray | None = None
        self.weighing_: Weighing | None = None
        if settings.classify.representative or calibrated or self.n_neighbors_ == 0:
            within = self._among(library.series, alive)
            if calibrated:
                sd = settings.classify.reject_sd
                codes, count = library.codes, len(library.classes)
                self.thresholds_ = calibrated_thresholds(within, codes, count, 3.0 if sd is None else sd)
            if settings.classify.representative:
                indices = medoids(within, library.codes)
            if self.n_neighbors_ == 0:
                codes, count = library.codes[indices], len(library.classes)
                sharpness, shrinkage = settings.classify.sharpness, settings.classify.shrinkage
                among = within[np.ix_(indices, indices)]
                self.weighing_ = learn_weights(among, codes, count, sharpness, shrinkage)
        if not 0 <= self.n_neighbors_ <= len(indices):
            raise ConfigError(
                f"{self.n_neighbors_} neighbours were asked for and there are {len(indices)} examples",
                remedy=f"n_neighbors from 0, for all of them, to {len(indices)}",
                code="E_NEIGHBORS",
            )
        if limit is not None:
            limits = np.full(len(library.classes), limit)
            self.thresholds_ = limits if self.thresholds_ is None else np.minimum(self.thresholds_, limits)
        self.library_ = library.take(indices)
        self.example_indices_ = indices
        self.classes_ = self.library_.classes
        return self

    def predict(self, X: Sequence[Item]) -> np.ndarray:
        """(Q,) labels, of the type of ``y``; ``rejected_label`` (in an object array) where no label is
        warranted: nothing moves, or the nearest example is too far.

        Raises
        ------
        GestureError
            Where a query cannot be used. `predictions` gives it a row instead.
        """
        signals = self.signals(X)
        votes = self._votes(self.distances(signals))
        for index in np.flatnonzero(votes.winners < 0):
            if not is_still(signals[index]):
                raise InputError(
                    f"query {index} has no dimension in common with any example",
                    remedy="predictions() gives it a row instead",
                    code="E_NO_COMMON",
                )
        labels = self.classes_[votes.winners]
        limits, margin = self.thresholds_, self._settings().classify.margin
        refused = (votes.winners < 0) | (np.array(refusals(votes, limits, margin), str) != "")
        if refused.any():
            labels = labels.astype(object)
            labels[refused] = self.rejected_label
        return labels

    def predictions(self, X: Sequence[Item]) -> list[Prediction]:
        """One `Prediction` for each query: label, distance, margin, neighbours, or why there is none."""
        self._check_fitted()
        out: list[Prediction | None] = [None] * len(X)
        usable: list[Signals | np.ndarray] = []
        places = []
        chain = self._chain()
        for place, item in enumerate(X):
            try:
                series = chain(item) if isinstance(item, PoseSequence) else item
                _check_series([self.library_.series[0], series], "query")
                usable.append(series)
                places.append(place)
            except GestureError as error:
                out[place] = Prediction(None, "error", code=error.code, message=error.message)
        if usable:
            distances = self._distances(usable, self.library_.series)
            margin = self._settings().classify.margin
            decided = decide(
                distances, usable, self.library_, self.n_neighbors_, self.thresholds_, self.weighing_, margin
            )
            for place, prediction in zip(places, decided, strict=True):
                out[place] = prediction
        return [prediction for prediction in out if prediction is not None]

    def kneighbors(self, X: Sequence[Item], n_neighbors: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(Q, k) distances and indices into the ``X`` of `fit`, nearest first."""
        near = k_nearest(self.distances(X), max(1, self.n_neighbors_) if n_neighbors is None else n_neighbors)
        return near.distances, self.example_indices_[near.indices]

    def score(self, X: Sequence[Item], y: Sequence[object]) -> float:
        """Share of queries whose label is right; a rejected query is not."""
        return float(np.mean([a == b for a, b in zip(self.predict(X), y, strict=True)]))

    def distances(self, X: Sequence[Item]) -> np.ndarray:
        """(Q, N) warping distances to the examples of `library_`."""
        self._check_fitted()
        return self._distances(self.signals(X), self.library_.series)

    def signals(self, X: Sequence[Item]) -> list[Signals | np.ndarray]:
        """``X`` as the chain of the preset sees it; Signals and arrays pass unchanged."""
        chain = self._chain()
        return [chain(item) if isinstance(item, PoseSequence) else item for item in X]

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The parameters of the constructor (scikit-learn)."""
        return {name: getattr(self, name) for name in signature(type(self)).parameters}

    def set_params(self, **params: Any) -> GestureClassifier:
        """Change parameters of the constructor (scikit-learn)."""
        for name, value in params.items():
            if name not in self.get_params():
                raise ConfigError(f"GestureClassifier has no parameter {name!r}", code="E_OPTION")
            setattr(self, name, value)
        return self

    def __sklearn_tags__(self) -> Any:
        """Tags that scikit-learn asks for; only it calls this, so it is installed."""
        from sklearn.utils import ClassifierTags, InputTags, Tags, TargetTags

        return Tags(
            estimator_type="classifier",
            target_tags=TargetTags(required=True),
            classifier_tags=ClassifierTags(),
            input_tags=InputTags(two_d_array=False, three_d_array=True, allow_nan=True),
        )

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "library_")

    def __repr__(self) -> str:
        preset = self.preset.preset if isinstance(self.preset, Settings) else self.preset
        return f"GestureClassifier(preset={preset!r}, kernel={self.kernel!r}, n_neighbors={self.n_neighbors})"

    def _settings(self) -> Settings:
        return self.settings_ if hasattr(self, "settings_") else self._resolve()

    def _resolve(self) -> Settings:
        settings = self.preset if isinstance(self.preset, Settings) else load_settings(self.preset)
        if self.kernel != "auto":
            settings = replace(settings, classify=replace(settings.classify, kernel=self.kernel))
        return settings

    def _chain(self) -> Chain:
        return Chain.from_settings(self._settings())

    def _votes(self, distances: np.ndarray) -> Votes:
        return votes_of(distances, self.library_.codes, len(self.classes_), self.n_neighbors_, self.weighing_)

    def _rejection(self, settings: Settings, library: ExampleLibrary) -> tuple[float | None, bool]:
        """The largest distance that gets a label, and whether each class has a calibrated one as well."""
        chosen = settings.classify
        if self.reject is None:
            # A preset's distance is in the unit of its own chain; it says nothing of bare arrays.
            known = all(isinstance(item, Signals) for item in library.series)
            return (chosen.reject if known else None), chosen.reject_sd is not None
        if isinstance(self.reject, str):
            if self.reject != "calibrated":
                raise ConfigError(
                    f"reject={self.reject!r}", remedy="a distance or 'calibrated'", code="E_REJECT"
                )
            return None, True
        return float(self.reject), False

    def _distances(
        self, queries: Sequence[Signals | np.ndarray], examples: Sequence[Signals | np.ndarray]
    ) -> np.ndarray:
        return compare(queries, examples, self._settings())

    def _among(self, series: Sequence[Signals | np.ndarray], alive: Callable[[], None]) -> np.ndarray:
        """(N, N) distances among the examples, as many rows at a time as a kernel does in seconds."""
        blocks: list[np.ndarray] = []
        start, rows = 0, 1
        while start < len(series):
            begun = time.monotonic()
            blocks.append(self._distances(series[start : start + rows], series))
            alive()
            start += rows
            rows = max(1, min(_MOST_ROWS, int(rows * _SECONDS / max(time.monotonic() - begun, 1e-3))))
        return np.concatenate(blocks)

    def _check_fitted(self) -> None:
        if not hasattr(self, "library_"):
            raise InputError(
                "the classifier has no examples yet", remedy="fit(X, y) first", code="E_EXAMPLES"
            )


def _check_series(series: Sequence[Signals | np.ndarray], name: str) -> None:
    """An InputError where ``series`` are not of one kind and width, or bare arrays are no numbers."""
    check_alike(series, name)
    if not isinstance(series[0], Signals):
        SignalBatch.of(series, np.float64, name=name)
