"""Examples become a classifier, keypoints become predictions; what fails costs its own row only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from gesture_core.archive.assemble import failed_row
from gesture_core.archive.discovery import Input
from gesture_core.archive.rows import Row
from gesture_core.archive.run import keypoint_store
from gesture_core.archive.store import read_keypoints
from gesture_core.archive.work import Outcome
from gesture_core.classify.estimator import GestureClassifier
from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.plugin import registry
from gesture_core.settings import Settings
from gesture_core.types import PoseSequence, Prediction, Signals


def stored_poses(item: Input, outcome: Outcome) -> list[PoseSequence]:
    """The keypoints of an input, one sequence for each person; none where there are none.

    Raises
    ------
    KeypointError
        Where the file in the store has been damaged since it was written.
    """
    if not outcome.stored:
        return []
    return read_keypoints(keypoint_store() / outcome.stored, item.name).sequences


@dataclass
class ExampleSet:
    """The examples of a run that can be used.

    Attributes
    ----------
    fingerprint : str
        Of the run, for the rows of examples that cannot be used.
    signals, labels, names : lists
        Of those that can, in their order.
    """

    fingerprint: str
    signals: list[Signals] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def add(self, item: Input, outcome: Outcome, classifier: GestureClassifier) -> Row | None:
        """Take the first person of an example; the row that says why where that cannot be."""
        try:
            poses = stored_poses(item, outcome)
            if outcome.code or not poses:
                return failed_row(item, outcome, self.fingerprint)
            self.signals.extend(classifier.signals(poses[:1]))  # type: ignore[arg-type]
        except ConfigError:
            raise
        except GestureError as error:
            broken = Outcome(0, outcome.sha256, code=error.code, message=error.message)
            return failed_row(item, broken, self.fingerprint)
        self.labels.append(str(item.label))
        self.names.append(item.name)
        return None

    def require_any(self, failed: Sequence[Row]) -> None:
        """An InputError where no example is left."""
        if not self.signals:
            raise InputError(
                f"no example can be used; the first one: {failed[0].code} {failed[0].message}",
                kept="the keypoints extracted so far",
                remedy="better clips",
                code="E_EXAMPLES",
            )


def predict(
    classifier: GestureClassifier, poses: Sequence[PoseSequence], settings: Settings
) -> list[Prediction]:
    """One prediction for each of ``poses``, together; one by one where that fails."""
    if not poses:
        return []
    try:
        return classifier.predictions(poses)
    except ConfigError:
        raise
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a kernel may raise anything
        if len(poses) == 1:
            return [_failed(error, settings)]
    return [prediction for pose in poses for prediction in predict(classifier, [pose], settings)]


def _failed(error: BaseException, settings: Settings) -> Prediction:
    if isinstance(error, GestureError):
        return Prediction(None, "error", code=error.code, message=error.message)
    entry = registry().find("kernel", settings.classify.kernel)
    return Prediction(
        None,
        "error",
        code="E_PLUGIN_RAISED",
        message=f"{entry.title} of {entry.origin} raised {type(error).__name__}: {error}; "
        "try: another --kernel, or report it",
    )
