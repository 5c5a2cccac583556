"""Which network and which backend find people, where the settings leave it open (``auto``)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from gesture_core.errors import PluginError
from gesture_core.plugin.registry import registry
from gesture_core.pose.models import ModelFile, auto_models, find_model, is_here, known_models

if TYPE_CHECKING:
    from gesture_core.settings import Settings

_FIRST = ("onnx", "opencv-dnn")
"""Backends that ``auto`` takes before any other."""


def choose_pose(settings: Settings) -> Settings:
    """The settings with what ``auto`` stands for in ``pose.model`` and ``pose.backend`` on this machine.

    Raises
    ------
    ModelError
        From `find_model`.
    PluginError
        ``E_PLUGIN_UNKNOWN`` where no backend that is installed reads such a file.
    """
    pose = settings.pose
    if "auto" not in (pose.model, pose.backend):
        return settings
    name = pose.model
    if name == "auto":
        name = next((one for one in auto_models() if is_here(one)), auto_models()[-1])
    backend = backend_name(find_model(name)) if pose.backend == "auto" else pose.backend
    return replace(settings, pose=replace(pose, model=name, backend=backend))


def backend_name(model: ModelFile) -> str:
    """The first backend that reads files such as the model's."""
    suffix = model.path.suffix.lower()
    able = [
        name
        for name in registry().names("pose", usable=True)
        if suffix in registry().find("pose", name).suffixes
    ]
    if not able:
        raise PluginError(
            f"no pose backend that is installed reads {suffix}",
            subject=str(model.path),
            remedy="'gesture plugins' says what is missing; --pose with another one",
            code="E_PLUGIN_UNKNOWN",
        )
    return min(able, key=lambda name: (_FIRST.index(name) if name in _FIRST else len(_FIRST), name))


def described(settings: Settings) -> str:
    """What finds people under settings from `choose_pose`, and what the strongest network would bring."""
    pose, known = settings.pose, known_models()
    text = f"{pose.model} on {pose.backend}"
    here, best = known.get(pose.model), known[auto_models()[0]]
    if here and here.frames:
        text += f", about {here.frames} frames/s a core"
    if here and here.name in auto_models()[1:] and not is_here(best.name):
        text += (
            f"; 'gesture models get {best.name}' brings a stronger network: {best.gestures} % of 15 gestures "
            f"of new people instead of {here.gestures} %, at {best.frames} frames/s"
        )
    return text
