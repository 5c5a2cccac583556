"""Examples are fitted, keypoints become predictions; what fails costs its own row only."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gesture_core import __version__
from gesture_core.classify.comparison import check_settings
from gesture_core.classify.known import KnownDistances
from gesture_core.classify.recognizer import Recognizer, signals_of
from gesture_core.errors import ConfigError, GestureError, InputError, PoseError, RunFolderError
from gesture_core.files import tree_sha256
from gesture_core.plugin.registry import calling, registry
from gesture_core.records import Event, Prediction
from gesture_core.run.results import DISTANCES, FITTED
from gesture_core.settings import Settings
from gesture_core.types import PoseSequence, Signals

if TYPE_CHECKING:
    from gesture_core.spot.spotter import Spotter


@contextmanager
def _writing(run: Path) -> Iterator[None]:
    """What the system refuses is the run folder's fault, and ends the run."""
    try:
        yield
    except OSError as error:
        raise RunFolderError(
            f"what was fitted cannot be written: {error.strerror or error}",
            subject=str(run),
            kept="every committed row",
            remedy="free space, then the same command again",
            code="E_RUN_WRITE",
        ) from error


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
        self._known: KnownDistances | None = None
        self._spotter: Spotter | None = None
        self._poses: list[PoseSequence] = []
        self._signals: list[Signals] = []
        self._labels: list[str] = []
        self._names: list[str] = []
        self._seen: dict[bytes, tuple[str, str]] = {}

    def add(self, name: str, label: str, people: Sequence[PoseSequence]) -> None:
        """Take the first person of an example; a GestureError says why that cannot be."""
        if not people:
            raise PoseError("nobody was found", subject=name, code="E_NO_PERSON")
        (signals,) = signals_of(people[:1], self._settings, "sequence")
        assert isinstance(signals, Signals)
        content = hashlib.sha256(
            repr(signals.values.shape).encode() + (signals.values + 0.0).tobytes()
        ).digest()
        twin, other = self._seen.setdefault(content, (name, label))
        if other != label:
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

    def fit(self, run: Path, fingerprint: str, alive: Callable[[], None]) -> str:
        """All examples are there; a PluginError where the kernel fails at comparing them.

        What is fitted stays in the run folder with the distances, so that each pair is compared once.

        Parameters
        ----------
        run : Path
            The run folder.
        fingerprint : str
            Of the run.
        alive : callable
            Called while examples are compared with each other.

        Returns
        -------
        str
            What is worth knowing of what was fitted; mostly empty.
        """
        known = KnownDistances.read(run / DISTANCES, self._compared_by(fingerprint))
        with calling(self._entry, kept="the keypoints", remedy="another --kernel, or report it"):
            if self._spot:
                from gesture_core.spot.spotter import Spotter  # only where a recording is looked into

                self._spotter = Spotter(
                    self._poses, self._labels, self._settings, names=self._names, alive=alive
                )
                return self._spotter.examples.note
            self._recognizer = Recognizer.fit(
                self._settings, self._signals, self._labels, self._names, alive=alive, known=known
            )
        self._known = known
        with _writing(run):
            self._recognizer.save(run / FITTED, {"fingerprint": fingerprint, "examples": self._names})
        self.keep(run)
        return ""

    def open(self, run: Path, fingerprint: str, names: Sequence[str]) -> bool:
        """Take the fitted examples that `fit` has left in the run folder; False where it has not.

        They are all that the run has, by their ``names`` of now: of one that cannot be used, the run is to
        say why, and what was renamed is not to be found under its old name.
        """
        known = KnownDistances.read(run / DISTANCES, self._compared_by(fingerprint))
        self._recognizer = open_fitted(run, fingerprint, known, names)
        self._known = known if self._recognizer else None
        return self._recognizer is not None

    def keep(self, run: Path) -> None:
        """Leave the distances in the run folder."""
        if self._known is not None:
            with _writing(run):
                self._known.write(run / DISTANCES)

    def _compared_by(self, fingerprint: str) -> str:
        """A hash of everything but the pair that decides a distance; with ``balance`` so do all examples."""
        tree = self._settings.as_dict()
        decide = ("kernel", "mirror", "coverage", "separate", "relative", "rest", "balance", "weights")
        chosen = {name: tree["classify"][name] for name in decide}
        chosen |= {"examples": fingerprint} if chosen["balance"] else {}
        options, still = self._settings.plugin_options(self.kernel), tree["signals"]["still"]
        return tree_sha256([__version__, self._entry.identity, tree["dtw"], chosen, options, still])

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


def open_fitted(
    run: Path, fingerprint: str, known: KnownDistances | None = None, names: Sequence[str] | None = None
) -> Recognizer | None:
    """The fitted examples that a run has left in its folder.

    None where there are none, or those of other settings or examples (``names`` are those of all that were
    given, where they are known), or of another version: they are a copy of what can be fitted again.
    """
    try:
        recognizer, facts = Recognizer.load(run / FITTED, known)
    except InputError:
        return None
    fits = facts.get("fingerprint") == fingerprint and (names is None or facts.get("examples") == list(names))
    return recognizer if fits else None
