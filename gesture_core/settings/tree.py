"""`Settings`: every setting of a run, in one frozen tree."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from difflib import get_close_matches
from typing import Any, get_type_hints

from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError
from gesture_core.plugin import registry
from gesture_core.settings.sections import (
    SECTIONS,
    ClassifySettings,
    LimitSettings,
    PoseSettings,
    SignalSettings,
)
from gesture_core.settings.shipped import presets_with
from gesture_core.settings.values import near, read_value, toml_value

DEFAULT_PRESET = "modern"


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

    @property
    def steps(self) -> tuple[tuple[str, str], ...]:
        """(kind, name) of the plugins that make signals of keypoints: normalizer, selector, filters.

        A name such as ``gaussian:wide`` is a second ``gaussian`` with options of its own.
        """
        chosen = self.signals
        filters = (("filter", name) for name in chosen.filters)
        return (("normalizer", chosen.normalizer), ("selector", chosen.selector), *filters)

    def takes_part(self, plugin: str) -> bool:
        """Whether a pose backend or a step of that name makes the signals of a video."""
        return plugin in (self.pose.backend, *(name for _, name in self.steps))

    def as_dict(self) -> dict[str, Any]:
        """The whole tree as plain dicts, lists and scalars, without the preset's name.

        Raises
        ------
        ConfigError
            For a band that is a mask, which has no such form.
        """
        if self.dtw.mask is not None:
            raise ConfigError(
                "dtw.mask cannot be written down with a run",
                remedy="dtw.window or dtw.shape; masks are for GestureClassifier and warping_distances",
                code="E_OPTION",
            )
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
            if section in SECTIONS:
                tree = change(tree, section, {name: value}, origin)
            else:
                options = {plugin: dict(given) for plugin, given in tree.options.items()}
                options.setdefault(section, {})[name] = toml_value(value)
                tree = replace(tree, options=options)
        return tree


def settings_from_dict(tree: Mapping[str, Any]) -> Settings:
    """The inverse of `Settings.as_dict`."""
    settings = Settings(options={plugin: dict(given) for plugin, given in tree.get("options", {}).items()})
    for section in SECTIONS:
        settings = change(settings, section, tree.get(section, {}), "settings")
    return settings


def change(settings: Settings, section: str, values: Mapping[str, Any], origin: str) -> Settings:
    """``settings`` with ``values`` of one section changed; a ConfigError names what is wrong.

    ``origin`` says in the error where the values were given: a file, ``--set``, ``environment``.
    """
    hints = get_type_hints(SECTIONS[section])
    changes = {}
    for name, value in values.items():
        if name not in hints:
            raise ConfigError(f"{origin}: [{section}] has no {name!r}", remedy=near(name, list(hints)))
        changes[name] = read_value(f"{section}.{name}", value, hints[name], origin)
    return replace(settings, **{section: replace(getattr(settings, section), **changes)})


def _resolve(key: str, settings: Settings, origin: str) -> tuple[str, str]:
    """Section (or plugin) and name that a dotted or bare ``key`` stands for."""
    section, dot, name = key.rpartition(".")
    if dot:
        if section in SECTIONS and name not in _names(section):
            raise ConfigError(
                f"{origin} {key!r}: [{section}] has no {name!r}", remedy=near(name, _names(section))
            )
        return _plugin(section.removeprefix("options."), origin), name
    owners = [s for s in SECTIONS if key in _names(s)]
    owners += [plugin for plugin, given in settings.options.items() if key in given]
    if len(owners) == 1:
        return owners[0], key
    if owners:
        raise ConfigError(f"{origin} {key!r} is ambiguous", remedy=" or ".join(f"{o}.{key}" for o in owners))
    homes = presets_with(key)
    if here := sorted({f"{plugin}.{key}" for _, plugin in homes if settings.takes_part(plugin)}):
        raise ConfigError(
            f"{origin} {key!r} is an option that preset {settings.preset} does not set",
            remedy=" or ".join(here),
        )
    if homes:
        where = " and ".join(f"{plugin!r} in preset {preset}" for preset, plugin in homes)
        raise ConfigError(
            f"{origin} {key!r} is an option of {where}, which takes no part here",
            remedy=" or ".join(f"--preset {preset}" for preset in dict.fromkeys(p for p, _ in homes)),
        )
    every = [f"{s}.{n}" for s in SECTIONS for n in _names(s)]
    alike = get_close_matches(key, [n for s in SECTIONS for n in _names(s)] + every, 3)
    remedy = (
        f"did you mean {' or '.join(alike)}?"
        if alike
        else f"section.name, with a section of {', '.join(SECTIONS)}; or plugin.option, "
        "of which 'gesture plugins NAME' lists those of a plugin"
    )
    raise ConfigError(f"{origin} {key!r} is no setting", remedy=remedy)


def _plugin(name: str, origin: str) -> str:
    """``name``, if there is a plugin to take its options; ``gaussian:wide`` is a second ``gaussian``."""
    known = {plugin for _, plugin in registry().entries}
    if name in SECTIONS or name.partition(":")[0] in known:
        return name
    raise ConfigError(
        f"{origin} {name!r}: no such section or plugin", remedy=near(name, [*SECTIONS, *sorted(known)])
    )


def with_options(settings: Settings, options: Mapping[str, Any], origin: str) -> Settings:
    """The settings with the options of plugins changed; a ConfigError for what is no plugin."""
    merged = {plugin: dict(given) for plugin, given in settings.options.items()}
    for plugin, given in options.items():
        if not isinstance(given, Mapping):
            raise ConfigError(f"{origin}: options.{plugin} is no table", remedy=f"[options.{plugin}]")
        merged.setdefault(_plugin(plugin, origin), {}).update(given)
    return replace(settings, options=merged)


def _names(section: str) -> list[str]:
    return [f.name for f in fields(SECTIONS[section])]
