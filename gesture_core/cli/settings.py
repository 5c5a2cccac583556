"""``gesture settings``: what can be set, what it means, and what it is under a preset."""

from __future__ import annotations

import inspect
import json
import re
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Annotated

from gesture_core.cli.flags import UNSAID
from gesture_core.cli.plugins import documentation, options_of, written
from gesture_core.errors import ConfigError, near
from gesture_core.plugin import registry
from gesture_core.plugin.hooks import KINDS
from gesture_core.plugin.registry import calling
from gesture_core.settings import Settings, load_settings
from gesture_core.settings.load import find_key
from gesture_core.settings.schema import SECTIONS


@dataclass(frozen=True)
class Setting:
    """One setting, or one option of a plugin, as texts that could stand in a preset."""

    key: str
    type: str
    default: str
    value: str
    meaning: str


def settings(key: Annotated[str, UNSAID] = "", /, *, preset: str | None = None) -> int:
    """List every setting: type, default, value under a preset, meaning.

    Parameters
    ----------
    key
        Only this setting, section or plugin, in full, such as dtw.window, classify or gaussian.sigma.
    preset
        One of the package, or a TOML file. [default: modern]
    """
    chosen = load_settings(preset)
    found = list(_asked(key, chosen) if key else every_setting(chosen))
    if not sys.stdout.isatty():
        for setting in found:
            print(json.dumps({**asdict(setting), "preset": chosen.preset}, ensure_ascii=False))
        return 0
    print(f"under preset {chosen.preset}; to change one: --set KEY=VALUE\n")
    for setting in found:
        print(f"{setting.key} = {setting.value}  ({setting.type}; default {setting.default})")
        first = re.split(r"(?<=(?<! al)\.) ", setting.meaning, maxsplit=1)[0]
        meaning = setting.meaning if key else first
        print(textwrap.fill(meaning, 100, initial_indent="    ", subsequent_indent="    "))
    return 0


def every_setting(settings: Settings) -> Iterator[Setting]:
    """All sections, and the options of the plugins that ``settings`` choose."""
    for section in SECTIONS:
        yield from _section(section, settings)
    backend = settings.pose.backend
    backends = registry().names("pose", usable=True) if backend == "auto" else (backend,)
    for name in dict.fromkeys([*backends, *(name for _, name in settings.plugins())]):
        yield from _plugin(name, settings)


def _asked(key: str, settings: Settings) -> Iterator[Setting]:
    """What ``key`` stands for: a section, a plugin, or one setting of either."""
    if key in SECTIONS:
        yield from _section(key, settings)
        return
    if "." not in key and key.partition(":")[0] in {name for _, name in registry().entries}:
        yield from _plugin(key, settings)
        return
    section, name = find_key(key, settings, "gesture settings")
    found = list(_section(section, settings) if section in SECTIONS else _plugin(section, settings))
    names = [setting.key for setting in found]
    if f"{section}.{name}" not in names:
        raise ConfigError(
            f"{section!r} has no option {name!r}",
            remedy=near(f"{section}.{name}", names) if names else "a plugin with options",
            code="E_OPTION",
        )
    yield found[names.index(f"{section}.{name}")]


def _section(section: str, settings: Settings) -> Iterator[Setting]:
    kind, values = SECTIONS[section], vars(getattr(settings, section))
    entries = _entries(inspect.getdoc(kind) or "", "Attributes")
    for known in fields(kind):
        type_, meaning = entries[known.name]
        default, value = written(known.default), written(values[known.name])
        yield Setting(f"{section}.{known.name}", type_, default, value, meaning)


def _plugin(name: str, settings: Settings) -> Iterator[Setting]:
    """The options of every plugin of this name, whatever its kind."""
    base, given = name.partition(":")[0], settings.options.get(name, {})
    for kind, plugin in registry().entries:
        if plugin == base:
            target = registry().load(kind, base)
            with calling(registry().find(kind, base)):
                entries = _entries(documentation(target), "Parameters")
                options = options_of(target, KINDS[kind].filled)
            for option, default in options:
                type_, meaning = entries.get(option, ("", ""))
                value = written(given[option]) if option in given else default
                yield Setting(f"{name}.{option}", type_, default, value, meaning)


def _entries(text: str, heading: str) -> dict[str, tuple[str, str]]:
    """Type and meaning of each name below a heading of a docstring in the style of numpydoc."""
    found: dict[str, tuple[str, str]] = {}
    names: list[str] = []
    text = text.replace("`", "")
    for line in text.partition(f"{heading}\n{'-' * len(heading)}\n")[2].splitlines():
        if line.startswith(" "):
            found |= {name: (found[name][0], f"{found[name][1]} {line.strip()}".strip()) for name in names}
        elif " : " in line:
            listed, _, type_ = line.partition(" : ")
            names = listed.split(", ")
            found |= {name: (type_, "") for name in names}
        elif line:  # the next heading
            break
    return found
