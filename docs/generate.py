"""Pages that are made from the code while the documentation is built, so that they cannot differ from it.

A hook of MkDocs. Settings come from the dataclasses of `gesture_core.settings` and their docstrings, codes
from the enumeration `gesture_core.errors.Code`, commands from their own ``--help``, interfaces and plugins
from the registry, the Python reference from the public names. A fact that is missing is a warning, and
so an error of ``mkdocs build --strict``.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import inspect
import io
import logging
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from rich.console import Console

from gesture_core.cli.main import app
from gesture_core.errors import Code, Status
from gesture_core.plugin import hooks, registry
from gesture_core.plugin.hooks import KINDS
from gesture_core.plugin.interfaces import INTERFACES
from gesture_core.settings import DEFAULT_PRESET, Settings, load_settings, presets
from gesture_core.testing import checks_for

ROOT = Path(__file__).resolve().parents[1]
WIDTH = 80
EXIT_CODES = {
    "0": "all done",
    "1": "fatal: a full disk, a damaged file; rows that were committed stay",
    "2": "usage: a flag, setting, path or name that cannot be used",
    "3": "finished with errors, degraded rows or lost examples",
    "11": "another run holds the folder",
    "130": "interrupted by Ctrl-C; what is committed stays, and the command to resume is printed",
    "143": "the same by SIGTERM",
    "141": "nobody reads the output",
}
EXCHANGED = {
    "gesture_core.records": ("VideoLimits", "VideoInfo", "VideoReport", "Job", "Task", "Outcome"),
    "gesture_core.types": ("Person",),
}
"""What plugins take and give besides what every user of Python meets, by its module."""
log = logging.getLogger("mkdocs.docs.generate")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add every page that is made here."""
    pages = {
        "reference/settings.md": settings_page,
        "reference/codes.md": codes_page,
        "reference/commands.md": commands_page,
        "reference/interfaces.md": interfaces_page,
        "reference/plugins.md": plugins_page,
        "reference/python.md": python_page,
        "reference/dtw.md": dtw_page,
    }
    for name, make in pages.items():
        files.append(File.generated(config, name, content="\n".join(make())))
    for name in ("CHANGELOG.md", "CONTRIBUTING.md"):
        files.append(File.generated(config, name.lower(), abs_src_path=str(ROOT / name)))
    (card,) = ROOT.glob("plugins/*/*/models/MODEL_CARD.md")
    files.append(File.generated(config, "reference/compact/index.md", abs_src_path=str(card)))
    for picture in card.parent.glob("*.png"):
        place = f"reference/compact/{picture.name}"
        files.append(File.generated(config, place, abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in the tables that a page asks for by name in double braces; a figure keeps its unit in a cell."""
    for name, make in {"kinds": kinds_table, "extras": extras_table}.items():
        if (asked := f"{{{{ {name} }}}}") in markdown:
            markdown = markdown.replace(asked, "\n".join(make()))
    return re.sub(
        r"^\|.*$", lambda line: re.sub(r"(?<=\d) (?=%|µs)", "\u00a0", line[0]), markdown, flags=re.MULTILINE
    )


def row(*cells: str) -> str:
    """One row of a table; what would end a cell is escaped."""
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


def settings_page() -> Iterator[str]:
    """Every setting with its meaning, its default and the presets' values, and the presets themselves."""
    known = {name: load_settings(name, environment={}) for name in presets()}
    yield "# Settings\n\nLater wins: default, preset, environment, flag.\n"
    yield "| where | how |\n|---|---|"
    yield row(
        "preset",
        f"`--preset NAME` or `--preset FILE.toml`, or `GESTURE_PRESET`; `{DEFAULT_PRESET}` by default",
    )
    yield row("environment", "`GESTURE_SET_DTW__WINDOW=0.1` sets `dtw.window`")
    yield row("flag", "`--set dtw.window=0.1`; the section may be left out where the name is unique")
    yield "\nAn unknown key is an error that names the nearest one, and so is an option of a plugin that"
    yield "takes no part. Options of plugins are set in the same way, `--set gaussian.sigma=2`; they are"
    yield "listed with the [built-in plugins](plugins.md). On the command line: `gesture settings [KEY]`.\n"
    for section in dataclasses.fields(Settings):
        defaults = getattr(Settings(), section.name)
        if dataclasses.is_dataclass(defaults):
            yield from settings_section(section.name, defaults, known)
    yield "## Presets { #presets }\n\nA preset of one's own builds on another with `base`. A table among the"
    yield "options, such as `[options.parts.weights]`, replaces that of its base.\n"
    folder = Path(importlib.import_module("gesture_core.settings").__file__ or "").parent / "presets"
    for name in known:
        yield f"### {name}\n\n```toml\n{(folder / f'{name}.toml').read_text('utf-8').strip()}\n```\n"


def settings_section(name: str, defaults: Any, known: dict[str, Settings]) -> Iterator[str]:
    """The settings of one section; a preset's value is shown where it is not the default."""
    text, meanings = documented(type(defaults))
    known = {preset: settings for preset, settings in known.items() if getattr(settings, name) != defaults}
    yield f"## {name} {{ #{name} }}\n\n{text}\n"
    yield row("setting", "default", *known, "meaning")
    yield "|---" * (len(known) + 3) + "|"
    for part in dataclasses.fields(defaults):
        kind, meaning = meanings.get(part.name, ("", ""))
        if not meaning:
            log.warning("setting %s.%s has no meaning in its docstring", name, part.name)
        default = getattr(defaults, part.name)
        given = [getattr(getattr(settings, name), part.name) for settings in known.values()]
        values = ["" if value == default else written(value) for value in given]
        yield row(f"`{name}.{part.name}`", written(default), *values, f"*{kind}.* {meaning}")
    yield ""


def documented(kind: type) -> tuple[str, dict[str, tuple[str, str]]]:
    """The text of a class's docstring, and (type, meaning) of each of its attributes and parameters."""
    text, found = "", {}
    automatic = f"{kind.__name__}("  # what dataclass writes where nobody did
    own = "" if (kind.__doc__ or "").startswith(automatic) else inspect.cleandoc(kind.__doc__ or "")
    for section in griffe.Docstring(own).parse("numpy", warnings=False):
        if section.kind is griffe.DocstringSectionKind.text:
            text += section.value
        elif section.kind in (griffe.DocstringSectionKind.attributes, griffe.DocstringSectionKind.parameters):
            for item in section.value:
                for name in item.name.split(","):
                    found[name.strip()] = (str(item.annotation).replace('"', "`"), item.description)
    return text, found


def written(value: Any) -> str:
    """A value as it is written after ``--set``."""
    if value is None or isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, Mapping):
        return ", ".join(f"`{key}` {inner}" for key, inner in value.items())
    return f"`{', '.join(map(str, value)) if isinstance(value, tuple) else value}`"


def codes_page() -> Iterator[str]:
    """Every code with the status of its row, the exit code, its meaning and the remedy."""
    yield "# Codes\n\nA row that is not plainly `ok`, and a command that fails, name one of these codes. The"
    yield "printed form is `CODE subject: cause; kept: what is still valid; try: the remedy`.\n"
    yield "| code | status of the row | exit code | meaning | remedy |\n|---|---|---|---|---|"
    for code in Code:
        for fact in ("meaning", "remedy"):
            if not str(getattr(code, fact)).strip():
                log.warning("code %s has no %s", code.name, fact)
        if code.status and code.status not in get_args(Status):
            log.warning("code %s has the status %r, which no row has", code.name, code.status)
        status = f"`{code.status}`" if code.status else ""
        ends = "" if code.exit_code is None else str(code.exit_code)
        yield row(f"`{code.value}`", status, ends, code.meaning, code.remedy)


def commands_page() -> Iterator[str]:
    """What every command says of itself."""
    yield "# Commands\n\nWhat `gesture COMMAND --help` prints.\n\n| exit code | meaning |\n|---|---|"
    for code, meaning in EXIT_CODES.items():
        yield row(code, meaning)
    if unknown := set(re.findall(r"\d+", str(app.help_epilogue))) - set(EXIT_CODES):
        log.warning("exit codes without a meaning here: %s", ", ".join(sorted(unknown)))
    yield f"\n```text\n{help_of()}\n```\n"
    for name in commands(app):
        yield f"## gesture {name} {{ #{name} }}\n\n```text\n{help_of(name)}\n```\n"
        for inner in commands(app[name]):
            yield f"### gesture {name} {inner}\n\n```text\n{help_of(name, inner)}\n```\n"


def commands(group: Any) -> list[str]:
    """Names of the commands of a group."""
    return sorted(name for name in group if not name.startswith("-"))


def help_of(*command: str) -> str:
    """The help of a command without its closing lines, which are those of all."""
    screen = io.StringIO()
    app.help_print(list(command), console=Console(file=screen, width=WIDTH, force_terminal=False))
    text = screen.getvalue().partition("Exit codes:")[0]
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


def interfaces_page() -> Iterator[str]:
    """Kinds of plugin with their hooks, and the interface of each."""
    yield "# Plugin interfaces\n\nA plugin announces names through a hook. The class behind a name fulfils"
    yield "the interface of its kind. How to write one: [Write a plugin](../howto/plugins.md).\n"
    yield "| kind | hook | what it is | interface | checks |\n|---|---|---|---|---|"
    for name, kind in KINDS.items():
        about = (inspect.getdoc(getattr(hooks, kind.hook)) or "").partition("\n")[0]
        if not about:
            log.warning("hook %s has no docstring", kind.hook)
        about = about.replace(f"(`{INTERFACES[name].__name__}`)", "").rstrip(". ")
        interface, checks = f"`{INTERFACES[name].__name__}`", f"`{name.upper()}_CHECKS`"
        yield row(kind.title, f"`{kind.hook}`", about, interface, checks)
    yield "\n## Registration\n\n::: gesture_core.plugin.hooks.Register"
    yield "    options: {heading_level: 3, members: [__call__], filters: []}\n"
    yield "## Interfaces\n\n::: gesture_core.plugin.interfaces"
    yield "    options: {show_root_heading: false, show_root_toc_entry: false, heading_level: 3,"
    yield '              filters: ["!^_", "!^INTERFACES$"]}\n'
    yield "## Abilities\n\n::: gesture_core.plugin.abilities"
    yield "    options: {show_root_heading: false, show_root_toc_entry: false, heading_level: 3}\n"
    yield "## What they exchange\n"
    for home, names in EXCHANGED.items():
        yield from (f"::: {home}.{name}\n    options: {{heading_level: 3}}\n" for name in names)
    yield "## Conformance suites\n\n::: gesture_core.testing"
    yield "    options: {show_root_heading: false, show_root_toc_entry: false, members: false}\n"
    for name, kind in KINDS.items():
        yield f"### `{name.upper()}_CHECKS`\n\nOf a {kind.title}:\n"
        for check in checks_for(name):
            yield f"- `{check.__name__}`: {(inspect.getdoc(check) or '').partition(chr(10))[0]}"
        yield ""


def kinds_table() -> Iterator[str]:
    """Kinds of plugin with their hooks and what a class of each kind has."""
    yield "| kind | `KIND` | hook | a class with |\n|---|---|---|---|"
    for name, kind in KINDS.items():
        parts = ", ".join(f"`{part}`" for part in members_of(INTERFACES[name]))
        yield row(kind.title, f"`{name}`", f"`{kind.hook}`", parts)


def members_of(interface: type) -> list[str]:
    """Attributes and methods of a Protocol."""
    methods = {
        name: list(inspect.signature(method).parameters)[1:]
        for name, method in vars(interface).items()
        if inspect.isfunction(method) and not name.startswith("_")
    }
    return [*interface.__annotations__, *(f"{name}({', '.join(given)})" for name, given in methods.items())]


def extras_table() -> Iterator[str]:
    """The extras of the distribution and what they bring."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    yield "| extra | brings |\n|---|---|"
    for extra, needs in project["optional-dependencies"].items():
        yield row(f"`{extra}`", ", ".join(f"`{need}`" for need in needs))


def plugins_page() -> Iterator[str]:
    """The plugins of this repository with their options."""
    yield "# Built-in plugins\n\n`gesture plugins` lists those of an installation, `gesture plugins NAME` the"
    yield "options of one with the preset's values. `--set NAME.OPTION=VALUE` sets one.\n"
    found = registry()
    every = {kind: [found.find(kind, name) for name in found.names(kind)] for kind in KINDS}
    own = {kind: [entry for entry in entries if is_here(entry.target)] for kind, entries in every.items()}
    yield "| kind | names |\n|---|---|"
    for kind, entries in own.items():
        names = ", ".join(f"[`{entry.name}`](#{kind}-{entry.name})" for entry in entries)
        yield row(KINDS[kind].title, names)
    for kind, entries in own.items():
        yield f"\n## {KINDS[kind].title.capitalize()}\n"
        for entry in entries:
            summary = entry.summary[:1].upper() + entry.summary[1:]
            yield f"### {entry.name} {{ #{kind}-{entry.name} }}\n\n{summary}.\n"
            module, _, name = entry.target.partition(":")
            try:  # not by the registry: what imports its package when it is used needs none here
                target = getattr(importlib.import_module(module), name)
            except ImportError:
                log.warning("%s needs %s to be documented", entry.title, ", ".join(entry.missing))
                continue
            yield from plugin_options(entry.name, target, KINDS[kind].filled)


def plugin_options(name: str, target: type, given: tuple[str, ...]) -> Iterator[str]:
    """What a plugin's class says of itself, and its options with their defaults and the preset's values."""
    text, _ = documented(target)
    meanings = {part: said for kind in reversed(target.__mro__) for part, said in documented(kind)[1].items()}
    yield f"{text}\n"
    options = [part for part in inspect.signature(target).parameters.values() if part.name not in given]
    if not options:
        return
    chosen = {preset: load_settings(preset, environment={}).options.get(name, {}) for preset in presets()}
    chosen = {preset: values for preset, values in chosen.items() if values}
    yield row("option", "default", *chosen, "meaning")
    yield "|---" * (len(chosen) + 3) + "|"
    for part in options:
        kind, meaning = meanings.get(part.name, ("", ""))
        if not meaning:
            log.warning("option %s.%s has no meaning in a docstring", name, part.name)
        default = "" if part.default is part.empty else written(part.default)
        values = [written(v[part.name]) if part.name in v else "" for v in chosen.values()]
        yield row(f"`{name}.{part.name}`", default, *values, f"*{kind}.* {meaning}")
    yield ""


def is_here(target: str) -> bool:
    """Whether a plugin's code is part of this repository."""
    spec = importlib.util.find_spec(target.partition(".")[0].partition(":")[0])
    return bool(spec and spec.origin and Path(spec.origin).is_relative_to(ROOT))


def python_page() -> Iterator[str]:
    """The public names of the package, but for those that it shares with the warping distances."""
    names, distances = public_names("gesture_core"), public_names("gesture_core.dtw")
    both = sorted(names.keys() & distances.keys())
    yield "# Python\n\nEverything that `import gesture_core` offers. A name is imported when it is first"
    yield "used; importing the package imports no NumPy.\n"
    yield f"{', '.join(f'`{name}`' for name in both)}: see [Warping distances](dtw.md).\n"
    yield from (f"::: {home}.{name}\n" for name, home in names.items() if name not in both)


def dtw_page() -> Iterator[str]:
    """The public names of the warping distances."""
    yield "# Warping distances\n\n`gesture_core.dtw`: a library of warping distances that needs neither"
    yield "keypoints nor videos. What other libraries compute:\n"
    yield "| library | the same as |\n|---|---|"
    yield row("dtaidistance, tslearn", '`DtwSpec(cost="squared", root=True)`')
    yield row("aeon", '`DtwSpec(cost="squared")`')
    yield row("fastdtw", '`DtwSpec(cost="absolute")`')
    yield ""
    yield from (f"::: {home}.{name}\n" for name, home in public_names("gesture_core.dtw").items())


def public_names(module_name: str) -> dict[str, str]:
    """The public names of a module in alphabetical order, with the modules in which they are defined."""
    module = importlib.import_module(module_name)
    names = sorted(getattr(module, "__all__", ()), key=str.lower)
    values = {name: getattr(module, name) for name in names if name != "__version__"}
    return {name: defined_in(name, value) for name, value in values.items() if not inspect.ismodule(value)}


def defined_in(name: str, value: Any) -> str:
    """The module in which a public name is defined."""
    home = str(getattr(value, "__module__", ""))
    if home.startswith("gesture_") and hasattr(value, "__qualname__"):
        return home
    for module_name, module in sorted(sys.modules.items()):
        if module_name.startswith("gesture_core.") and vars(module).get(name) is value:
            return module_name
    raise LookupError(f"no module of gesture_core defines {name}")
