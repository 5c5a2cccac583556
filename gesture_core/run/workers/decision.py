"""Examples are fitted, keypoints become predictions; what fails costs its own row only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gesture_core.classify.comparison import check_settings
from gesture_core.classify.recognizer import Recognizer, signals_of
from gesture_core.errors import ConfigError, GestureError, InputError, PoseError
from gesture_core.plugin.registry import calling, registry
from gesture_core.settings import Settings
from gesture_core.spot.spotter import Spotter
from gesture_core.types import Event, PoseSequence, Prediction, Signals


class Decider:
    """A recognizer that is given its examples one by one, and decides.

    Parameters
    ----------
    settings : Settings
    spot : bool
        Look for the examples in long recordings.

    Raises
    ------
    GestureError
        Where the settings name plugins that cannot be used.
    """

    def __init__(self, settings: Settings, *, spot: bool = False) -> None:
        from gesture_core.dtw.distances import choose_kernel
        from gesture_core.dtw.subsequence import choose_subsequence_kernel
        from gesture_core.signals.chain import Chain

        check_settings(settings)
        Chain.from_settings(settings)
        self._spot = spot
        kernel = settings.classify.kernel
        if spot:  # one kernel for both stages
            kernel, _ = choose_subsequence_kernel(kernel, settings.options)
        self.kernel, _ = choose_kernel(kernel, settings.dtw, settings.options)
        self._entry = registry().find("kernel", self.kernel)
        self._settings = replace(settings, classify=replace(settings.classify, kernel=self.kernel))
        self._recognizer: Recognizer | None = None
        self._spotter: Spotter | None = None
        self._poses: list[PoseSequence] = []
        self._signals: list[Signals] = []
        self._labels: list[str] = []
        self._names: list[str] = []

    def add(self, name: str, label: str, people: Sequence[PoseSequence]) -> None:
        """Take the first person of an example; a GestureError says why that cannot be."""
        if not people:
            raise PoseError("nobody was found", subject=name, code="E_NO_PERSON")
        (signals,) = signals_of(people[:1], self._settings, "sequence")
        assert isinstance(signals, Signals)
        for known, other, twin in zip(self._signals, self._labels, self._names, strict=True):
            if other != label and np.array_equal(known.values, signals.values):
                raise InputError(
                    f"is called {label}, and {twin}, with the same movement, {other}",
                    subject=name,
                    remedy="only the right one of them",
                    code="E_CONTRADICTION",
                )
        self._signals.append(signals)
        self._labels.append(label)
        self._names.append(name)
        if self._spot:
            self._poses.append(people[0])

    def fit(self, alive: Callable[[], None]) -> None:
        """All examples are there; a PluginError where the kernel fails at comparing them.

        ``alive`` is called while they are compared with each other.
        """
        with calling(self._entry, kept="the keypoints", remedy="another --kernel, or report it"):
            if self._spot:
                self._spotter = Spotter(
                    self._poses, self._labels, self._settings, names=self._names, alive=alive
                )
                return
            self._recognizer = Recognizer.fit(
                self._settings, self._signals, self._labels, self._names, alive=alive
            )

    def spot(self, pose: PoseSequence, alive: Callable[[], None]) -> tuple[list[Event], str]:
        """The events in a recording of one person, and what could not be searched.

        ``alive`` is called while they are looked for.
        """
        assert self._spotter is not None, "fit comes first"
        with calling(self._entry, remedy="another --kernel, or report it"):
            return self._spotter.spot_with_note(pose, alive)

    def predict(self, poses: Sequence[PoseSequence]) -> list[Prediction]:
        """One prediction for each of ``poses``, together; one by one where that fails."""
        if not poses:
            return []
        assert self._recognizer is not None, "fit comes first"
        try:
            with calling(self._entry, remedy="another --kernel, or report it"):
                return self._recognizer.predictions(poses)
        except ConfigError:
            raise
        except GestureError as error:
            if len(poses) == 1:
                return [Prediction(None, "error", code=error.code, message=error.message)]
        return [prediction for pose in poses for prediction in self.predict([pose])]
