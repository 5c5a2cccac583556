"""``gesture plugins``: what is installed, where it comes from, whether it works."""

from __future__ import annotations

import inspect
from typing import Any

from gesture_core.cli.screen import print_table
from gesture_core.errors import PluginError
from gesture_core.plugin import registry
from gesture_core.plugin.kinds import KINDS
from gesture_core.plugin.registry import Registration, Registry


def plugins(name: str = "", *, check: bool = False) -> int:
    """List every plugin, its kind, origin and status.

    Parameters
    ----------
    name
        Only this plugin, with the options that it takes.
    check
        Import every plugin to see whether it works; exit with 3 where one does not.
    """
    found = registry()
    if name:
        _show(found, name)
        return 0
    broken = False
    rows = []
    for (kind, plugin), entries in sorted(found.entries.items()):
        for entry in entries:
            status = _status(found, entry, check=check)
            broken |= status.startswith(("broken", "ambiguous"))
            rows.append((KINDS[kind].title, plugin, status, str(entry.origin), entry.summary))
    for fault in found.faults:
        title = KINDS[fault.kind].title if fault.kind else fault.origin.entry_point
        rows.append((title, fault.name, f"broken: {fault.cause}", str(fault.origin), ""))
        broken = True
    print_table(("kind", "name", "status", "origin", "what it is"), rows)
    return 3 if check and broken else 0


def _status(found: Registry, entry: Registration, *, check: bool) -> str:
    if len(found.entries[entry.kind, entry.name]) > 1:
        return "ambiguous"
    if entry.missing:
        return f"needs {', '.join(entry.missing)}: {entry.install}"
    if not check:
        return "ok"
    try:
        found.load(entry.kind, entry.name)
    except PluginError as error:
        return f"broken: {error.cause}"
    return "ok"


def _show(found: Registry, name: str) -> None:
    kinds = [kind for kind, plugin in found.entries if plugin == name]
    if not kinds:
        every = sorted({plugin for _, plugin in found.entries})
        raise PluginError(f"no plugin {name!r}", remedy=f"one of {', '.join(every)}", code="E_PLUGIN_UNKNOWN")
    for kind in kinds:
        entry = found.find(kind, name)
        target = found.load(kind, name)
        print(f"{entry.title} of {entry.origin}: {entry.summary}\n{entry.target}\n")
        print(inspect.getdoc(target) or "", end="\n\n")
        rows = [(f"{name}.{option}", default) for option, default in _options(target)]
        if rows:
            print_table(("option", "default"), rows)


def _options(target: Any) -> list[tuple[str, str]]:
    """Options of a plugin's class with their defaults; those without one are given by the program."""
    return [
        (parameter.name, repr(parameter.default))
        for parameter in inspect.signature(target).parameters.values()
        if parameter.default is not parameter.empty
    ]
