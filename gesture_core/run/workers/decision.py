"""Examples are fitted, keypoints become predictions; what fails costs its own row only."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core import __version__
from gesture_core.classify.comparison import check_settings
from gesture_core.classify.known import KnownDistances
from gesture_core.classify.recognizer import Recognizer, signals_of
from gesture_core.errors import ConfigError, GestureError, InputError, PoseError, RunFolderError
from gesture_core.files import tree_sha256
from gesture_core.plugin.registry import calling, registry
from gesture_core.records import Prediction, decoded
from gesture_core.run.results import DISTANCES, FITTED
from gesture_core.types import PoseSequence, Signals

if TYPE_CHECKING:
    from gesture_core.run.workers.worker import Worker
    from gesture_core.spot.spotter import Spotter

_INSTEAD = "another --kernel, or report it"


class Decider:
    """The decision, as functions of the table: a recognizer that is given its examples one by one.

    Raises
    ------
    GestureError
        Where the settings name plugins that cannot be used.
    """

    def __init__(self, worker: Worker) -> None:
        from gesture_core.dtw.distances import choose_kernel
        from gesture_core.signals.chain import Chain

        self._worker = worker
        worker.slow()
        settings, self._spots = worker.settings, worker.job.spot
        check_settings(settings)
        Chain.from_settings(settings)
        kernel = settings.classify.kernel
        if self._spots:  # one kernel for both stages
            from gesture_core.dtw.subsequence import choose_subsequence_kernel

            kernel, _ = choose_subsequence_kernel(kernel, settings.options)
        self._kernel, _ = choose_kernel(kernel, settings.dtw, settings.options)
        self._entry = registry().find("kernel", self._kernel)
        self._settings = replace(settings, classify=replace(settings.classify, kernel=self._kernel))
        self._recognizer: Recognizer | None = None
        self._known: KnownDistances | None = None
        self._spotter: Spotter | None = None
        self._poses: list[PoseSequence] = []
        self._signals: list[Signals] = []
        self._labels: list[str] = []
        self._names: list[str] = []
        self._seen: dict[bytes, tuple[str, str]] = {}

    def open_classifier(self) -> str:
        """Make the chain and the kernel that the settings name; the kernel's name."""
        return self._kernel

    def add_example(self, name: str, label: str, stored: str) -> None:
        """Take the first person of an example in the store; a GestureError says why that cannot be."""
        self._worker.slow()
        people = self._worker.people(stored, name)
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
        if self._spots:
            self._poses.append(people[0])

    def fit(self, run: str, fingerprint: str) -> str:
        """All examples are there: compare them, where the decision needs it.

        What is fitted stays in the run folder with the distances, so that each pair is compared once. The
        value is what is worth knowing of what was fitted, mostly empty.
        """
        self._worker.slow()
        folder, alive = decoded(run), self._worker.alive
        known = KnownDistances.read(folder / DISTANCES, self._compared_by(fingerprint))
        with calling(self._entry, kept="the keypoints", remedy=_INSTEAD):
            if self._spots:
                from gesture_core.spot.spotter import Spotter  # only where a recording is looked into

                self._spotter = Spotter(
                    self._poses, self._labels, self._settings, names=self._names, alive=alive
                )
                return self._spotter.examples.note
            self._recognizer = Recognizer.fit(
                self._settings, self._signals, self._labels, self._names, alive=alive, known=known
            )
        self._known = known
        with _writing(folder):
            self._recognizer.save(folder / FITTED, {"fingerprint": fingerprint, "examples": self._names})
        self.keep_distances(run)
        return self._recognizer.note

    def open_fitted(self, run: str, fingerprint: str, names: Sequence[str]) -> bool:
        """Take the fitted examples that `fit` has left in the run folder; False where it has not.

        They are all that the run has, by their ``names`` of now: of one that cannot be used, the run is to
        say why, and what was renamed is not to be found under its old name.
        """
        self._worker.slow()
        known = KnownDistances.read(decoded(run) / DISTANCES, self._compared_by(fingerprint))
        self._recognizer = open_fitted(decoded(run), fingerprint, names, known)
        self._known = known if self._recognizer else None
        return self._recognizer is not None

    def keep_distances(self, run: str) -> None:
        """Leave the distances in the run folder."""
        if self._known is not None:
            with _writing(decoded(run)):
                self._known.write(decoded(run) / DISTANCES)

    def decide(self, inputs: Sequence[Mapping[str, Any]]) -> list[list[dict[str, Any]]]:
        """The predictions for everybody in each of some stored inputs (``name``, ``stored``, ``people``)."""
        people: list[list[PoseSequence | GestureError]] = []
        for one in inputs:
            try:
                people.append(list(self._worker.people(one["stored"], one["name"])))
            except GestureError as error:
                people.append([error] * one["people"])
        poses = [pose for some in people for pose in some if not isinstance(pose, GestureError)]
        predictions = iter(self._predict(poses))
        return [
            [_failed(pose) if isinstance(pose, GestureError) else asdict(next(predictions)) for pose in some]
            for some in people
        ]

    def spot(self, inputs: Sequence[Mapping[str, Any]]) -> list[list[dict[str, Any]]]:
        """The ``events`` of everybody in each of some stored inputs, or the fields of a `Prediction`.

        Besides a ``note``, and ``refused``: of gestures that were farther than their threshold, how many
        times as far.
        """
        assert self._spotter is not None, "fit comes first"
        answers: list[list[dict[str, Any]]] = []
        for one in inputs:
            answers.append([])
            self._worker.slow()
            for pose in self._worker.people(one["stored"], one["name"]):
                try:
                    with calling(self._entry, remedy=_INSTEAD):
                        events, note = self._spotter.spot_with_note(pose, self._worker.alive)
                    found = {"events": [asdict(event) for event in events], "note": note}
                    answers[-1].append(found | {"refused": self._spotter.refused})
                except ConfigError:
                    raise
                except GestureError as error:
                    answers[-1].append(_failed(error))
        return answers

    def _compared_by(self, fingerprint: str) -> str:
        """A hash of everything but the pair that decides a distance; with ``balance`` so do all examples."""
        tree = self._settings.as_dict()
        decide = ("kernel", "mirror", "coverage", "separate", "relative", "rest", "balance", "weights")
        chosen = {name: tree["classify"][name] for name in decide}
        chosen |= {"examples": fingerprint} if chosen["balance"] else {}
        options, still = self._settings.options.get(self._kernel, {}), tree["signals"]["still"]
        return tree_sha256([__version__, self._entry.identity, tree["dtw"], chosen, options, still])

    def _predict(self, poses: Sequence[PoseSequence]) -> list[Prediction]:
        """One prediction for each of ``poses``, together; one by one where that fails."""
        if not poses:
            return []
        assert self._recognizer is not None, "fit comes first"
        try:
            with calling(self._entry, remedy=_INSTEAD):
                return self._recognizer.predictions(poses)
        except ConfigError:
            raise
        except GestureError as error:
            if len(poses) == 1:
                return [Prediction(None, **_failed(error))]
        return [prediction for pose in poses for prediction in self._predict([pose])]


def _failed(error: GestureError) -> dict[str, Any]:
    """What a `Prediction` says of an error."""
    return {"status": "error", "code": error.code, "message": error.message}


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


def open_fitted(
    run: Path, fingerprint: str, names: Iterable[str], known: KnownDistances | None = None
) -> Recognizer | None:
    """The fitted examples that a run has left in its folder.

    None where there are none, or those of other settings or examples (``names`` are those of all that were
    given), or of another version: they are a copy of what can be fitted again.
    """
    try:
        recognizer, facts = Recognizer.load(run / FITTED, known)
    except InputError:
        return None
    fits = facts.get("fingerprint") == fingerprint and sorted(facts.get("examples", ())) == sorted(names)
    return recognizer if fits else None
