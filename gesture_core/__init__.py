"""gesture-core: a folder of videos and a folder of example gestures in, a table of labels out.

Public names are imported when they are first used; importing the package imports no NumPy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gesture_core.classify.estimator import GestureClassifier as GestureClassifier
    from gesture_core.dtw.distances import warping_distances as warping_distances
    from gesture_core.dtw.spec import DtwSpec as DtwSpec
    from gesture_core.errors import Code as Code
    from gesture_core.errors import GestureError as GestureError
    from gesture_core.plugin.hooks import hookimpl as hookimpl
    from gesture_core.run.annotations import evaluate_events as evaluate_events
    from gesture_core.run.archive import classify_archive as classify_archive
    from gesture_core.run.archive import load_poses as load_poses
    from gesture_core.run.archive import spot_archive as spot_archive
    from gesture_core.run.cut import Clip as Clip
    from gesture_core.run.cut import cut_events as cut_events
    from gesture_core.run.evaluate import evaluate_archive as evaluate_archive
    from gesture_core.run.explain import explain as explain
    from gesture_core.run.find import find as find
    from gesture_core.run.pipeline import RunSummary as RunSummary
    from gesture_core.run.shards import merge_runs as merge_runs
    from gesture_core.run.watch import watch as watch
    from gesture_core.settings import Settings as Settings
    from gesture_core.settings import load_settings as load_settings
    from gesture_core.spot.find import Hit as Hit
    from gesture_core.spot.spotter import Spotter as Spotter
    from gesture_core.types import Event as Event
    from gesture_core.types import Neighbors as Neighbors
    from gesture_core.types import PoseSequence as PoseSequence
    from gesture_core.types import Prediction as Prediction
    from gesture_core.types import Row as Row
    from gesture_core.types import SignalBatch as SignalBatch
    from gesture_core.types import Signals as Signals

__version__ = "0.1.0"

_PUBLIC = {
    "Clip": "run.cut",
    "Code": "errors",
    "DtwSpec": "dtw.spec",
    "Event": "types",
    "GestureClassifier": "classify.estimator",
    "GestureError": "errors",
    "Hit": "spot.find",
    "Neighbors": "types",
    "PoseSequence": "types",
    "Prediction": "types",
    "Row": "types",
    "RunSummary": "run.pipeline",
    "Settings": "settings",
    "SignalBatch": "types",
    "Signals": "types",
    "Spotter": "spot.spotter",
    "classify_archive": "run.archive",
    "cut_events": "run.cut",
    "evaluate_archive": "run.evaluate",
    "evaluate_events": "run.annotations",
    "explain": "run.explain",
    "find": "run.find",
    "hookimpl": "plugin.hooks",
    "load_poses": "run.archive",
    "load_settings": "settings",
    "merge_runs": "run.shards",
    "spot_archive": "run.archive",
    "warping_distances": "dtw.distances",
    "watch": "run.watch",
}
"""Where each public name is, for when it is first used; the imports above say the same to type checkers."""

__all__ = [*_PUBLIC, "__version__"]

if not TYPE_CHECKING:  # a type checker would take any name for Any

    def __getattr__(name):
        if name not in _PUBLIC:
            raise AttributeError(f"module 'gesture_core' has no attribute {name!r}")
        value = getattr(import_module(f"gesture_core.{_PUBLIC[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted(__all__)
