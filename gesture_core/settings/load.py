"""Settings from a preset, the environment and flags: defaults < TOML file < environment < flags.

A preset is a TOML file with the tables of `sections`, each optional. ``[options.<plugin>]`` holds
the keyword arguments of a plugin, so ``--set gaussian.sigma=2`` reaches the filter ``gaussian``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError
from gesture_core.settings.sections import SECTIONS
from gesture_core.settings.shipped import preset_tree, presets
from gesture_core.settings.tree import DEFAULT_PRESET, Settings, change, with_options
from gesture_core.settings.values import near

ENVIRONMENT_PREFIX = "GESTURE_SET_"


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


def _from_toml(name: str, above: tuple[str, ...] = ()) -> Settings:
    if name in above:
        raise ConfigError(f"is its own base: {' -> '.join((*above, name))}", subject=name, code="E_PRESET")
    tree = preset_tree(name)
    base = tree.pop("base", None)
    if base is not None and not isinstance(base, str):
        raise ConfigError(f"base = {base!r}", subject=name, remedy="the name of a preset", code="E_PRESET")
    tree.pop("description", None)
    if base and base not in presets():
        base = str(Path(name).parent / base)
    settings = replace(_from_toml(base, (*above, name)) if base else Settings(), preset=name)
    for section, values in tree.items():
        if section not in SECTIONS and section != "options":
            raise ConfigError(
                f"unknown table [{section}]", subject=name, remedy=near(section, [*SECTIONS, "options"])
            )
        if not isinstance(values, dict):
            raise ConfigError(f"{section} is no table", subject=name, remedy=f"[{section}]")
    settings = with_options(settings, tree.pop("options", {}), name)
    for section, values in tree.items():
        settings = change(settings, section, values, name)
    return settings
