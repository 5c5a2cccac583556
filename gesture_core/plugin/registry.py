"""Names of plugins and what became of each: registered, broken, ambiguous, or missing a dependency."""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import inspect
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gesture_core.errors import ConfigError, GestureError, MissingDependencyError, PluginError
from gesture_core.plugin.interfaces import KINDS

_OURS = "gesture-core"
_NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_TARGET = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


@dataclass(frozen=True)
class Origin:
    """Where a plugin comes from: its entry point, distribution and version."""

    entry_point: str
    distribution: str = ""
    version: str = ""

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".strip() or self.entry_point

    @property
    def built_in(self) -> bool:
        """Whether it is part of this package, and not a third party's."""
        return self.distribution == _OURS


@dataclass(frozen=True)
class Registration:
    """One plugin as it was announced; nothing of it has been imported."""

    kind: str
    name: str
    target: str
    origin: Origin
    needs: tuple[str, ...] = ()
    extra: str = ""
    summary: str = ""

    @property
    def missing(self) -> tuple[str, ...]:
        """Modules that it needs and that are not installed."""
        return tuple(module for module in self.needs if not _installed(module))

    @property
    def install(self) -> str:
        """The command that brings what is missing."""
        if not self.extra:
            return f"pip install {' '.join(self.needs)}"
        return f"pip install '{self.origin.distribution or _OURS}[{self.extra}]'"

    @property
    def title(self) -> str:
        """The name in a sentence: ``pose backend 'onnx'``."""
        return f"{KINDS[self.kind].title} {self.name!r}"


def _installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except (Exception, SystemExit):  # noqa: BLE001 - looking for a.b imports a, which may raise anything
        return False


@dataclass(frozen=True)
class Fault:
    """A plugin, or a part of one, that cannot be used, and why."""

    origin: Origin
    cause: str
    kind: str = ""
    name: str = ""


@dataclass
class Registry:
    """All plugins of an installation, by kind and name."""

    entries: dict[tuple[str, str], list[Registration]] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)

    def add(
        self,
        kind: str,
        origin: Origin,
        name: str,
        target: str,
        needs: Sequence[str] = (),
        extra: str = "",
        summary: str = "",
    ) -> None:
        """Record one announcement; a malformed or repeated one becomes a fault."""
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            self.faults.append(
                Fault(origin, f"{name!r} is not a name: lower-case letters, digits, hyphens", kind, str(name))
            )
            return
        if not isinstance(target, str) or not _TARGET.fullmatch(target):
            self.faults.append(Fault(origin, f"target {target!r} is not 'module:Class'", kind, name))
            return
        listed = isinstance(needs, Collection) and not isinstance(needs, str)
        if not listed or not all(isinstance(module, str) for module in needs):
            self.faults.append(Fault(origin, f"needs {needs!r} is no list of module names", kind, name))
            return
        known = self.entries.setdefault((kind, name), [])
        if any(entry.origin.distribution == origin.distribution for entry in known):
            self.faults.append(Fault(origin, "registers this name twice; the first one counts", kind, name))
            return
        known.append(Registration(kind, name, target, origin, tuple(needs), extra, summary))

    def names(self, kind: str, *, usable: bool = False) -> tuple[str, ...]:
        """Names of ``kind`` in alphabetical order; only those that can be loaded with ``usable``."""
        found = sorted(name for k, name in self.entries if k == kind)
        if usable:
            found = [
                name
                for name in found
                if len(self.entries[kind, name]) == 1 and not self.entries[kind, name][0].missing
            ]
        return tuple(found)

    def find(self, kind: str, name: str) -> Registration:
        """The one registration of ``name``.

        Raises
        ------
        PluginError
            Where the name is unknown (with the nearest known ones) or claimed twice.
        """
        found = self.entries.get((kind, name), [])
        if len(found) == 1:
            return found[0]
        title = KINDS[kind].title
        if found:
            claims = " and ".join(str(entry.origin) for entry in found)
            raise PluginError(
                f"{title} {name!r} is claimed by {claims}",
                remedy="uninstall one of them",
                code="E_PLUGIN_AMBIGUOUS",
            )
        broken = [fault for fault in self.faults if fault.name in ("", name) and fault.kind in ("", kind)]
        known = self.names(kind)
        near = difflib.get_close_matches(str(name), known, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        cause = f"no {title} {name!r}"
        if broken:
            cause += f" ({'; '.join(f'{fault.origin}: {fault.cause}' for fault in broken)})"
        raise PluginError(
            cause, remedy=f"{hint}one of {', '.join(known) or '(none installed)'}", code="E_PLUGIN_UNKNOWN"
        )

    def origin(self, plugin: Any) -> Origin | None:
        """Where the class of an object comes from, if it is a registered plugin."""
        target = f"{type(plugin).__module__}:{type(plugin).__qualname__}"
        every = (entry for entries in self.entries.values() for entry in entries)
        return next((entry.origin for entry in every if entry.target == target), None)

    def load(self, kind: str, name: str) -> type[Any]:
        """Import the class of a plugin.

        Raises
        ------
        MissingDependencyError
            Names the command that installs what is missing.
        PluginError
            Where the name is unknown or ambiguous, or the import fails.
        """
        entry = self.find(kind, name)
        if entry.missing:
            raise MissingDependencyError(f"{entry.title} needs {', '.join(entry.missing)}: {entry.install}")
        module, _, attribute = entry.target.partition(":")
        try:
            return getattr(importlib.import_module(module), attribute)
        except (Exception, SystemExit) as error:
            raise PluginError(
                f"{entry.title} of {entry.origin} cannot be imported: {type(error).__name__}: {error}",
                remedy="repair or uninstall it",
                code="E_PLUGIN_IMPORT",
            ) from error

    def make(self, kind: str, name: str, options: Mapping[str, Any] | None = None, **fixed: Any) -> Any:
        """Construct a plugin with ``options`` as keyword arguments.

        Raises
        ------
        ConfigError
            Where it does not take one of the options, or refuses a value.
        PluginError
            Where it raises anything else.
        """
        entry = self.find(kind, name)
        factory = self.load(kind, name)
        options = options or {}
        _refuse_unknown(entry, factory, options)
        try:
            return factory(**fixed, **options)
        except (TypeError, ValueError) as error:
            raise ConfigError(
                f"{entry.title} refuses its options: {error}" if options else f"{entry.title}: {error}",
                remedy=f"'gesture plugins {name}' lists its options",
                code="E_OPTION",
            ) from error
        except (GestureError, MemoryError, OSError):
            raise
        except (Exception, SystemExit) as error:
            raise PluginError(
                f"{entry.title} of {entry.origin} raised {type(error).__name__}: {error}",
                remedy=f"other options ('gesture plugins {name}' lists them), or repair or uninstall it",
                code="E_PLUGIN_RAISED",
            ) from error


def _refuse_unknown(entry: Registration, factory: Any, options: Mapping[str, Any]) -> None:
    """A ConfigError for the first option that the plugin's class does not name."""
    try:
        taken = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):  # a class of another language says nothing of itself
        return
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in taken):
        return
    known = [parameter.name for parameter in taken if parameter.kind is not parameter.POSITIONAL_ONLY]
    for option in options:
        if option not in known:
            near = difflib.get_close_matches(option, known, 1)
            raise ConfigError(
                f"{entry.title} has no option {option!r}",
                remedy=(f"did you mean {near[0]!r}? " if near else "")
                + f"'gesture plugins {entry.name}' lists its options",
                code="E_OPTION",
            )
