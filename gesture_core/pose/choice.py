"""Which network and which backend find people, where the settings leave it open (``auto``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gesture_core.errors import ConfigError, PluginError
from gesture_core.plugin.abilities import DeviceChoice
from gesture_core.plugin.registry import registry
from gesture_core.pose.models import ModelFile, auto_models, find_model, is_here, known_models

if TYPE_CHECKING:
    from gesture_core.settings import Settings
    from gesture_core.settings.schema import PoseSettings

_FIRST = ("onnx", "opencv-dnn")
"""Backends that ``auto`` takes before any other."""
_BUILDS = {
    "provider": "--set pose.provider=auto, or another build of onnxruntime: -gpu, -openvino, -directml",
    "target": "--set pose.target=auto, or an OpenCV that was built with it",
}


def choose_pose(settings: Settings) -> Settings:
    """The settings with what ``auto`` in [pose] stands for on this machine.

    Raises
    ------
    ModelError
        From `find_model`.
    PluginError
        ``E_PLUGIN_UNKNOWN`` where no backend that is installed reads such a file.
    ConfigError
        ``E_PROVIDER`` where the backend cannot run on what the settings ask for.
    """
    pose = settings.pose
    names: Sequence[str] = (pose.model,)
    if pose.model == "auto":
        names = [name for name in auto_models() if is_here(name) and _fits(name, pose)] or auto_models()[-1:]
    backend = backend_name(find_model(names[0])) if pose.backend == "auto" else pose.backend
    pose = replace(pose, model=names[0], backend=backend)
    return replace(settings, pose=replace(pose, **_device(pose)))


def _fits(name: str, pose: PoseSettings) -> bool:
    """Whether the backend that the settings name reads a network, and has the choice that they name."""
    model = find_model(name)
    backend = backend_name(model) if pose.backend == "auto" else pose.backend
    reads = registry().find("pose", backend).suffixes
    if reads and model.path.suffix.lower() not in reads:
        return False
    here = _devices(backend)
    return all(vars(pose)[setting] == "auto" or setting in here for setting in ("provider", "target"))


def _devices(backend: str) -> Mapping[str, Sequence[str]]:
    kind = registry().load("pose", backend)
    return kind.devices() if issubclass(kind, DeviceChoice) else {}


def _device(pose: PoseSettings) -> dict[str, Any]:
    """The setting that says what the backend runs on."""
    here = _devices(pose.backend)
    for setting in ("provider", "target"):
        wanted = vars(pose)[setting]
        if wanted != "auto" and setting not in here:
            raise ConfigError(
                f"pose.{setting} = {wanted!r}: the backend {pose.backend!r} has no such choice",
                remedy=" or ".join(f"--set pose.{own}=…" for own in here) or "leave it out",
                code="E_OPTION",
            )
        if wanted != "auto" and wanted not in here[setting]:
            raise ConfigError(
                f"pose.{setting} = {wanted!r}: {pose.backend!r} here has only {', '.join(here[setting])}",
                remedy=_BUILDS[setting],
                code="E_PROVIDER",
            )
    return {own: devices[0] for own, devices in here.items() if vars(pose)[own] == "auto"}


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
    device = next((one for one in (pose.provider, pose.target) if one != "auto"), "")
    text = f"{pose.model} on {pose.backend}" + (f" ({device})" if device else "")
    here, best = known.get(pose.model), known[auto_models()[0]]
    if here and here.frames:
        text += f", about {here.frames} frames/s a core"
    if here and here.name in auto_models()[1:] and not is_here(best.name):
        text += (
            f"; 'gesture models get {best.name}' brings a stronger network: {best.gestures} % of 15 gestures "
            f"of new people instead of {here.gestures} %, at {best.frames} frames/s"
        )
    return text
