"""Plugins by name: found through the entry-point group ``gesture_core``, each isolated from the others.

What becomes of each announcement is known before anything of a plugin is imported: registered, broken,
claimed twice, or missing a dependency. `calling` is the one place that turns what third-party code raises
into an error of this package.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import re
import sys
import threading
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from functools import cache, partial
from importlib.metadata import EntryPoint, entry_points
from itertools import filterfalse
from typing import Any

import pluggy

from gesture_core.errors import (
    ConfigError,
    GestureError,
    MissingDependencyError,
    PluginError,
    SignalError,
    described,
    near,
)
from gesture_core.files import code_sha256, switched_on
from gesture_core.plugin import hooks
from gesture_core.plugin.hooks import KINDS

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
    suffixes: tuple[str, ...] = ()
    folders: bool = False
    channels: bool = False

    def __str__(self) -> str:
        return f"{self.title} of {self.origin}"

    @property
    def identity(self) -> str:
        """Distribution and version, and a hash of the code where that may change under one version."""
        code = code_sha256(self.target.partition(":")[0])
        return f"{self.origin} (code {code[:12]})" if code else str(self.origin)

    @property
    def missing(self) -> tuple[str, ...]:
        """Modules that it needs and that are not installed."""
        return tuple(filterfalse(_installed, self.needs))

    @property
    def install(self) -> str:
        """The command that brings what is missing."""
        if not self.extra:
            return f"pip install {' '.join(self.needs)}"
        return f"pip install '{self.origin.distribution or 'gesture-core'}[{self.extra}]'"

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
        suffixes: Sequence[str] = (),
        **more: Any,
    ) -> None:
        """Record one announcement, see `hooks.Register`; a malformed or repeated one becomes a fault."""
        known = self.entries.get((kind, name), [])
        listed = isinstance(needs, Collection) and not isinstance(needs, str)
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            fault = f"{name!r} is not a name: lower-case letters, digits, hyphens"
        elif not isinstance(target, str) or not _TARGET.fullmatch(target):
            fault = f"target {target!r} is not 'module:Class'"
        elif not listed or not all(isinstance(module, str) for module in needs):
            fault = f"needs {needs!r} is no list of module names"
        elif any(entry.origin.distribution == origin.distribution for entry in known):
            fault = "registers this name twice; the first one counts"
        else:
            more |= {"needs": tuple(needs), "suffixes": tuple(suffixes)}
            self.entries[kind, name] = [*known, Registration(kind, name, target, origin, **more)]
            return
        self.faults.append(Fault(origin, fault, kind, str(name)))

    def names(self, kind: str, *, usable: bool = False) -> tuple[str, ...]:
        """Names of ``kind`` in alphabetical order; only those that can be loaded with ``usable``."""
        return tuple(
            name
            for (of, name), entries in sorted(self.entries.items())
            if of == kind and not (usable and (len(entries) > 1 or entries[0].missing))
        )

    def find(self, kind: str, name: str, others: Sequence[str] = ()) -> Registration:
        """The one registration of ``name``; ``others`` could have been meant as well.

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
        cause = f"no {title} {name!r}"
        if broken:
            cause += f" ({'; '.join(f'{fault.origin}: {fault.cause}' for fault in broken)})"
        known = [*self.names(kind), *others]
        remedy = near(name, known, f"one of {', '.join(known) or '(none)'}")
        raise PluginError(cause, remedy=remedy, code="E_PLUGIN_UNKNOWN")

    def load(self, kind: str, name: str) -> type[Any]:
        """Import the class of a plugin.

        Raises
        ------
        MissingDependencyError
            Names the command that installs what is missing.
        PluginError
            Where the name is unknown or ambiguous, the import fails, or the constructor lacks a parameter
            that every plugin of the kind is given.
        """
        entry = self.find(kind, name)
        if entry.missing:
            raise MissingDependencyError(f"{entry.title} needs {', '.join(entry.missing)}: {entry.install}")
        module, _, attribute = entry.target.partition(":")
        with calling(entry, "cannot be imported", code="E_PLUGIN_IMPORT", remedy="repair or uninstall it"):
            target: type[Any] = getattr(importlib.import_module(module), attribute)
        with calling(entry, remedy="repair or uninstall it"):
            known = _parameters(target)
        lacking = [name for name in KINDS[kind].given if known is not None and name not in known]
        if lacking:
            raise PluginError(
                f"{entry}: its constructor takes no {' and no '.join(map(repr, lacking))}",
                remedy="repair or uninstall it",
                code="E_PLUGIN_CONTRACT",
            )
        return target

    def takes(self, kind: str, name: str, option: str) -> bool:
        """Whether a plugin has an option; the parameters of its constructor are its options."""
        known = _parameters(self.load(kind, name))
        return known is None or option in known

    def make(self, kind: str, name: str, options: Mapping[str, Any] | None = None, /, **fixed: Any) -> Any:
        """Construct a plugin with ``options`` as keyword arguments.

        Raises
        ------
        ConfigError
            Where it does not take one of the options, or refuses a value.
        PluginError
            Where it raises anything else.
        """
        entry, factory = self.find(kind, name), self.load(kind, name)
        options, known = options or {}, _parameters(factory)
        remedy = f"'gesture plugins {name}' lists its options"
        own = [one for one in known or () if one not in KINDS[kind].filled]
        for option in options if known is not None else ():
            if option not in own:
                cause = f"{entry.title} has no option {option!r}"
                raise ConfigError(cause, remedy=near(option, own, remedy), code="E_OPTION")
        with calling(
            entry, remedy=f"other options ({remedy}), or repair or uninstall it", passing=(OSError,)
        ):
            try:
                return factory(**fixed, **options)
            except (TypeError, ValueError) as error:
                cause = (
                    f"{entry.title} refuses its options: {error}" if options else f"{entry.title}: {error}"
                )
                raise ConfigError(cause, remedy=remedy, code="E_OPTION") from error


def _parameters(factory: Any) -> list[str] | None:
    """Names that the constructor takes as keywords; None where it takes any, or says nothing of itself."""
    try:
        taken = inspect.signature(factory).parameters
    except (TypeError, ValueError):  # a class of another language
        return None
    names = []
    for name, parameter in taken.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            return None
        if parameter.kind is not parameter.POSITIONAL_ONLY:
            names.append(name)
    return names


@contextmanager
def calling(
    plugin: Registration | Origin | object,
    verb: str = "raised",
    *,
    code: str = "E_PLUGIN_RAISED",
    kept: str = "",
    remedy: str = "another plugin, or report it",
    passing: tuple[type[Exception], ...] = (),
) -> Iterator[None]:
    """Call third-party code in the block; whatever it raises becomes a PluginError that names it.

    Parameters
    ----------
    plugin : Registration, Origin or object
        What is called; an object is looked up by its class.
    verb : str
        What it did, in the message.
    code, kept, remedy : str
        Of the error.
    passing : exception types
        What says something of the input, and not of the plugin; it passes, as do the errors of this
        package, interrupts, and the end of memory (`E_WORKER_MEMORY`, which names the plugin).

    Raises
    ------
    PluginError
    """
    name = str(plugin) if isinstance(plugin, Registration | Origin) else name_of(plugin)
    outer = _now_calling(name)
    try:
        yield
    except SignalError as error:  # of what it returned, where the plugin itself was called
        if not isinstance(plugin, Registration | Origin):
            error.cause += f" ({name})"
        raise
    except (GestureError, *passing):  # type: ignore[misc]  # the star is more than mypy sees through
        raise
    except MemoryError as error:
        more = "a larger --set limits.memory=… (or GESTURE_SET_LIMITS__MEMORY), and --retry-errors"
        raise PluginError(f"{name}: out of memory", kept=kept, remedy=more, code="E_WORKER_MEMORY") from error
    except (Exception, SystemExit) as error:
        if tracebacks():
            print("".join(traceback.format_exception(error)), file=sys.stderr, flush=True)
        cause = f"{name} {verb}{'' if verb.endswith('raised') else ':'} {described(error)}"
        raise PluginError(cause, kept=kept, remedy=remedy, code=code) from error
    finally:
        _now_calling(outer)


def tracebacks() -> bool:
    """Whether ``GESTURE_TRACEBACK`` asks for it, or a plugin is being debugged: see `show_tracebacks`."""
    return bool(_shown) or switched_on("GESTURE_TRACEBACK")


def show_tracebacks(shown: bool) -> None:
    """Print where a plugin raised, its author's own lines, on standard error, until that is over."""
    if shown:
        _shown.append(True)
    elif _shown:
        _shown.pop()


_shown: list[bool] = []
_called = ""
_watchers: list[Callable[[str], None]] = []


def _now_calling(name: str) -> str:
    """Note which plugin is being called from now on, and return which one was.

    The calls of a plugin's own threads say nothing: nobody waits for them.
    """
    global _called
    if threading.current_thread() is not threading.main_thread():
        return ""
    outer, _called = _called, name
    for note in _watchers:
        note(name)
    return outer


def watch(note: Callable[[str], None]) -> None:
    """Have ``note`` know which plugin is being called, ``""`` where none is any more.

    A worker process tells its parent, which then knows whose code ended the process.
    """
    _watchers[:] = [note]


def name_of(plugin: object) -> str:
    """What to call a plugin's object in a message: ``filter 'speed' of my-plugin 1.0``, or its class."""
    module, name = type(plugin).__module__, type(plugin).__qualname__
    every = (entry for entries in registry().entries.values() for entry in entries)
    return next((str(entry) for entry in every if entry.target == f"{module}:{name}"), f"{module}.{name}")


@cache
def registry() -> Registry:
    """The plugins of this installation, found once for each process."""
    return load_registry(entry_points(group=hooks.PROJECT))


def load_registry(points: Iterable[EntryPoint]) -> Registry:
    """Register every plugin of ``points``; what fails becomes a fault, never an exception."""
    found = Registry()
    for point in sorted(points, key=lambda p: (p.dist.name if p.dist else "", p.name)):
        origin = Origin(point.name, *((point.dist.name, point.dist.version) if point.dist else ()))
        try:
            with calling(origin, "cannot be imported"), redirect_stdout(sys.stderr):
                module = point.load()  # standard output is for results
        except PluginError as error:
            found.faults.append(Fault(origin, error.cause.removeprefix(f"{origin} ")))
        else:
            register_module(found, module, origin)
    return found


def register_module(found: Registry, module: Any, origin: Origin) -> None:
    """Call every hook that ``module`` implements; unknown hooks and raising ones become faults."""
    kinds = {kind.hook: name for name, kind in KINDS.items()}
    manager = pluggy.PluginManager(hooks.PROJECT)
    manager.add_hookspecs(hooks)
    try:
        manager.register(module, origin.entry_point)
    except (pluggy.PluginValidationError, ValueError) as error:
        found.faults.append(Fault(origin, f"does not fit the hook: {error}"))
        return
    for caller in manager.get_hookcallers(module) or ():
        kind = kinds.get(caller.name)
        if kind is None:
            cause = f"implements {caller.name!r}, which is no hook; {near(caller.name, list(kinds))}"
            found.faults.append(Fault(origin, cause))
            continue
        try:
            with calling(origin, f"{caller.name} raised"), redirect_stdout(sys.stderr):
                getattr(manager.hook, caller.name)(register=partial(found.add, kind, origin))
        except PluginError as error:
            found.faults.append(Fault(origin, error.cause.removeprefix(f"{origin} "), kind))
