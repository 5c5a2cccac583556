"""Every setting of a run, in one frozen tree: defaults < TOML file < environment < flags.

A preset is a TOML file with the tables below, each optional. `options.<plugin>` holds the
keyword arguments of a plugin, so ``--set gaussian.sigma=2`` reaches the filter ``gaussian``.
"""

from __future__ import annotations

import difflib
import json
import os
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args, get_type_hints

from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError

DEFAULT_PRESET = "paper"
ENVIRONMENT_PREFIX = "GESTURE_SET_"


@dataclass(frozen=True)
class PoseSettings:
    """How people are found in pictures.

    Attributes
    ----------
    backend : str
        Name of a pose backend.
    model : str
        Name or file of a pose network.
    people : "single" or "multi"
        One person for each input, or one row for each track.
    height : int
        Height in pixels that a picture is scaled to, for networks that take any size.
    follow : bool or None
        Crop to the person and follow them; None lets the model decide.
    score : float
        Joints below this confidence are missing.
    reader : str
        Video reader: ``auto``, ``pyav`` or ``opencv``.
    fps : float
        Frames per second of keypoint files that carry no times.
    """

    backend: str = "onnx"
    model: str = "compact"
    people: str = "single"
    height: int = 368
    follow: bool | None = None
    score: float = 0.1
    reader: str = "auto"
    fps: float = 30.0


@dataclass(frozen=True)
class SignalSettings:
    """The chain from keypoints to signals.

    Attributes
    ----------
    max_gap : float
        Seconds of a missing joint that are interpolated; a joint with a longer gap inside keeps
        its nearest values only if it was seen in ``min_seen`` of the frames.
    min_seen : float
        Share of frames in which a joint must be seen to count as present.
    min_frames : int
        Frames with a pose that a sequence needs to be classified at all.
    normalizer, selector : str
        Names of plugins.
    filters : tuple of str
        Names of filter plugins in order.
    """

    max_gap: float = 0.5
    min_seen: float = 0.5
    min_frames: int = 5
    normalizer: str = "shoulder"
    filters: tuple[str, ...] = ("gaussian", "center")
    selector: str = "variance"


@dataclass(frozen=True)
class ClassifySettings:
    """The decision.

    Attributes
    ----------
    kernel : str
        Name of a distance kernel, or ``auto``.
    neighbors : int
        k of the k-nearest-neighbour vote.
    reject : None or float
        Distances above this get no label.
    reject_sd : None or float
        Instead: threshold of each class = mean + this many standard deviations of the distances
        inside the class.
    representative : bool
        Keep only the medoid of each class as its example.
    min_pose : float
        Share of frames with a pose below which a sequence is an error (E_POSE_SPARSE).
    mirror : None or float
        Every example also stands for the same movement made with the other hand; the distance to
        that reading is multiplied by this factor, 1 or more.
    coverage : bool
        Divide a distance by the share of channels that both sequences have.
    """

    kernel: str = "auto"
    neighbors: int = 1
    reject: float | None = None
    reject_sd: float | None = None
    representative: bool = False
    min_pose: float = 0.25
    mirror: float | None = None
    coverage: bool = False


@dataclass(frozen=True)
class LimitSettings:
    """What one input may cost before it is given up.

    Attributes
    ----------
    pixels : int
        Of one frame.
    frames : int
        Of one input.
    seconds : float
        Without a sign of progress from the worker, before it is ended.
    memory : int
        MiB of one worker process.
    """

    pixels: int = 64_000_000
    frames: int = 200_000
    seconds: float = 120.0
    memory: int = 4096


@dataclass(frozen=True)
class Settings:
    """All settings of a run. Plugin options are in ``options[plugin][option]``."""

    preset: str = DEFAULT_PRESET
    pose: PoseSettings = field(default_factory=PoseSettings)
    signals: SignalSettings = field(default_factory=SignalSettings)
    dtw: DtwSpec = field(default_factory=DtwSpec)
    classify: ClassifySettings = field(default_factory=ClassifySettings)
    limits: LimitSettings = field(default_factory=LimitSettings)
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The whole tree as plain dicts, lists and scalars, without the preset's name."""
        tree = json.loads(json.dumps(asdict(self)))
        del tree["preset"]
        return tree

    def plugin_options(self, name: str) -> dict[str, Any]:
        """Keyword arguments of plugin ``name``."""
        return dict(self.options.get(name, {}))

    def with_values(self, values: Iterable[tuple[str, Any]], origin: str = "--set") -> Settings:
        """The settings with ``(dotted key, value)`` pairs changed.

        A string value is read by the type of its setting, or as a TOML value for a plugin option.
        A bare key such as ``window`` is accepted where only one section has it.

        Raises
        ------
        ConfigError
            For an unknown key (naming the nearest one) or a value of the wrong type.
        """
        tree = self
        for key, value in values:
            section, name = _resolve(key, tree, origin)
            if section in _SECTIONS:
                tree = _change(tree, section, {name: value}, origin)
            else:
                options = {plugin: dict(given) for plugin, given in tree.options.items()}
                options.setdefault(section, {})[name] = _toml_value(value)
                tree = replace(tree, options=options)
        return tree


_SECTIONS: dict[str, type] = {
    "pose": PoseSettings,
    "signals": SignalSettings,
    "dtw": DtwSpec,
    "classify": ClassifySettings,
    "limits": LimitSettings,
}


def presets() -> tuple[str, ...]:
    """Names of the presets in the package."""
    folder = files("gesture_core") / "presets"
    return tuple(sorted(item.name[:-5] for item in folder.iterdir() if item.name.endswith(".toml")))


def settings_from_dict(tree: Mapping[str, Any]) -> Settings:
    """The inverse of `Settings.as_dict`."""
    settings = Settings(options={plugin: dict(given) for plugin, given in tree.get("options", {}).items()})
    for section in _SECTIONS:
        settings = _change(settings, section, tree.get(section, {}), "settings")
    return settings


def load_settings(
    preset: str | Path | None = None,
    sets: Sequence[str] = (),
    *,
    environment: Mapping[str, str] | None = None,
    **flags: Any,
) -> Settings:
    """Settings from a preset, the environment and flags, in that order.

    Parameters
    ----------
    preset : str or path
        Name of a preset of the package, or a TOML file.
    sets : sequence of ``"key=value"``
        As given with ``--set``.
    environment : mapping, optional
        Instead of the process's own: ``GESTURE_SET_DTW__WINDOW=0.1`` sets ``dtw.window``.
    flags : dotted keys with ``__`` for the dot
        Values that are not None override everything else, such as ``classify__neighbors=3``.

    Raises
    ------
    ConfigError
        With the key or value that is wrong and what would be right.
    """
    environment = os.environ if environment is None else environment
    name = str(preset or environment.get("GESTURE_PRESET") or DEFAULT_PRESET)
    settings = _from_toml(name)
    settings = settings.with_values(
        (
            (key.removeprefix(ENVIRONMENT_PREFIX).lower().replace("__", "."), value)
            for key, value in sorted(environment.items())
            if key.startswith(ENVIRONMENT_PREFIX)
        ),
        "environment",
    )
    settings = settings.with_values(map(_split, sets))
    return settings.with_values(
        ((key.replace("__", "."), value) for key, value in flags.items() if value is not None), "flag"
    )


def _split(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {text!r}", remedy="key=value, such as dtw.window=0.1", code="E_OPTION")
    return key.strip(), value.strip()


def _from_toml(name: str) -> Settings:
    if name in presets():
        text = (files("gesture_core") / "presets" / f"{name}.toml").read_text("utf-8")
    elif Path(name).is_file():
        text = Path(name).read_text("utf-8")
    else:
        raise ConfigError(
            f"no preset {name!r}", remedy=f"one of {', '.join(presets())}, or a TOML file", code="E_PRESET"
        )
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"not TOML: {error}", subject=name, code="E_PRESET") from None
    tree.pop("description", None)
    base = tree.pop("base", None)
    settings = replace(_from_toml(base) if base else Settings(), preset=name)
    options = {plugin: dict(given) for plugin, given in settings.options.items()}
    for plugin, given in tree.pop("options", {}).items():
        options.setdefault(plugin, {}).update(given)
    settings = replace(settings, options=options)
    for section, values in tree.items():
        if section not in _SECTIONS or not isinstance(values, dict):
            raise ConfigError(
                f"unknown table [{section}]", subject=name, remedy=_near(section, [*_SECTIONS, "options"])
            )
        settings = _change(settings, section, values, name)
    return settings


def _resolve(key: str, settings: Settings, origin: str) -> tuple[str, str]:
    section, dot, name = key.rpartition(".")
    if dot:
        if section in _SECTIONS and name not in _names(section):
            raise ConfigError(
                f"{origin} {key!r}: [{section}] has no {name!r}", remedy=_near(name, _names(section))
            )
        return section.removeprefix("options."), name
    owners = [s for s in _SECTIONS if key in _names(s)]
    owners += [plugin for plugin, given in settings.options.items() if key in given]
    if len(owners) == 1:
        return owners[0], key
    if owners:
        raise ConfigError(f"{origin} {key!r} is ambiguous", remedy=" or ".join(f"{o}.{key}" for o in owners))
    every = [f"{s}.{n}" for s in _SECTIONS for n in _names(s)]
    bare = [n for s in _SECTIONS for n in _names(s)]
    raise ConfigError(f"{origin} {key!r} is no setting", remedy=_near(key, bare + every))


def _names(section: str) -> list[str]:
    return [f.name for f in fields(_SECTIONS[section])]


def _near(word: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(word, known, 3)
    return f"did you mean {' or '.join(near)}?" if near else f"one of {', '.join(known)}"


def _change(settings: Settings, section: str, values: Mapping[str, Any], origin: str) -> Settings:
    hints = get_type_hints(_SECTIONS[section])
    changes = {}
    for name, value in values.items():
        if name not in hints:
            raise ConfigError(f"{origin}: [{section}] has no {name!r}", remedy=_near(name, list(hints)))
        changes[name] = _read(f"{section}.{name}", value, hints[name], origin)
    return replace(settings, **{section: replace(getattr(settings, section), **changes)})


def _toml_value(value: Any) -> Any:
    """A string as the TOML value that it spells, or as itself."""
    if not isinstance(value, str):
        return value
    try:
        return tomllib.loads(f"v = {value}")["v"]
    except tomllib.TOMLDecodeError:
        return value


def _read(key: str, value: Any, hint: Any, origin: str) -> Any:
    """``value`` as the type that ``hint`` names: a scalar, an optional, or a tuple of one scalar."""
    options = get_args(hint) if type(None) in get_args(hint) else (hint,)
    if isinstance(value, str) and value.lower() in ("none", "") and type(None) in options:
        return None
    plain = value if hint is str else _toml_value(value)
    if value is None and type(None) in options:
        return None
    for option in (o for o in options if o is not type(None)):
        if getattr(option, "__origin__", None) is tuple:
            items = plain.split(",") if isinstance(plain, str) else plain
            if isinstance(items, list | tuple):
                scalar = get_args(option)[0]
                return tuple(
                    _read(key, i.strip() if isinstance(i, str) else i, scalar, origin) for i in items
                )
        elif option is float and isinstance(plain, int | float) and not isinstance(plain, bool):
            if int not in options or isinstance(plain, float):
                return float(plain)
        elif option is str and isinstance(value, str):
            return value
        elif (option in (int, bool) and type(plain) is option) or plain in get_args(option):
            return plain
    wanted = " or ".join(_wanted(option) for option in options if option is not type(None))
    raise ConfigError(f"{origin}: {key} = {value!r}", remedy=wanted, code="E_OPTION")


def _wanted(hint: Any) -> str:
    words = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}
    if hint in words:
        return words[hint]
    choices = [choice for choice in get_args(hint) if isinstance(choice, str)]
    return " or ".join(choices) or "a list of names"
