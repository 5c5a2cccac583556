"""`GestureClassifier`: a `Recognizer` as a scikit-learn classifier."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.exceptions import NotFittedError

from gesture_core.classify.comparison import is_still
from gesture_core.classify.decision import k_nearest, probabilities, refusals, votes_of
from gesture_core.classify.examples import ExampleLibrary
from gesture_core.classify.learning import ExampleWeights
from gesture_core.classify.recognizer import Item, Recognizer, sequence_of, signals_of
from gesture_core.errors import ConfigError, InputError
from gesture_core.files import printable
from gesture_core.records import Prediction
from gesture_core.settings import DEFAULT_PRESET, Settings, load_settings, settings_from_dict
from gesture_core.settings.schema import SECTIONS
from gesture_core.types import PoseSequence, Signals

if TYPE_CHECKING:
    from sklearn.utils import Tags


class GestureClassifier(ClassifierMixin, BaseEstimator):
    """Nearest examples by warping distance (Schneider et al. 2019, and what came after it).

    Parameters
    ----------
    preset : str or Settings
        Name of a preset, a TOML file, or ready settings.
    kernel : str
        Distance kernel; ``auto`` leaves the choice to the preset, then to the machine.
    n_neighbors : int, optional
        Examples that vote; 0: all of them decide, weighted. The preset's number by default.
    reject : float or "calibrated" or None
        Largest distance that gets a label; ``"calibrated"`` takes mean + ``reject_sd`` (of the
        preset, otherwise 3) standard deviations of the distances inside each class. None leaves
        it to the preset, whose largest distance is one of signals and is not asked of bare arrays.
    rejected_label : object, optional
        What `predict` answers where it gives no label: of the type of the labels, and none of them. By
        default "(none)" for texts and -1 for numbers (one less than the least label, where that is a label),
        so that any metric takes it as one more class.
    settings : mapping, optional
        Settings by their names, such as ``{"classify.mirror": 1.2}``, above those of the preset.
        ``set_params(classify__mirror=1.2)`` changes one, as a grid search does.

    Attributes
    ----------
    n_neighbors_ : int
        Examples that vote; 0 where scores decide.
    settings_ : Settings
        What `fit` resolved, with ``kernel``, ``n_neighbors`` and ``reject`` in their places; later
        changes of files and of the environment do not reach it.
    classes_ : (C,) array
        The labels, each once, sorted.
    library_ : ExampleLibrary
        The examples that queries are compared with.
    example_indices_ : (N,) int64
        Where each of them stood in the ``X`` of `fit`.
    thresholds_ : (C,) float array or None
        Rejection threshold of each class.
    weights_ : ExampleWeights or None
        How much each example of `library_` counts for each class, of ``weighed`` and its part of ``blend``.
    rejected_label_ : object
        What `predict` answers where it gives no label.

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
        settings: Mapping[str, object] | None = None,
    ) -> None:
        self.preset = preset
        self.kernel = kernel
        self.n_neighbors = n_neighbors
        self.reject = reject
        self.rejected_label = rejected_label
        self.settings = settings

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
        settings, X = self._resolve(), sequence_of(X)
        if self.reject is None and len(X) > 0 and not isinstance(next(iter(X)), PoseSequence | Signals):
            # A preset's distance is in the unit of its own chain, which bare arrays do not have.
            settings = replace(settings, classify=replace(settings.classify, reject=None))
        fitted = Recognizer.fit(settings, X, y, names, alive=alive, stacklevel=2)
        return self._take(fitted)

    def _take(self, fitted: Recognizer) -> GestureClassifier:
        """Be fitted."""
        settings = fitted.settings
        self.rejected_label_: object = _sentinel(self.rejected_label, fitted.library.classes)
        self._recognizer = fitted
        self.settings_: Settings = settings
        self.n_neighbors_: int = settings.classify.votes
        self.thresholds_: np.ndarray | None = fitted.thresholds
        self.weights_: ExampleWeights | None = fitted.weights
        self.library_: ExampleLibrary = fitted.library
        self.example_indices_: np.ndarray = fitted.kept
        self.classes_: np.ndarray = fitted.library.classes
        return self

    def predict(self, X: Sequence[Item]) -> np.ndarray:
        """(Q,) labels, of the type of ``y``; `rejected_label_` where no label is warranted: nothing
        moves, or the nearest example is too far.

        Raises
        ------
        GestureError
            Where a query cannot be used. `predictions` gives it a row instead.
        """
        self._check_fitted()
        signals = self.signals(X)
        votes = votes_of(self._recognizer.fitted, self.distances(signals), signals)
        for index in np.flatnonzero(votes.winners < 0):
            if not is_still(signals[index]):
                raise InputError(
                    f"query {index} has no dimension in common with any example",
                    remedy="predictions() gives it a row instead",
                    code="E_NO_COMMON",
                )
        codes = refusals(votes, self.thresholds_, self.settings_.classify)
        labels: np.ndarray = self.classes_[votes.winners]
        refused = np.array(codes, str) != ""
        return np.where(refused, np.asarray(self.rejected_label_), labels) if refused.any() else labels

    def decision_function(self, X: Sequence[Item]) -> np.ndarray:
        """(Q, C) score of each of `classes_`, higher for what is more alike; of two classes (Q,), that of the
        second one less that of the first, as scikit-learn has it.

        Up to about 1 for the right class and about 0 for others. Of the classifier ``nearest``, minus the
        distance to the nearest example of each class; of several neighbours, their votes. Minus infinity for
        a class that cannot be compared. Whether `predict` would refuse a label does not count.
        """
        scores = self._scores(X)
        return scores[:, 1] - scores[:, 0] if scores.shape[1] == 2 else scores

    def predict_proba(self, X: Sequence[Item]) -> np.ndarray:
        """(Q, C) probability of each of `classes_`, if the query is one of them.

        The softmax of the scores at a temperature that is calibrated on the examples, each of which is
        left out once (Guo et al. 2017); the first call computes it. Whether `predict` would refuse a
        label does not count. Equal shares where a query can be compared with nothing.

        Raises
        ------
        InputError
            Where no class has two examples.
        """
        return probabilities(self._scores(X), self._recognizer.temperature)

    def _scores(self, X: Sequence[Item]) -> np.ndarray:
        self._check_fitted()
        return self._recognizer.scores(self.signals(X))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the fitted classifier to a file, without pickle: its examples, settings and parameters.

        Raises
        ------
        InputError
            Where labels are neither texts nor numbers, or the file cannot be written.
        """
        self._check_fitted()
        parameters = {name: _plain(value) for name, value in self.get_params(deep=False).items()}
        try:
            self._recognizer.save(Path(path), {"parameters": parameters})
        except OSError as error:
            cause = f"cannot be written: {error.strerror}"
            raise InputError(cause, subject=printable(path), remedy="another path") from error

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> GestureClassifier:
        """A classifier that `save` wrote. The file need not be trusted: reading it runs no code of it.

        Raises
        ------
        InputError
            Where there is no such file, it is another one, or damaged.
        """
        fitted, facts = Recognizer.load(Path(path))
        try:
            parameters = dict(facts["parameters"])
            if isinstance(parameters["preset"], dict):
                chosen = settings_from_dict(parameters["preset"]["settings"])
                parameters["preset"] = replace(chosen, preset=str(parameters["preset"]["preset"]))
            if isinstance(parameters["rejected_label"], dict):
                parameters["rejected_label"] = bytes.fromhex(parameters["rejected_label"]["bytes"])
            return cls(**parameters)._take(fitted)
        except (KeyError, TypeError, ValueError) as error:
            cause = f"holds no classifier that save() wrote: {error}"
            raise InputError(cause, subject=printable(path), code="E_INPUT") from error

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The parameters; with ``deep`` every setting as well, as ``classify__mirror``."""
        found: dict[str, Any] = super().get_params(deep=False)
        if deep:
            resolved = self._resolve()
            for section in SECTIONS:
                values = vars(getattr(resolved, section))
                found |= {f"{section}__{name}": value for name, value in values.items()}
        return found

    def set_params(self, **params: Any) -> GestureClassifier:
        """Change parameters, and settings by names such as ``classify__mirror`` or ``gaussian__sigma``."""
        super().set_params(**{name: value for name, value in params.items() if "__" not in name})
        changes = {name.replace("__", "."): value for name, value in params.items() if "__" in name}
        if changes:
            load_settings().with_values(
                _plain(changes).items(), "set_params"
            )  # a misspelt one is refused now
            self.settings = {**(self.settings or {}), **changes}
        return self

    def predictions(self, X: Sequence[Item]) -> list[Prediction]:
        """One `Prediction` for each query: label, distance, margin, neighbours, or why there is none.

        Raises
        ------
        GestureError
            Where the settings or the distance kernel are at fault, and not a query.
        """
        self._check_fitted()
        return self._recognizer.predictions(X)

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
        return self._recognizer.distances(self.signals(X))

    def signals(self, X: Sequence[Item]) -> list[Signals | np.ndarray]:
        """``X`` as the chain of the preset sees it; Signals and arrays pass unchanged."""
        fitted = self.__sklearn_is_fitted__()
        return signals_of(X, self.settings_ if fitted else self._resolve(), "sequence")

    def _resolve(self) -> Settings:
        """The settings of the next `fit`: those of the preset, overruled by the other parameters."""
        settings = self.preset if isinstance(self.preset, Settings) else load_settings(self.preset)
        settings = settings.with_values(_plain(self.settings or {}).items(), "settings")
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
        if isinstance(self.reject, str) and self.reject == "calibrated":
            sd = settings.classify.reject_sd
            changes |= {"reject": None, "reject_sd": 3.0 if sd is None else sd}
        elif self.reject is not None:
            number = isinstance(self.reject, Real) and not isinstance(self.reject, bool)
            if not number or np.isnan(self.reject):
                raise ConfigError(
                    f"reject={self.reject!r}", remedy="a distance or 'calibrated'", code="E_REJECT"
                )
            changes |= {"reject": float(self.reject), "reject_sd": None}
        return replace(settings, classify=replace(settings.classify, **changes))

    def _check_fitted(self) -> None:
        if not self.__sklearn_is_fitted__():
            raise _NotFitted(
                "the classifier has no examples yet", remedy="fit(X, y) first", code="E_EXAMPLES"
            )

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "library_")

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.input_tags.three_d_array = True
        tags.input_tags.allow_nan = True
        return tags


class _NotFitted(InputError, NotFittedError):
    """What scikit-learn and its users expect of a classifier without examples."""


def _plain(value: Any) -> Any:
    """A parameter as JSON holds it; what NumPy calls a number is one."""
    if isinstance(value, Settings):
        return {"preset": value.preset, "settings": value.as_dict()}
    if isinstance(value, Mapping):
        return {name: _plain(own) for name, own in value.items()}
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    return {"bytes": value.hex()} if isinstance(value, bytes) else value


def _sentinel(given: object, classes: np.ndarray) -> object:
    """What stands for no label beside ``classes``.

    Raises
    ------
    ConfigError
        E_LABELS where it is one of them, or of another type, or there is no such value.
    """
    numbers, kind = set("biuf"), classes.dtype.kind
    if given is None:
        value = {"U": "(none)", "S": b"(none)", "f": -1.0}.get(kind, -1 if kind in numbers else None)
        if kind in numbers and value in classes:
            value = classes.min().item() - 1
    else:
        value, own = given, np.asarray(given)
        if own.ndim > 0 or not (own.dtype.kind == kind or {own.dtype.kind, kind} <= numbers):
            cause = f"rejected_label = {given!r} beside labels of type {classes.dtype}"
            raise ConfigError(cause, remedy="one of the type of the labels", code="E_LABELS")
    if value in classes.tolist():
        cause = f"{value!r} is a label, and what stands for none"
        raise ConfigError(cause, remedy="rejected_label with another value", code="E_LABELS")
    return value
