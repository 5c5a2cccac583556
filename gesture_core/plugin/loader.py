"""Finds plugins through the entry-point group ``gesture_core``, each isolated from the others."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import redirect_stdout
from functools import cache, partial
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import pluggy

from gesture_core.plugin import hooks
from gesture_core.plugin.interfaces import KINDS
from gesture_core.plugin.registry import Fault, Origin, Registry

GROUP = hooks.PROJECT
_KIND_OF_HOOK = {kind.hook: name for name, kind in KINDS.items()}


@cache
def registry() -> Registry:
    """The plugins of this installation, found once for each process."""
    return load_registry(entry_points(group=GROUP))


def load_registry(points: Iterable[EntryPoint]) -> Registry:
    """Register every plugin of ``points``; what fails becomes a fault, never an exception."""
    found = Registry()
    for point in sorted(points, key=lambda p: (_distribution(p), p.name)):
        origin = Origin(point.name, _distribution(point), point.dist.version if point.dist else "")
        try:
            with redirect_stdout(sys.stderr):  # standard output is for results
                module = point.load()
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin may raise anything
            found.faults.append(Fault(origin, f"cannot be imported: {type(error).__name__}: {error}"))
            continue
        register_module(found, module, origin)
    return found


def _distribution(point: EntryPoint) -> str:
    return point.dist.name if point.dist else ""


def register_module(found: Registry, module: Any, origin: Origin) -> None:
    """Call every hook that ``module`` implements; unknown hooks and raising ones become faults."""
    manager = pluggy.PluginManager(GROUP)
    manager.add_hookspecs(hooks)
    try:
        manager.register(module, origin.entry_point)
    except (pluggy.PluginValidationError, ValueError) as error:
        found.faults.append(Fault(origin, f"does not fit the hook: {error}"))
        return
    for caller in manager.get_hookcallers(module) or ():
        kind = _KIND_OF_HOOK.get(caller.name)
        if kind is None:
            found.faults.append(
                Fault(origin, f"implements {caller.name!r}, which is no hook; {_nearest_hook(caller.name)}")
            )
            continue
        try:
            with redirect_stdout(sys.stderr):
                getattr(manager.hook, caller.name)(register=partial(found.add, kind, origin))
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin may raise anything
            found.faults.append(Fault(origin, f"{caller.name} raised {type(error).__name__}: {error}", kind))


def _nearest_hook(name: str) -> str:
    from difflib import get_close_matches

    near = get_close_matches(name, _KIND_OF_HOOK, 1)
    return f"did you mean {near[0]!r}?" if near else f"hooks are {', '.join(_KIND_OF_HOOK)}"
