"""Which network and which backend find people, where the settings leave it open (``auto``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gesture_core.errors import ConfigError, PluginError
from gesture_core.plugin.abilities import DeviceChoice
from gesture_core.plugin.registry import calling, registry
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
        ``E_PROVIDER`` where the backend cannot run on what the settings ask for, ``E_OPTION`` where they have
        options of another one only.
    """
    pose = settings.pose
    names: Sequence[str] = (pose.model,)
    if pose.model == "auto":
        names = [name for name in auto_models() if is_here(name) and _fits(name, pose)] or auto_models()[-1:]
    backend = backend_name(find_model(names[0])) if pose.backend == "auto" else pose.backend
    if pose.backend == "auto":
        _refuse_lost_options(settings, names[0], backend)
    pose = replace(pose, model=names[0], backend=backend)
    asked = str(settings.plugin_options(backend).get("device", "auto"))
    return replace(settings, pose=replace(pose, **_device(pose, asked)))


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
    with calling(registry().find("pose", backend)):
        if not (isinstance(kind, type) and issubclass(kind, DeviceChoice)):
            return {}
        return {str(setting): [*map(str, names)] for setting, names in kind.devices().items()}


def _refuse_lost_options(settings: Settings, model: str, backend: str) -> None:
    """Raise where the settings have options of other backends, and none of the one that ``auto`` takes."""
    backends = {plugin for kind, plugin in registry().entries if kind == "pose"}
    backends -= {plugin for kind, plugin in registry().entries if kind != "pose"}
    given = sorted(backends & {name for name, options in settings.options.items() if options})
    if given and backend not in given:
        raise ConfigError(
            f"options of {given[0]!r}, and {model} is run by {backend!r}",
            remedy=f"--pose {given[0]}, or options of {backend!r} in their place",
            code="E_OPTION",
        )


def _device(pose: PoseSettings, asked: str) -> dict[str, Any]:
    """The setting that says what the backend runs on; its own option ``device`` (``asked``) goes first."""
    here = _devices(pose.backend)
    for setting in ("provider", "target"):
        wanted, key = vars(pose)[setting], f"pose.{setting}"
        if asked != "auto" and setting in here:
            wanted, key = asked, f"{pose.backend}.device"
        if wanted != "auto" and setting not in here:
            raise ConfigError(
                f"pose.{setting} = {wanted!r}: the backend {pose.backend!r} has no such choice",
                remedy=" or ".join(f"--set pose.{own}=…" for own in here) or "leave it out",
                code="E_OPTION",
            )
        if wanted != "auto" and wanted not in here[setting]:
            raise ConfigError(
                f"{key} = {wanted!r}: {pose.backend!r} here has only {', '.join(here[setting])}",
                remedy=_BUILDS[setting],
                code="E_PROVIDER",
            )
    wanted = {own: vars(pose)[own] if asked == "auto" else asked for own in here}
    return {own: next(iter(here[own]), "auto") if name == "auto" else name for own, name in wanted.items()}


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
