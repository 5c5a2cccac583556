"""Examples become a classifier, keypoints become predictions; what fails costs its own row only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from gesture_core.classify.recognizer import Recognizer, signals_of
from gesture_core.errors import ConfigError, GestureError, InputError, PluginError, PoseError
from gesture_core.plugin import registry
from gesture_core.run.child import MEMORY
from gesture_core.settings import Settings
from gesture_core.types import PoseSequence, Prediction, Signals


@dataclass(frozen=True)
class Example:
    """An example whose keypoints are in the store under the name ``stored``."""

    name: str
    label: str
    stored: str


@dataclass(frozen=True)
class Arrived:
    """Everybody in an input, whose keypoints are in the store under the name ``stored``."""

    name: str
    stored: str
    people: Sequence[PoseSequence]


@dataclass(frozen=True)
class Decided:
    """One prediction for each person of an input, and how often it took."""

    predictions: tuple[Prediction, ...]
    attempts: int = 1


class Deciding(Protocol):
    """What decides, here or elsewhere."""

    def check(self) -> None:
        """A GestureError where the settings name plugins that cannot be used."""
        ...

    def add(self, example: Example, people: Sequence[PoseSequence]) -> None:
        """Take the first person of an example; a GestureError says why that cannot be."""
        ...

    def fit(self) -> None:
        """All examples are there."""
        ...

    def predict(self, batch: Sequence[Arrived]) -> list[Decided]:
        """What is decided about each input of a batch."""
        ...


@dataclass
class Decider:
    """Decides in this process.

    Attributes
    ----------
    settings : Settings
    signals, labels, names : lists
        Of the examples that can be used, in their order.
    """

    settings: Settings
    signals: list[Signals] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._recognizer: Recognizer | None = None

    def check(self) -> None:
        """A GestureError where the settings name plugins that cannot be used."""
        from gesture_core.dtw.distances import choose_kernel
        from gesture_core.signals.chain import Chain

        Chain.from_settings(self.settings)
        choose_kernel(self.settings.classify.kernel, self.settings.dtw, self.settings.options)

    def add(self, example: Example, people: Sequence[PoseSequence]) -> None:
        """Take the first person of an example; a GestureError says why that cannot be."""
        if not people:
            raise PoseError("nobody was found", subject=example.name, code="E_NO_PERSON")
        (signals,) = signals_of(people[:1], self.settings, "sequence")
        assert isinstance(signals, Signals)
        for known, label, name in zip(self.signals, self.labels, self.names, strict=True):
            if label != example.label and np.array_equal(known.values, signals.values):
                raise InputError(
                    f"is called {example.label}, and {name}, with the same movement, {label}",
                    subject=example.name,
                    remedy="only the right one of them",
                    code="E_CONTRADICTION",
                )
        self.signals.append(signals)
        self.labels.append(example.label)
        self.names.append(example.name)

    def fit(self, alive: Callable[[], None] = lambda: None) -> None:
        """All examples are there; a PluginError where the kernel fails at what they need.

        ``alive`` is called while they are compared with each other.
        """
        try:
            self._recognizer = Recognizer.fit(
                self.settings, self.signals, self.labels, self.names, alive=alive
            )
        except GestureError:
            raise
        except (Exception, SystemExit) as error:
            raise _raised(error, self.settings) from error

    def predict(self, batch: Sequence[Arrived]) -> list[Decided]:
        """What is decided about each input of a batch."""
        assert self._recognizer is not None, "fit comes first"
        every = [pose for one in batch for pose in one.people]
        predictions = iter(predict(self._recognizer, every, self.settings))
        return [Decided(tuple(next(predictions) for _ in one.people)) for one in batch]


def predict(recognizer: Recognizer, poses: Sequence[PoseSequence], settings: Settings) -> list[Prediction]:
    """One prediction for each of ``poses``, together; one by one where that fails."""
    if not poses:
        return []
    try:
        return recognizer.predictions(poses)
    except ConfigError:
        raise
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a kernel may raise anything
        if len(poses) == 1:
            return [_failed(error, settings)]
    return [prediction for pose in poses for prediction in predict(recognizer, [pose], settings)]


def _failed(error: BaseException, settings: Settings) -> Prediction:
    if isinstance(error, MemoryError):
        message = "out of memory; try: --set limits.memory=… with a larger figure and --retry-errors"
        return Prediction(None, "error", code=MEMORY, message=message)
    if not isinstance(error, GestureError):
        error = _raised(error, settings)
    message = error.message
    origin = str(registry().find("kernel", settings.classify.kernel).origin)
    if isinstance(error, PluginError) and origin not in message:
        message += f" (kernel of {origin})"
    return Prediction(None, "error", code=error.code, message=message)


def _raised(error: BaseException, settings: Settings) -> PluginError:
    entry = registry().find("kernel", settings.classify.kernel)
    return PluginError(
        f"{entry.title} of {entry.origin} raised {type(error).__name__}: {error}",
        remedy="another --kernel, or report it",
        code="E_PLUGIN_RAISED",
    )
