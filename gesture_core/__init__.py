"""gesture-core: a folder of videos and a folder of example gestures in, a table of labels out.

Public names are imported when they are first used; importing the package imports no NumPy.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_PUBLIC = {
    "DtwSpec": "gesture_core.dtw.spec",
    "GestureClassifier": "gesture_core.classify.estimator",
    "GestureError": "gesture_core.errors",
    "Neighbors": "gesture_core.types",
    "PoseSequence": "gesture_core.types",
    "Prediction": "gesture_core.types",
    "SignalBatch": "gesture_core.types",
    "Signals": "gesture_core.types",
    "classify_archive": "gesture_core.run.archive",
    "hookimpl": "gesture_core.plugin.hooks",
    "load_poses": "gesture_core.run.archive",
    "warping_distances": "gesture_core.dtw.distances",
}

__all__ = [*_PUBLIC, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'gesture_core' has no attribute {name!r}")
    value = getattr(import_module(_PUBLIC[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
