"""Pose: from frames to keypoints.

`extract_poses` (`extract`) takes frames in batches. Where one person is followed, a follower (`follow`; of
networks that see an upright square, `region`) crops the frames to them. A backend finds people in the frames;
one around a network is a `NetworkBackend` (`network`), which letterboxes, runs and decodes (`decode`) as the
network's `ModelContract` (`contract`) says. Several people are told apart and tracked in `people`; the limbs
of one are chosen for all frames together at the end (`temporal`). Networks are found in `models`, which also
says what ``auto`` is; those of the user are in `model_store`, and a file that is not known is checked in
`onnx_header` before any runtime sees it.

Public for plugins of the kinds ``pose`` and ``reader``, besides `gesture_core.errors`, `gesture_core.files`,
`gesture_core.skeletons`, `gesture_core.types` and `gesture_core.plugin.interfaces`: the names below.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gesture_core.pose.contract import ModelContract, Tensor
    from gesture_core.pose.extract import extract_poses, open_backend
    from gesture_core.pose.models import ModelFile, find_model, read_model
    from gesture_core.pose.network import NetworkBackend
    from gesture_core.pose.people import Tracker

__all__ = [
    "ModelContract",
    "ModelFile",
    "NetworkBackend",
    "Tensor",
    "Tracker",
    "extract_poses",
    "find_model",
    "open_backend",
    "read_model",
]

_MODULES = {
    "ModelContract": "contract",
    "ModelFile": "models",
    "NetworkBackend": "network",
    "Tensor": "contract",
    "Tracker": "people",
    "extract_poses": "extract",
    "find_model": "models",
    "open_backend": "extract",
    "read_model": "models",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
