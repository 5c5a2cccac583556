"""Pose networks: which are known, which are here, and which one and what runs it stands for ``auto``.

A file is known by its SHA-256, whatever it is called; `known_models.toml` lists public networks. One of them
comes with an installed package; those that the user added are in `gesture_core.pose.model_store`.
"""

from __future__ import annotations

import difflib
import hashlib
import os
import re
import tomllib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gesture_core.errors import ConfigError, ModelError, PluginError
from gesture_core.files import models_dir, open_regular
from gesture_core.plugin.abilities import DeviceChoice
from gesture_core.plugin.registry import calling, registry
from gesture_core.pose.contract import ModelContract
from gesture_core.skeletons import skeleton

if TYPE_CHECKING:
    from gesture_core.settings import Settings
    from gesture_core.settings.schema import PoseSettings

MAX_BYTES = 1 << 30
"""No pose network that runs on a CPU at video speed is larger."""
SUFFIXES = (".onnx", ".tflite", ".pb", ".caffemodel")
CARD = "model.json"
FINDER = "compact"
"""Finds the first region of a person for networks that see only that."""
NAME = re.compile(r"(?=.{1,64}$)[a-z0-9]+([-._][a-z0-9]+)*")
"""A name becomes a folder, so that nothing that could leave `models_dir` is one."""


@dataclass(frozen=True)
class ModelFile:
    """A pose network that was found.

    Attributes
    ----------
    path : Path
    sha256 : str
        Of the file, 64 hexadecimal digits; with a Caffe network, of the weights.
    name : str
        Under which it is known, or the file's own name.
    contract : ModelContract or None
        None where only running the network can tell (a TensorFlow or Caffe file of unknown origin).
    licence, origin : str
        Of a network that the user added.
    """

    path: Path
    sha256: str
    name: str
    contract: ModelContract | None = None
    licence: str = ""
    origin: str = ""

    def read(self) -> bytes:
        """The bytes of the file, which are those that the hash was taken of.

        Raises
        ------
        ModelError
            ``E_MODEL_CHANGED`` where the file is not the one that was found.
        """
        data = read_model(self.path)
        if hashlib.sha256(data).hexdigest() != self.sha256:
            raise ModelError(
                "the file changed after it was found",
                subject=str(self.path),
                remedy="'gesture models verify', or add it again",
                code="E_MODEL_CHANGED",
            )
        return data

    @property
    def prototxt(self) -> Path:
        """The description that stands beside Caffe weights."""
        return self.path.with_suffix(".prototxt")


@dataclass(frozen=True)
class KnownModel:
    """A public network.

    Attributes
    ----------
    name, summary : str
    contract : ModelContract or None
        None where it is inferred from the file.
    licence, where : str
        Of the weights, and where a user gets them.
    files : tuple of str
        Names under which people have the file.
    sha256 : tuple of str
        Of the files that are known to be this network, empty where exports differ.
    wheel : str
        Requirement of a wheel on a package index in which the file is; empty where there is none.
    url, archive_sha256 : str
        Address and hash of a zip file in which the file is; empty where there is none.
    member : str
        Place of the file, which has the first hash, in the wheel or zip file.
    packaged : str
        ``package:path`` of a file that an installed package brings.
    gestures, frames : int
        Of those that ``auto`` chooses from: percentage of 15 gestures of a new person that were told apart by
        examples of four others, at the default ``pose.rate``, and frames a second on one core.
    """

    name: str
    contract: ModelContract | None = None
    summary: str = ""
    licence: str = ""
    where: str = ""
    files: tuple[str, ...] = ()
    sha256: tuple[str, ...] = ()
    wheel: str = ""
    url: str = ""
    archive_sha256: str = ""
    member: str = ""
    packaged: str = ""
    gestures: int = 0
    frames: int = 0

    @property
    def remedy(self) -> str:
        """What brings the network to this machine."""
        if self.packaged:
            return (
                "another one: 'gesture models' lists them, 'gesture models add FILE' adds one, "
                "then --model NAME; or --model FILE"
            )
        if self.member:
            return f"'gesture models get {self.name}'"
        return f"get it ({self.where}), then 'gesture models add FILE --name {self.name}'"

    @property
    def packaged_path(self) -> Path | None:
        """The file that comes with an installed package, None where there is no such file.

        The package is looked up by name and not imported.
        """
        package, _, inside = self.packaged.partition(":")
        spec = find_spec(package) if package else None
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            path = Path(folder) / inside
            if path.is_file():
                return path
        return None


@cache
def _known() -> tuple[tuple[str, ...], dict[str, KnownModel]]:
    """What ``auto`` stands for, and the networks by name: ``known_models.toml``."""
    found = {}
    tables = tomllib.loads((files("gesture_core.pose") / "known_models.toml").read_text("utf-8"))
    auto = tuple(tables.pop("auto"))
    for name, table in tables.items():
        facts, contract = table.pop("contract", None), None
        if facts is not None:
            contract = ModelContract.from_table({**facts, "licence": table.get("licence", "")}, name)
        table |= {key: tuple(table.get(key, ())) for key in ("files", "sha256")}
        found[name] = KnownModel(name, contract, **table)
    return auto, found


def known_models() -> dict[str, KnownModel]:
    """Name -> network, in the order of ``known_models.toml``."""
    return _known()[1]


def auto_models() -> tuple[str, ...]:
    """The networks that ``pose.model = "auto"`` chooses from, the strongest first."""
    return _known()[0]


def is_here(name: str) -> bool:
    """Whether a network of this name was added, or comes with an installed package."""
    known = known_models().get(name)
    return _is_added(name) or bool(known and known.packaged_path)


def _is_added(name: str) -> bool:
    return bool(NAME.fullmatch(name)) and (models_dir() / name / CARD).is_file()


def known_by_hash(sha256: str) -> KnownModel | None:
    """The known network with this file hash."""
    return next((known for known in known_models().values() if sha256 in known.sha256), None)


def find_model(name_or_path: str | os.PathLike[str]) -> ModelFile:
    """The model file that a user means.

    Parameters
    ----------
    name_or_path : str or path
        A name of `gesture models`, or a file. What ends in a model's suffix or holds a path
        separator is a file.

    Raises
    ------
    ModelError
        ``E_MODEL_UNKNOWN`` where there is no such name, ``E_NOT_FOUND`` where there is no such file;
        ``E_MODEL_MISSING`` where the network is known but not installed, with what to do; others
        from reading the file.
    """
    text = os.fspath(name_or_path)
    if isinstance(name_or_path, Path) or text.lower().endswith(SUFFIXES) or "/" in text or os.sep in text:
        from gesture_core.pose.model_store import file_model

        return file_model(Path(text).expanduser())
    if _is_added(text):
        from gesture_core.pose.model_store import read_card

        return read_card(text)
    known = known_models().get(text)
    if known is None:
        from gesture_core.pose.model_store import added_names

        names = sorted({*known_models(), *added_names()})
        near = difflib.get_close_matches(text, names, 1)
        raise ModelError(
            f"no pose network {text!r}",
            remedy=(f"did you mean {near[0]!r}? " if near else "")
            + f"one of {', '.join(names)}, or a file that ends in {', '.join(SUFFIXES)}",
            code="E_MODEL_UNKNOWN",
        )
    path = known.packaged_path
    if path is not None:
        return ModelFile(path, hashlib.sha256(read_model(path)).hexdigest(), text, known.contract)
    lacking = "of the package is not in this installation" if known.packaged else "is known but not here"
    raise ModelError(
        f"the network {text!r} ({known.licence}) {lacking}", remedy=known.remedy, code="E_MODEL_MISSING"
    )


def read_model(path: Path, limit: int | None = None) -> bytes:
    """The bytes of a regular file of at most ``limit`` bytes, by default `MAX_BYTES`.

    Raises
    ------
    ModelError
        ``E_NOT_FOUND``, ``E_MODEL_FILE`` for what cannot be read, ``E_MODEL_SIZE`` for a larger one.
    """
    limit = MAX_BYTES if limit is None else limit
    try:
        with open_regular(path, limit, ModelError, ("E_NOT_FOUND", "E_MODEL_FILE", "E_MODEL_SIZE")) as file:
            return file.read(limit)
    except ModelError as error:
        if error.code == "E_NOT_FOUND":
            error.remedy = "check the path, or take a name: 'gesture models' lists them"
        raise
    except OSError as error:
        raise ModelError(
            f"cannot be read: {error.strerror}", subject=str(path), code="E_MODEL_FILE"
        ) from error


_FIRST = ("onnx", "opencv-dnn")
"""Backends that ``auto`` takes before any other."""
_BUILDS = {
    "provider": "--set pose.provider=auto, or another build of onnxruntime: -gpu, -openvino, -directml",
    "target": "--set pose.target=auto, or an OpenCV that was built with it",
}


def choose_pose(settings: Settings) -> Settings:
    """The settings with what ``auto`` in [pose] stands for on this machine.

    Warns
    -----
    UserWarning
        Where a stronger network is here, and no backend can be had for it.

    Raises
    ------
    ModelError
        From `find_model`.
    PluginError
        ``E_PLUGIN_UNKNOWN`` where no backend that is installed reads such a file.
    ConfigError
        ``E_PROVIDER`` where the backend cannot run on what the settings ask for, ``E_OPTION`` where it cannot
        be asked for it, or where the settings have options of another
        backend alone.
    """
    names: Sequence[str] = (settings.pose.model,)
    if settings.pose.model == "auto":
        names = [name for name in auto_models() if is_here(name)] or auto_models()[-1:]
    *others, last = names
    for name in others:
        try:
            return replace(settings, pose=_resolved(settings, name))
        except ConfigError:  # what the settings name cannot run this one
            continue
        except PluginError as error:
            warnings.warn(f"the network {name} is not used: {error.message}", stacklevel=2)
    return replace(settings, pose=_resolved(settings, last))


def _resolved(settings: Settings, name: str) -> PoseSettings:
    """[pose] with a network, the backend that reads it, and what that runs on."""
    pose, model = settings.pose, find_model(name)
    if model.contract and not skeleton(model.contract.skeleton).has_neck:
        raise ModelError(
            f"the network {name!r} finds hands or faces, not people",
            remedy="--set keypoints.parts=body,hands,face with a network that finds people",
            code="E_MODEL_LAYOUT",
        )
    backend = backend_name(model) if pose.backend == "auto" else pose.backend
    reads = registry().find("pose", backend).suffixes
    if pose.model == "auto" and reads and model.path.suffix.lower() not in reads:
        raise ConfigError(f"{backend!r} does not read {model.path.suffix}", code="E_OPTION")
    given = [one for one, options in settings.options.items() if options]
    lost = sorted(one for one in given if ("pose", one) in registry().entries)
    if pose.backend == "auto" and lost and backend not in lost:
        raise ConfigError(
            f"options of {lost[0]!r}, and {name} is run by {backend!r}",
            remedy=f"--pose {lost[0]}, or options of {backend!r} in their place",
            code="E_OPTION",
        )
    kind, here = registry().load("pose", backend), {}
    with calling(registry().find("pose", backend)):
        if isinstance(kind, type) and issubclass(kind, DeviceChoice):  # what it says that it can run on here
            here = {str(setting): [*map(str, names)] for setting, names in kind.devices().items()}
    own = str(settings.options.get(backend, {}).get("device", "auto"))
    for setting, remedy in _BUILDS.items():
        wanted, key = vars(pose)[setting], f"pose.{setting}"
        if own != "auto" and setting in here:  # the backend's own option goes first
            wanted, key = own, f"{backend}.device"
        if wanted != "auto" and setting not in here:
            raise ConfigError(
                f"pose.{setting} = {wanted!r}: the backend {backend!r} has no such choice",
                remedy=" or ".join(f"--set pose.{own}=…" for own in here) or "leave it out",
                code="E_OPTION",
            )
        if wanted != "auto" and wanted not in here[setting]:
            raise ConfigError(
                f"{key} = {wanted!r}: {backend!r} here has only {', '.join(here[setting])}",
                remedy=remedy,
                code="E_PROVIDER",
            )
    asked = {setting: vars(pose)[setting] if own == "auto" else own for setting in here}
    devices: dict[str, Any] = {
        setting: next(iter(here[setting]), "auto") if wanted == "auto" else wanted
        for setting, wanted in asked.items()
    }
    return replace(pose, model=name, backend=backend, **devices)


def backend_name(model: ModelFile) -> str:
    """The first backend that reads files such as the model's."""
    plugins, suffix = registry(), model.path.suffix.lower()
    able = [
        name for name in plugins.names("pose", usable=True) if suffix in plugins.find("pose", name).suffixes
    ]
    if not able:
        raise PluginError(
            f"no pose backend that is installed reads {suffix}",
            subject=str(model.path),
            remedy="'gesture plugins' says what is missing; --pose with another one",
            code="E_PLUGIN_UNKNOWN",
        )
    return next((name for name in _FIRST if name in able), able[0])


def described(settings: Settings, *, hint: bool = False) -> str:
    """What finds people under settings from `choose_pose`; as a ``hint``, what a stronger one would bring."""
    pose, known = settings.pose, known_models()
    device = pose.target if pose.provider == "auto" else pose.provider
    text = f"{pose.model} on {pose.backend}" + (f" ({device})" if device != "auto" else "")
    here, best = known.get(pose.model), known[auto_models()[0]]
    if here and here.frames:
        text += f", about {here.frames} frames/s a core"
        text += ", a third of that with hands" if "hands" in settings.keypoints.parts else ""
    if hint and here and here.name in auto_models()[1:] and not is_here(best.name):
        text += (
            f"; 'gesture models get {best.name}' brings a stronger network: {best.gestures} % of 15 gestures "
            f"of a new person instead of {here.gestures} %, at {best.frames} frames/s"
        )
    return text
