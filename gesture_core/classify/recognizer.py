"""`Recognizer`: examples that are fitted under some settings, and what it predicts of queries.

`GestureClassifier` is the same behind scikit-learn's interface, whose import takes longer than most of
the comparisons of a run.
"""

from __future__ import annotations

import json
import os
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence, Set, Sized
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gesture_core.classify.balance import balanced
from gesture_core.classify.classifiers import (
    Fitted,
    Weighed,
    choose_classifier,
    landmarks,
    learn,
    needs_distances,
    teaching,
)
from gesture_core.classify.comparison import Comparison, check_alike, check_settings
from gesture_core.classify.decision import decide, temperature_of, votes_of
from gesture_core.classify.examples import ExampleLibrary, warn_of_contradictions
from gesture_core.classify.known import KnownDistances
from gesture_core.classify.learning import ExampleWeights
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.files import printable, read_arrays, write_arrays
from gesture_core.plugin import registry
from gesture_core.recordings import as_recording, columns_of
from gesture_core.records import Prediction
from gesture_core.settings import Settings, settings_from_dict
from gesture_core.signals.chain import Chain
from gesture_core.types import PoseSequence, Recording, SignalBatch, Signals

# Examples are compared with each other in blocks of so many rows at most, and of about so many seconds.
_MOST_ROWS, _SECONDS = 256, 2.0

_FORMAT = 3
_LARGEST = 4 << 30
"""Bytes of such a file, once unpacked."""
_LEARNED = "learned."
"""In front of the names of what a classifier has learned."""
_KINDS = "UifbS"
"""Kinds of labels that a file holds: texts, numbers, truth values, bytes."""

Item = PoseSequence | Recording | Signals | np.ndarray
"""Where ``signals.input`` is ``channels``, also a data frame."""


@dataclass(frozen=True, eq=False)
class Recognizer:
    """Fitted examples; made by `fit`.

    Attributes
    ----------
    settings : Settings
    library : ExampleLibrary
        The examples that queries are compared with.
    kept : (N,) int64
        Where each of them stood among those that were given.
    thresholds : (C,) float array or None
        Largest distance at which each class gives its label.
    fitted : Fitted
        What the classifier has learned; with a temperature where ``classify.confidence`` asks for it.
    comparison : Comparison
        With these examples.
    within : (N, N) array, optional
        Distances among them, where `fit` had to compute them.
    note : str
        What was not done with all examples, mostly empty.
    """

    settings: Settings
    library: ExampleLibrary
    kept: np.ndarray
    thresholds: np.ndarray | None
    fitted: Fitted
    comparison: Comparison
    within: np.ndarray | None = None
    note: str = ""

    @classmethod
    def fit(
        cls,
        settings: Settings,
        X: Sequence[Item],
        y: Sequence[object],
        names: Sequence[str] | None = None,
        *,
        alive: Callable[[], None] = lambda: None,
        known: KnownDistances | None = None,
        stacklevel: int = 1,
    ) -> Recognizer:
        """Keep ``X`` as examples with the labels ``y``; see `GestureClassifier.fit`.

        Pairs in ``known`` are not compared again; it learns those that are.
        """
        X, y = sequence_of(X), _listed(y, "y", "a list with one label for each example")
        if len(X) != len(y):
            raise InputError(f"{len(X)} examples and {len(y)} labels", code="E_EXAMPLES")
        check_settings(settings)
        _warn_of_axes(X, stacklevel + 1)
        chosen = settings.classify
        library = ExampleLibrary.of(signals_of(X, settings, "example"), list(y), names)
        check_alike(library.series, "example")
        if settings.classify.balance or settings.classify.weights:
            settings = balanced(library.series, settings)
        if not isinstance(library.series[0], Signals):
            SignalBatch.of(library.series, np.float64, name="example")
            # One precision whatever a query has, so that no row depends on the others of its batch.
            # Copied by NumPy, as what a tensor copies is warned of.
            copies = tuple(np.asarray(item).astype(np.float64) for item in library.series)
            library = replace(library, series=copies)
        if chosen.kernel != "auto":
            registry().find("kernel", chosen.kernel)
        most = len(library.classes) if chosen.representative else len(library)
        if chosen.votes > most:
            raise ConfigError(
                f"{chosen.votes} neighbours were asked for and there are {most} examples",
                remedy=f"n_neighbors from 0, for all of them, to {most}",
                code="E_NEIGHBORS",
            )
        warn_of_contradictions(library, stacklevel + 1)
        given, taught = len(library), teaching(library.series, library.codes, settings)
        if len(taught) < given:
            library = library.take(taught)
        marks = landmarks(library.series, library.codes, chosen)
        comparison = Comparison([library.series[i] for i in marks], settings, known)
        within = _among(library.series, comparison, alive) if needs_distances(settings) else None
        count = len(library.classes)
        kept, thresholds, fitted = learn(settings, library.series, library.codes, count, within)
        if len(kept) < len(library):
            if chosen.representative:
                comparison = Comparison([library.series[i] for i in kept], settings, known)
            within = None if within is None else within[np.ix_(kept, np.isin(marks, kept))]
            library = library.take(kept)
        note = ""
        if len(kept) < given and not chosen.representative:
            note = f"of {given} examples, inputs are compared with {len(kept)}, some of each gesture "
            note += f"(classify.landmarks); what these count for is learned from {len(taught)}"
        found = cls(settings, library, taught[kept], thresholds, fitted, comparison, within, note)
        if chosen.confidence is None:
            return found
        return replace(found, fitted=fitted.with_temperature(found.temperature))

    @property
    def weights(self) -> ExampleWeights | None:
        """How much each example counts for each class, of ``weighed`` and its part of ``blend``."""
        asked = self.fitted.classifier
        return asked.weights(self.fitted.state) if isinstance(asked, Weighed) else None

    def distances(self, series: Sequence[Signals | np.ndarray]) -> np.ndarray:
        """(Q, N) warping distances to the examples of `library`."""
        if not series:
            return np.empty((0, len(self.library)))
        return self.comparison.distances(series)

    def scores(self, series: Sequence[Signals | np.ndarray]) -> np.ndarray:
        """(Q, C) score of each class; see `Votes`."""
        return votes_of(self.fitted, self.distances(series), series).scores

    @cached_property
    def temperature(self) -> float:
        """What turns scores into probabilities; see `temperature_of`."""
        series, within = self.library.series, self.within
        if self.fitted.temperature is not None:
            return self.fitted.temperature
        if within is None:
            within = _among(series, self.comparison, lambda: None)
        return temperature_of(self.fitted, within, series)

    def predictions(self, X: Sequence[Item]) -> list[Prediction]:
        """One `Prediction` for each query; see `GestureClassifier.predictions`."""
        found: dict[int, Prediction] = {}
        usable: dict[int, Signals | np.ndarray] = {}
        chain = Chain.from_settings(self.settings)
        for place, item in enumerate(sequence_of(X)):
            try:
                usable[place] = _signals_of(item, chain, f"query {place}")
            except GestureError as error:
                found[place] = Prediction(None, "error", code=error.code, message=error.message)
        batches = [list(usable)] if usable else []
        while batches:
            places = batches.pop()
            series = [usable[place] for place in places]
            try:
                distances = self.distances(series)
            except InputError as error:
                if len(places) > 1:  # halves of what cannot be compared, down to one
                    batches += [places[: len(places) // 2], places[len(places) // 2 :]]
                    continue
                # Alone it was the first of its batch.
                message = error.message.replace("query 0", f"query {places[0]}")
                found[places[0]] = Prediction(None, "error", code=error.code, message=message)
                continue
            asked = self.settings.classify
            decided = decide(distances, series, self.library, self.fitted, self.thresholds, asked)
            found.update(zip(places, decided, strict=True))
        return [found[place] for place in range(len(X))]

    def save(self, path: Path, facts: Mapping[str, Any]) -> None:
        """Write the fitted examples and ``facts`` about them, plain values, to a file of arrays.

        Nothing is pickled, and reading it runs no code.

        Raises
        ------
        InputError
            ``E_LABELS`` where labels are neither texts nor numbers.
        """
        library = self.library
        labels = np.asarray(library.labels)
        if labels.dtype.kind not in _KINDS:
            raise InputError(
                f"labels of type {labels.dtype} cannot be saved", remedy="texts or numbers", code="E_LABELS"
            )
        signals = [item for item in library.series if isinstance(item, Signals)]
        arrays = {
            "labels": labels,
            "kept": self.kept,
            "lengths": np.array([len(item) for item in library.series]),
            "values": np.concatenate(
                [item.values if isinstance(item, Signals) else item for item in library.series]
            ),
        }
        if signals:
            arrays["times"] = np.concatenate([item.times for item in signals])
            arrays["masks"] = np.array([item.mask for item in signals])
            arrays["present"] = np.array([item.present for item in signals])
        if self.thresholds is not None:
            arrays["thresholds"] = self.thresholds
        arrays |= {_LEARNED + name: array for name, array in self.fitted.state.items()}
        if self.fitted.temperature is not None:
            arrays["temperature"] = np.array(self.fitted.temperature)
        header = {
            "format": _FORMAT,
            "preset": self.settings.preset,
            "settings": self.settings.as_dict(),
            "names": library.names,
            "sources": [item.source for item in signals],
            "channels": signals[0].channels if signals else (),
            "facts": dict(facts),
        }
        arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
        write_arrays(path, arrays)

    @classmethod
    def load(cls, path: Path, known: KnownDistances | None = None) -> tuple[Recognizer, dict[str, Any]]:
        """What `save` wrote: the recognizer, and the facts about it.

        Pairs in ``known`` are not compared again; it learns those that are.

        Raises
        ------
        InputError
            ``E_NOT_FOUND`` where there is no such file, ``E_INPUT`` where it is another one, or damaged.
        """
        arrays = read_arrays(path, _LARGEST)
        try:
            header = json.loads(arrays["header"].astype(np.uint8).tobytes())
            if header["format"] != _FORMAT:
                raise ValueError(f"format {header['format']}, this version reads {_FORMAT}")
            settings = replace(settings_from_dict(header["settings"]), preset=str(header["preset"]))
            cuts = np.cumsum(arrays["lengths"])[:-1]
            values: list[Any] = np.split(arrays["values"], cuts)
            if header["channels"]:
                channels = tuple(map(str, header["channels"]))
                every = (
                    values,
                    np.split(arrays["times"], cuts),
                    arrays["masks"],
                    arrays["present"],
                    header["sources"],
                )
                values = [Signals(v, t, channels, m, p, s) for v, t, m, p, s in zip(*every, strict=True)]
            library = ExampleLibrary(tuple(values), tuple(arrays["labels"]), tuple(header["names"]))
            state = {n.removeprefix(_LEARNED): a for n, a in arrays.items() if n.startswith(_LEARNED)}
            heat = float(arrays["temperature"]) if settings.classify.confidence is not None else None
            classifier, votes = choose_classifier(settings), settings.classify.votes
            fitted = Fitted(classifier, state, library.codes, len(library.classes), votes, heat)
            comparison = Comparison(library.series, settings, known)
            kept, thresholds, facts = arrays["kept"], arrays.get("thresholds"), dict(header["facts"])
            return cls(settings, library, kept, thresholds, fitted, comparison), facts
        except (GestureError, KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise InputError(
                f"holds no fitted classifier of this version: {error}",
                subject=printable(path),
                code="E_INPUT",
            ) from error


def signals_of(X: Sequence[Item], settings: Settings, name: str) -> list[Signals | np.ndarray]:
    """``X`` with keypoints made signals; an error says of which element, ``name`` and number, it is."""
    chain = Chain.from_settings(settings)
    return [_signals_of(item, chain, f"{name} {index}") for index, item in enumerate(sequence_of(X))]


def sequence_of(X: Iterable[Item]) -> Sequence[Item]:
    """``X`` as it is, or the list of what it gives; an InputError where it is no sequence of series."""
    if isinstance(X, PoseSequence | Recording | Signals):
        raise InputError(f"one {type(X).__name__} instead of a sequence of them", remedy="a list: [it]")
    if isinstance(X, str | os.PathLike):
        raise _not_loaded(X)
    if hasattr(X, "columns"):  # in which sktime keeps many series
        raise InputError(
            "one data frame instead of a sequence of them",
            remedy="[frame] for one series; [one for _, one in X.groupby(level=0)] where the first level of "
            "its index numbers them; a list of (T, D) arrays where its cells hold series",
            code="E_DTYPE",
        )
    return _listed(X, "X", "a list of keypoints, of signals or of (T, D) arrays")


def _listed(values: Iterable[Any], name: str, remedy: str) -> Sequence[Any]:
    """``values``, whose order counts."""
    try:
        iter(values)
    except TypeError:
        ordered = False
    else:
        ordered = not isinstance(values, Mapping | Set | str | bytes) and not hasattr(values, "columns")
    if not ordered:
        cause = f"{name} is a {type(values).__name__}, and no sequence"
        raise InputError(cause, remedy=remedy, code="E_DTYPE")
    return values if isinstance(values, Sized) else list(values)  # type: ignore[return-value]


def _warn_of_axes(X: Sequence[Item], stacklevel: int) -> None:
    """Warn of arrays that may have their channels first, as those of aeon and sktime do."""
    shapes = {item.shape if isinstance(item, np.ndarray) else () for item in X}
    if shapes and all(len(shape) == 2 and 1 < shape[0] < shape[1] for shape in shapes):
        samples, channels = min(shapes)
        warnings.warn(
            f"arrays are (samples, channels), and these have {samples} samples of {channels} channels; "
            "with channels first: X.transpose(0, 2, 1), or [one.T for one in X]",
            stacklevel=stacklevel + 1,
        )


def _not_loaded(path: str | os.PathLike[str], name: str = "X") -> InputError:
    """What is said of a file where keypoints belong: opening it is another function's work."""
    return InputError(
        f"{name} is a path, {printable(path)!r}",
        remedy="load_poses(paths) first, which gives the keypoints of each; "
        "or classify_archive, which takes folders",
        code="E_DTYPE",
    )


def _signals_of(item: Item, chain: Chain, name: str) -> Signals | np.ndarray:
    if isinstance(item, str | os.PathLike):
        raise _not_loaded(item, name)
    try:
        if chain.of_channels and not isinstance(item, PoseSequence | Recording | Signals):
            item = as_recording(item, name, chain.fps)
        elif columns_of(item) is not None:
            raise InputError(
                "is a data frame, whose columns have no order that counts",
                remedy="preset='sensors', which compares columns of one name, or frame.to_numpy()",
                code="E_DTYPE",
            )
        return chain(item) if isinstance(item, PoseSequence | Recording) else item
    except GestureError as error:
        error.about(name)
        raise


def _among(
    series: Sequence[Signals | np.ndarray], comparison: Comparison, alive: Callable[[], None]
) -> np.ndarray:
    """(N, N) distances among the examples, as many rows at a time as a kernel does in seconds."""
    blocks: list[np.ndarray] = []
    start, rows = 0, 1
    while start < len(series):
        begun = time.monotonic()
        blocks.append(comparison.distances(series[start : start + rows]))
        alive()
        start += rows
        rows = max(1, min(_MOST_ROWS, int(rows * _SECONDS / max(time.monotonic() - begun, 1e-3))))
    return np.concatenate(blocks)
