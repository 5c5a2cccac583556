"""``gesture plugins``: what is installed, where it comes from, whether it works; and a new one."""

from __future__ import annotations

import inspect
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from cyclopts import Parameter

from gesture_core.cli.flags import UNSAID
from gesture_core.cli.output import counted, print_list, print_table, say
from gesture_core.errors import GestureError, MissingDependencyError, ModelError, PluginError, PoseError, near
from gesture_core.files import printable
from gesture_core.plugin import registry
from gesture_core.plugin.abilities import lacking
from gesture_core.plugin.hooks import KINDS
from gesture_core.plugin.registry import Registration, Registry, calling
from gesture_core.settings import load_settings

_PARAMETERS = "\n\nParameters\n----------\n"

app = cyclopts.App(
    name="plugins",
    help="List every plugin, its kind, origin and status.",
    help_format="plaintext",
    default_parameter=Parameter(negative=()),
)


@app.default
def list_plugins(name: Annotated[str, UNSAID] = "", /, *, check: Annotated[bool, UNSAID] = False) -> int:
    """List every plugin, its kind, origin and status.

    Parameters
    ----------
    name
        Only this plugin, with the options that it takes.
    check
        Import and make every plugin to see whether it works; exit with 3 where one does not.
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
    print_list(("kind", "name", "status", "origin", "what it is"), rows)
    if check:
        bad = sum(row[2].startswith(("broken", "ambiguous")) for row in rows)
        say(
            f"{bad} of {counted(len(rows), 'plugin')} cannot be used"
            if bad
            else "all plugins that are installed work"
        )
    return 3 if check and broken else 0


@app.command
def new(
    kind: Annotated[str, Parameter(help=f"What it is: {', '.join(KINDS)}.")],
    name: Annotated[str, Parameter(help="Lower-case letters, digits and hyphens.")],
    /,
    *,
    out: Annotated[Path, Parameter(help="The folder in which its own folder is made.")] = Path(),
) -> int:
    """Write a new plugin: a distribution gesture-NAME with a working example, whose tests pass."""
    from gesture_core.plugin.template import write_plugin

    folder, *files = write_plugin(kind, name, out)
    print(f"{printable(folder)}/")
    for file in files:
        print(f"  {file.relative_to(folder)}")
    print(f"next: pip install -e {shlex.quote(str(folder))}, then: gesture plugins {name}")
    return 0


def _status(found: Registry, entry: Registration, *, check: bool) -> str:
    if len(found.entries[entry.kind, entry.name]) > 1:
        return "ambiguous"
    if entry.missing:
        return f"needs {', '.join(entry.missing)}: {entry.install}"
    if not check:
        return "ok"
    try:
        with calling(entry, passing=(OSError,)):
            _make(found, entry)
    except (ModelError, PoseError):  # a backend may need another network than the one that it is given here
        return "ok"
    except MissingDependencyError as error:
        return error.cause
    except GestureError as error:
        return f"broken: {error.cause}"
    except OSError as error:
        return f"broken: {error}"
    return "ok"


def _make(found: Registry, entry: Registration) -> None:
    """Import a plugin, and make one of it where the program knows all that it needs.

    Raises
    ------
    GestureError, OSError
        Whatever is wrong with it, such as a pose backend that takes no ``model``.
    """
    from gesture_core.plugin.abilities import Closeable
    from gesture_core.plugin.interfaces import INTERFACES
    from gesture_core.pose.models import choose_pose, find_model

    target, kind = found.load(entry.kind, entry.name), KINDS[entry.kind]
    try:
        signature = inspect.signature(target)
    except (TypeError, ValueError):  # a class of another language says nothing of itself
        return
    try:
        signature.bind(**dict.fromkeys(kind.given))
    except TypeError:  # an option without a default is for the user to give
        return
    settings = choose_pose(load_settings())
    values: dict[str, Any] = {}
    if "model" in kind.given:
        values["model"] = find_model(settings.pose.model)
    if "workers" in kind.given:
        values |= {"workers": 1, "limits": settings.limits}
    made, interface = found.make(entry.kind, entry.name, {}, **values), INTERFACES[entry.kind]
    wanted = [name for name in {**vars(interface), **interface.__annotations__} if not name.startswith("_")]
    absent = sorted(name for name in wanted if not hasattr(made, name))
    if isinstance(made, Closeable):
        made.close()
    if absent:
        raise PluginError(f"it has no {' and no '.join(absent)}, as every {kind.title} does")
    if part := lacking(entry.kind, made):
        raise PluginError(part)


def _show(found: Registry, name: str) -> None:
    kinds = [kind for kind, plugin in found.entries if plugin == name]
    if not kinds:
        every = sorted({plugin for _, plugin in found.entries})
        raise PluginError(f"no plugin {name!r}", remedy=near(name, every), code="E_PLUGIN_UNKNOWN")
    for kind in kinds:
        entry = found.find(kind, name)
        target = found.load(kind, name)
        with calling(entry):
            text, options = documentation(target), options_of(target, KINDS[kind].filled)
        print(f"{entry.title} of {entry.origin}: {entry.summary}\n{entry.target}\n")
        print(text, end="\n\n")
        if not options:
            continue
        columns, rows = ["option", "default"], [[f"{name}.{option}", value] for option, value in options]
        settings = load_settings()
        chosen = settings.options.get(name, {})
        if chosen:
            columns.append(f"preset {settings.preset}")
            for row, (option, _) in zip(rows, options, strict=True):
                row.append(written(chosen[option]) if option in chosen else "")
        print_table(columns, rows)
        print(f"to change one: --set {name}.{options[0][0]}=…")


def documentation(target: Any) -> str:
    """The docstring of a class, with the parameters of its bases below its own."""
    text = inspect.getdoc(target) or ""
    for base in target.__mro__[1:] if isinstance(target, type) else ():
        _, heading, more = inspect.cleandoc(base.__doc__ or "").partition(_PARAMETERS)
        if heading and more not in text:
            before, _, own = text.partition(_PARAMETERS)
            own, blank, after = own.partition("\n\n")
            text = "".join([before, _PARAMETERS, own and f"{own}\n", more, blank, after])
    return text


def options_of(target: Any, given: Sequence[str]) -> list[tuple[str, str]]:
    """Options of a plugin's class with their defaults, without what is ``given`` by the program."""
    try:
        parameters = inspect.signature(target).parameters.values()
    except (TypeError, ValueError):  # a class of another language says nothing of itself
        return []
    made = (
        {f.name: f.default_factory() for f in fields(target) if f.default_factory is not MISSING}
        if is_dataclass(target)
        else {}
    )
    return [
        (
            parameter.name,
            "(required)"
            if parameter.default is parameter.empty
            else written(made.get(parameter.name, parameter.default)),
        )
        for parameter in parameters
        if parameter.name not in given
        and parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
    ]


def written(value: Any) -> str:
    """``value`` as it would stand in a preset or after ``--set``."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{json.dumps(key)} = {written(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(written, value))}]"
    if isinstance(value, str | bool):
        return json.dumps(value)
    return "none" if value is None else repr(value)
