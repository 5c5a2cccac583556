"""Where settings come from: defaults < preset < environment < flags, every key and value checked.

A preset is a TOML file with the tables of `schema.SECTIONS`, each optional. ``[options.<plugin>]`` holds
the keyword arguments of a plugin, so ``--set gaussian.sigma=2`` reaches the filter ``gaussian``.
"""

from __future__ import annotations

import difflib
import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from gesture_core.errors import ConfigError, near
from gesture_core.plugin import registry
from gesture_core.settings.schema import DEFAULT_PRESET, SECTIONS, Settings

ENVIRONMENT_PREFIX = "GESTURE_SET_"
_PRESETS = Path(__file__).parent / "presets"
_CHOICES = {
    "pose": "--pose {}",
    "normalizer": "--set signals.normalizer={}",
    "filter": "--set signals.filters=…,{}",
    "selector": "--set signals.selector={}",
}
"""How to choose a plugin, by its kind; of the other kinds several take part, or the fastest one."""


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
    preset : str or path, optional
        Name of a preset of the package, or a TOML file; ``modern`` by default.
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

    Examples
    --------
    >>> load_settings("paper", ["window=0.1"], classify__neighbors=3).dtw.window
    0.1
    """
    environment = os.environ if environment is None else environment
    settings = _preset(str(preset or environment.get("GESTURE_PRESET") or DEFAULT_PRESET))
    for key, value in sorted(environment.items()):
        if key.startswith(ENVIRONMENT_PREFIX):
            key = key.removeprefix(ENVIRONMENT_PREFIX).lower().replace("__", ".")
            settings = changed(settings, [(key, value)], "environment")
    for text in sets:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ConfigError(f"--set {text!r}", remedy="key=value, such as dtw.window=0.1", code="E_OPTION")
        settings = changed(settings, [(key.strip(), value.strip())], "--set")
    for key, value in flags.items():
        if value is not None:
            settings = changed(settings, [(key.replace("__", "."), value)], "flag")
    return settings


def settings_from_dict(tree: Mapping[str, Any]) -> Settings:
    """The inverse of `Settings.as_dict`."""
    settings = Settings(options=dict(tree.get("options", {})))
    pose = dict(tree.get("pose", {}))
    if "fps" in pose:  # where version 0.1.0 had it
        tree = {"keypoints": {"fps": pose.pop("fps")}, **tree, "pose": pose}
    for section in SECTIONS:
        settings = _change(settings, section, tree.get(section, {}), "settings")
    return settings


def presets() -> list[str]:
    """Names of the presets in the package."""
    return sorted(map(attrgetter("stem"), _PRESETS.glob("*.toml")))


def _preset(name: str, above: tuple[str, ...] = ()) -> Settings:
    """The settings of a preset of the package or of a TOML file, above those of its base."""
    if name in above:
        raise ConfigError(f"is its own base: {' -> '.join((*above, name))}", subject=name, code="E_PRESET")
    tree = _preset_tree(name)
    base = tree.pop("base", None)
    if base is not None and not isinstance(base, str):
        raise ConfigError(f"base = {base!r}", subject=name, remedy="the name of a preset", code="E_PRESET")
    if base and base not in presets():
        base = str(Path(name).parent / base)
    settings = replace(_preset(base, (*above, name)) if base else Settings(), preset=name)
    tree.pop("description", None)
    for section, values in tree.items():
        if section not in SECTIONS and section != "options":
            remedy = near(section, [*SECTIONS, "options"])
            raise ConfigError(f"unknown table [{section}]", subject=name, remedy=remedy)
        if not isinstance(values, dict):
            raise ConfigError(f"{section} is no table", subject=name, remedy=f"[{section}]")
        if section != "options":
            settings = _change(settings, section, values, name)
            continue
        for plugin, given in values.items():
            if not isinstance(given, Mapping):
                raise ConfigError(f"{name}: options.{plugin} is no table", remedy=f"[options.{plugin}]")
            settings = _change(settings, _plugin(plugin, name), given, name)
    return settings


def _preset_tree(name: str) -> dict[str, Any]:
    try:
        path = _PRESETS / f"{name}.toml" if name in presets() else Path(name)
        return tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        a_file = Path(name).suffix == ".toml" or Path(name).name != name
        raise ConfigError(
            f"preset {name}: {error.strerror or error}" if a_file else f"no preset {name!r}",
            remedy=near(name, presets(), f"one of {', '.join(presets())}, or a TOML file"),
            code="E_PRESET",
        ) from None
    except ValueError as error:  # of TOML or of UTF-8
        raise ConfigError(f"not TOML: {error}", subject=name, code="E_PRESET") from None


def changed(settings: Settings, values: Iterable[tuple[str, Any]], origin: str) -> Settings:
    """``settings`` with ``(key, value)`` pairs changed: see `Settings.with_values`."""
    for key, value in values:
        section, name = find_key(key, settings, origin)
        value = value if section in SECTIONS else _toml_value(value)
        settings = _change(settings, section, {name: value}, origin)
    return settings


def _change(settings: Settings, section: str, values: Mapping[str, Any], origin: str) -> Settings:
    """``settings`` with values of one section, or options of one plugin, changed."""
    if section not in SECTIONS:
        merged = {**settings.options, section: {**settings.options.get(section, {}), **values}}
        return replace(settings, options=merged)
    hints = get_type_hints(SECTIONS[section])
    read = {}
    for name, value in values.items():
        if name not in hints:
            raise ConfigError(
                f"{origin}: [{section}] has no {name!r}", remedy=_elsewhere(name, list(hints), section)
            )
        read[name] = _read(f"{section}.{name}", value, hints[name], origin)
    return replace(settings, **{section: replace(getattr(settings, section), **read)})


def fields_of(section: str) -> list[str]:
    """Names of the settings of a section."""
    return [known.name for known in fields(SECTIONS[section])]


def find_key(key: str, settings: Settings, origin: str) -> tuple[str, str]:
    """Section (or plugin) and name that a dotted or bare key stands for.

    Raises
    ------
    ConfigError
        For a key that is unknown or ambiguous, with the nearest ones, or with the preset that has it.
    """
    section, dot, name = key.rpartition(".")
    if dot:
        if section in SECTIONS and name not in fields_of(section):
            cause = f"{origin} {key!r}: [{section}] has no {name!r}"
            raise ConfigError(cause, remedy=_elsewhere(name, fields_of(section), section))
        plugin = _plugin(section.removeprefix("options."), origin, name)
        if name in fields_of("keypoints") and not _takes(plugin, name):
            cause = f"{origin} {key!r}: what keypoint files leave open is said once for all readers"
            raise ConfigError(cause, remedy=f"--set keypoints.{name}=…", code="E_OPTION")
        return plugin, name
    owners = [section for section in SECTIONS if key in fields_of(section)]
    owners += [plugin for plugin, given in settings.options.items() if key in given]
    if len(owners) == 1:
        return owners[0], key
    if owners:
        raise ConfigError(f"{origin} {key!r} is ambiguous", remedy=" or ".join(f"{o}.{key}" for o in owners))
    homes = [
        (preset, plugin)
        for preset in presets()
        for plugin, given in _preset_tree(preset).get("options", {}).items()
        if key in given
    ]
    if here := sorted({f"{plugin}.{key}" for _, plugin in homes if plugin in _chosen(settings)}):
        cause = f"{origin} {key!r} is an option that preset {settings.preset} does not set"
        raise ConfigError(cause, remedy=" or ".join(here))
    if homes:
        where = " and ".join(f"{plugin!r} in preset {preset}" for preset, plugin in homes)
        raise ConfigError(
            f"{origin} {key!r} is an option of {where}, which takes no part here",
            remedy=" or ".join(f"--preset {preset}" for preset in dict.fromkeys(p for p, _ in homes)),
        )
    every = {name: section for section in SECTIONS for name in fields_of(section)}
    alike = [f"{every[name]}.{name}" for name in difflib.get_close_matches(key, every, 3)]
    remedy = (
        f"did you mean {' or '.join(alike)}?"
        if alike
        else f"section.name, with a section of {', '.join(SECTIONS)}, or plugin.option: 'gesture settings' "
        "lists them"
    )
    raise ConfigError(f"{origin} {key!r} is no setting", remedy=remedy)


def _plugin(name: str, origin: str, option: str = "") -> str:
    """``name``, if a section or a plugin is called so; ``gaussian:wide`` is a second ``gaussian``.

    With ``option``, an error names whole keys that are alike.
    """
    known = [*SECTIONS, *sorted({plugin for _, plugin in registry().entries})]
    if name.partition(":")[0] in known:
        return name
    wrong = f"{name}.{option}" if option else name
    raise ConfigError(
        f"{origin} {wrong!r}: no such section or plugin",
        remedy=_meant(name, option, known) if option else near(name, known),
    )


def _meant(section: str, name: str, known: Sequence[str]) -> str:
    """A remedy for the key ``section.name``, whose section or plugin is not among those ``known``."""
    alike = []
    for owner in difflib.get_close_matches(section, known, 3):
        names = difflib.get_close_matches(name, fields_of(owner), 1) if owner in SECTIONS else [name]
        alike += [f"{owner}.{one}" for one in names]
    return f"did you mean {' or '.join(alike)}?" if alike else near(section, known)


def check_option(key: str, settings: Settings, origin: str) -> None:
    """Raise ``E_OPTION`` where ``key`` is an option of a plugin that ``settings`` do not choose."""
    name = key.rpartition(".")[0].removeprefix("options.")
    kinds = {kind for kind, plugin in registry().entries if plugin == name.partition(":")[0]}
    if kinds and kinds <= _CHOICES.keys() and name not in _chosen(settings):
        raise ConfigError(
            f"{origin} {key}: {name!r} takes no part under preset {settings.preset}",
            remedy=" or ".join(_CHOICES[kind].format(name) for kind in sorted(kinds)),
            code="E_OPTION",
        )


def _chosen(settings: Settings) -> set[str]:
    """Names of the plugins that make a label of a video."""
    backend = settings.pose.backend
    backends = registry().names("pose") if backend == "auto" else (backend,)
    return {*backends, *(plugin for _, plugin in settings.plugins())}


def _takes(plugin: str, option: str) -> bool:
    """Whether a plugin may have an option: any but a keypoint reader that does not name it."""
    kinds = [kind for kind, name in registry().entries if name == plugin]
    return "reader" not in kinds or any(registry().takes(kind, plugin, option) for kind in kinds)


def _elsewhere(name: str, known: Sequence[str], section: str) -> str:
    """A remedy for the name of a setting that its ``section`` lacks: whole keys."""
    if name in fields_of("keypoints"):
        return f"--set keypoints.{name}=…"
    alike = difflib.get_close_matches(name, known, 3) or known
    return near(f"{section}.{name}", [f"{section}.{other}" for other in alike])


_SHORT_NUMBER = re.compile(r"[+-]?(\.\d+|\d+\.)(e[+-]?\d+)?", re.IGNORECASE)
"""A number that TOML wants a zero of: .05 or 5."""


def _toml_value(value: Any) -> Any:
    """A text as the TOML value that it spells, or as itself."""
    try:
        return tomllib.loads(f"v = {value}")["v"] if isinstance(value, str) else value
    except tomllib.TOMLDecodeError:
        return float(value) if _SHORT_NUMBER.fullmatch(value) else value


def _read(key: str, value: Any, hint: Any, origin: str) -> Any:
    """``value`` as the type that ``hint`` names: a scalar, an optional, or a tuple of one scalar.

    A text is read as that type (``none`` where the value may be absent, a comma between the parts of a
    tuple); anything else must have it.
    """
    options = get_args(hint) if type(None) in get_args(hint) else (hint,)
    if type(None) in options and (
        value is None or (isinstance(value, str) and value.lower() in ("none", ""))
    ):
        return None
    plain = value if hint is str else _toml_value(value)
    for option in options:
        if get_origin(option) is tuple:
            between = "," if get_args(option)[0] is str else "[,xX×]"  # 1920x1080 is a pair of numbers too
            parts = (re.split(between, plain) if plain else ()) if isinstance(plain, str) else plain
            if isinstance(parts, list | tuple):
                read = []
                for part in parts:
                    part = part.strip() if isinstance(part, str) else part
                    read.append(_read(key, part, get_args(option)[0], origin))
                return tuple(read)
        elif option is float and isinstance(plain, int | float) and not isinstance(plain, bool):
            if int not in options or isinstance(plain, float):
                return float(plain)
        elif option is str and isinstance(value, str):
            return value
        elif type(plain) is option or plain in get_args(option):
            return plain
    wanted = " or ".join(_wanted(option) for option in options if option is not type(None))
    raise ConfigError(f"{origin}: {key} = {value!r}", remedy=wanted, code="E_OPTION")


def _wanted(hint: Any) -> str:
    words = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}
    if hint in words:
        return words[hint]
    if get_origin(hint) is tuple:
        words = {str: "a list of names", int: "whole numbers, as 1920x1080"}
        return words.get(get_args(hint)[0], "a list of numbers")
    choices = [choice for choice in get_args(hint) if isinstance(choice, str)]
    return " or ".join(choices) or f"a {hint.__name__}, from Python"
