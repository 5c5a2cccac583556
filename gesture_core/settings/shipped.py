"""The presets of the package, as TOML trees."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError


def presets() -> tuple[str, ...]:
    """Names of the presets in the package."""
    folder = files("gesture_core.settings") / "presets"
    return tuple(sorted(item.name[:-5] for item in folder.iterdir() if item.name.endswith(".toml")))


def preset_tree(name: str) -> dict[str, Any]:
    """The TOML tree of a preset of the package, or of a file.

    Raises
    ------
    ConfigError
        E_PRESET where there is none, or where it is not TOML.
    """
    try:
        if name in presets():
            text = (files("gesture_core.settings") / "presets" / f"{name}.toml").read_text("utf-8")
        else:
            text = Path(name).read_text("utf-8")
        return tomllib.loads(text)
    except OSError as error:
        a_file = Path(name).suffix == ".toml" or Path(name).name != name
        raise ConfigError(
            f"preset {name}: {error.strerror or error}" if a_file else f"no preset {name!r}",
            remedy=f"one of {', '.join(presets())}, or a TOML file",
            code="E_PRESET",
        ) from None
    except ValueError as error:  # of TOML or of UTF-8
        raise ConfigError(f"not TOML: {error}", subject=name, code="E_PRESET") from None


def presets_with(option: str) -> list[tuple[str, str]]:
    """(preset, plugin) of every preset of the package in which a plugin has the option."""
    return [
        (name, plugin)
        for name in presets()
        for plugin, given in preset_tree(name).get("options", {}).items()
        if option in given
    ]
