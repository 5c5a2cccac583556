"""Pages that are made from the code while the documentation is built, so that they cannot differ from it.

A hook of MkDocs. Settings come from the dataclasses of `gesture_core.settings` and their docstrings, codes from
the enumeration `gesture_core.errors.Code`, commands from their own ``--help``, interfaces and plugins
from the registry, the Python reference from the public names. A fact that is missing is a warning, and
so an error of ``mkdocs build --strict``.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import io
import logging
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from gesture_core import errors
from gesture_core.cli.main import app
from gesture_core.plugin import hooks, registry
from gesture_core.plugin.interfaces import KINDS
from gesture_core.settings import DEFAULT_PRESET, Settings, load_settings, presets
from gesture_core.types import Status

ROOT = Path(__file__).resolve().parents[1]
WIDTH = 88
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
        name = f"reference/compact/{picture.name}"
        files.append(File.generated(config, name, abs_src_path=str(picture)))
    return files


def settings_page() -> Iterator[str]:
    """Every setting with its meaning, its default and the presets' values, and the presets themselves."""
    known = {name: load_settings(name, environment={}) for name in presets()}
    yield "# Settings\n"
    yield "Later wins: defaults, preset, environment, flags.\n"
    yield "| where | how |\n|---|---|"
    yield f"| preset | `--preset NAME` or `--preset FILE.toml`, or `GESTURE_PRESET`; `{DEFAULT_PRESET}` by default |"
    yield "| environment | `GESTURE_SET_DTW__WINDOW=0.1` sets `dtw.window` |"
    yield "| flag | `--set dtw.window=0.1`; the section may be left out where the name is unique |\n"
    yield "An unknown key is an error that names the nearest one. So is an option of a plugin that takes no part."
    yield "Options of plugins are set in the same way: `--set gaussian.sigma=2`; "
    yield "they are listed with the [built-in plugins](plugins.md).\n"
    for section in dataclasses.fields(Settings):
        defaults = getattr(Settings(), section.name)
        if not dataclasses.is_dataclass(defaults):
            continue
        text, meanings = documented(type(defaults))
        yield f"## {section.name} {{ #{section.name} }}\n\n{text}\n"
        yield f"| setting | default | {' | '.join(f'`{name}`' for name in known)} | meaning |"
        yield "|---" * (len(known) + 3) + "|"
        for part in dataclasses.fields(defaults):
            kind, meaning = meanings.get(part.name, ("", ""))
            if not meaning:
                log.warning("setting %s.%s has no meaning in its docstring", section.name, part.name)
            default = getattr(defaults, part.name)
            given = [getattr(getattr(settings, section.name), part.name) for settings in known.values()]
            values = ["" if value == default else written(value) for value in given]
            cells = [f"`{section.name}.{part.name}`", written(default), *values, f"*{kind}.* {meaning}"]
            yield row(cells)
        yield ""
    yield "## Presets { #presets }\n"
    yield "A preset of one's own builds on another with `base`. A table among the options, such as"
    yield "`[options.parts.weights]`, replaces that of its base.\n"
    folder = Path(importlib.import_module("gesture_core.settings").__file__ or "").parent / "presets"
    for name in known:
        yield f"### {name}\n\n```toml\n{(folder / f'{name}.toml').read_text('utf-8').strip()}\n```\n"


def documented(kind: type) -> tuple[str, dict[str, tuple[str, str]]]:
    """The text of a dataclass's docstring, and (type, meaning) of each of its attributes."""
    text, found = "", {}
    for section in griffe.Docstring(inspect.cleandoc(kind.__doc__ or "")).parse("numpy"):
        if section.kind is griffe.DocstringSectionKind.text:
            text += section.value
        elif section.kind in (griffe.DocstringSectionKind.attributes, griffe.DocstringSectionKind.parameters):
            for item in section.value:
                for name in item.name.split(","):
                    found[name.strip()] = (str(item.annotation).replace('"', "`"), item.description)
    return text, found


def written(value: Any) -> str:
    """A value as it is written after ``--set``."""
    if isinstance(value, tuple):
        value = ",".join(map(str, value))
    names = {None: "none", True: "true", False: "false"}
    plain = names[value] if value is None or isinstance(value, bool) else value
    return f"`{plain:,}`".replace(",", "_") if isinstance(plain, int) else f"`{plain}`"


def row(cells: list[str]) -> str:
    """One row of a table; what would end a cell is escaped."""
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


def codes_page() -> Iterator[str]:
    """Every code with its status, the exit code, its meaning and the remedy."""
    yield "# Codes\n"
    yield "A row that is not plainly `ok`, and a command that fails, name one of these codes. The printed form is"
    yield "`CODE subject: cause; kept: what is still valid; try: the remedy`.\n"
    codes = getattr(errors, "Code", None)
    if codes is None:
        yield "No enumeration of codes in this version."
        return
    yield "| code | status of the row | exit code | meaning | remedy |\n|---|---|---|---|---|"
    for code in codes:
        for fact in ("meaning", "remedy"):
            if not str(getattr(code, fact, "")).strip():
                log.warning("code %s has no %s", code.name, fact)
        status = getattr(code, "status", "")
        if status and status not in Status.__args__:  # type: ignore[attr-defined]
            log.warning("code %s has the status %r, which no row has", code.name, status)
        said = f"`{status}`" if status else ""
        ends = getattr(code, "exit_code", "")
        yield row([f"`{code.value}`", said, "" if ends is None else str(ends), code.meaning, code.remedy])


def commands_page() -> Iterator[str]:
    """What every command says of itself."""
    yield "# Commands\n"
    yield "What `gesture COMMAND --help` prints.\n"
    yield "| exit code | meaning |\n|---|---|"
    for code, meaning in EXIT_CODES.items():
        yield f"| {code} | {meaning} |"
    yield f"\n```text\n{help_of()}\n```\n"
    for name in commands(app):
        yield f"## gesture {name} {{ #{name} }}\n\n```text\n{help_of(name)}\n```\n"
        for inner in commands(app[name]):
            yield f"### gesture {name} {inner}\n\n```text\n{help_of(name, inner)}\n```\n"


EXIT_CODES = {
    "0": "all done",
    "1": "fatal: the disk is full, a file is damaged; rows that were committed stay",
    "2": "usage: a flag, setting, path or name that cannot be used",
    "3": "finished with errors, degraded rows or lost examples",
    "11": "another run holds the folder",
    "130, 143": "interrupted by Ctrl-C or SIGTERM; what is committed stays, and the command to resume is printed",
    "141": "nobody reads the output",
}


def commands(group: Any) -> list[str]:
    """Names of the commands of a group, in the order of the help."""
    return sorted(name for name in group if not name.startswith("-"))


def help_of(*command: str) -> str:
    """The help of a command without its closing line, which is that of all."""
    from rich.console import Console

    screen = Console(file=io.StringIO(), width=WIDTH, force_terminal=False)
    app.help_print(list(command), console=screen)
    text = screen.file.getvalue()  # type: ignore[attr-defined]
    return "\n".join(line.rstrip() for line in text.partition("Exit codes:")[0].strip().splitlines())


def interfaces_page() -> Iterator[str]:
    """Kinds of plugin with their hooks, and the interface of each."""
    yield "# Plugin interfaces\n"
    yield "A plugin announces names through a hook. The class behind a name fulfils the interface of its kind."
    yield "How to write one: [Write a plugin](../howto/plugins.md).\n"
    yield "| kind | hook | what it is |\n|---|---|---|"
    for kind in KINDS.values():
        about = inspect.getdoc(getattr(hooks, kind.hook))
        if not about:
            log.warning("hook %s has no docstring", kind.hook)
        yield row([kind.title, f"`{kind.hook}`", (about or "").splitlines()[0]])
    yield "\n## Registration\n\n::: gesture_core.plugin.hooks.Register\n    options: {heading_level: 3}\n"
    yield "## Interfaces\n\n::: gesture_core.plugin.interfaces"
    yield "    options: {show_root_heading: false, show_root_toc_entry: false, heading_level: 3,"
    yield '              filters: ["!^_", "!^KINDS$", "!^Kind$"]}\n'
    yield "## Conformance suite\n\n::: gesture_core.testing"
    yield "    options: {show_root_heading: false, show_root_toc_entry: false, heading_level: 3}\n"


def plugins_page() -> Iterator[str]:
    """The plugins of this distribution with their options."""
    yield "# Built-in plugins\n"
    yield "`gesture plugins` lists those of an installation, `gesture plugins NAME` the options of one with the"
    yield "preset's values. An option is set with `--set NAME.OPTION=VALUE`.\n"
    found = registry()
    own = {kind: [found.find(kind, name) for name in found.names(kind)] for kind in KINDS}
    own = {kind: [e for e in entries if e.origin.distribution == "gesture-core"] for kind, entries in own.items()}
    yield "| kind | names |\n|---|---|"
    for kind, entries in own.items():
        names = ", ".join(f"[`{entry.name}`](#{kind}-{entry.name})" for entry in entries)
        yield row([KINDS[kind].title, names])
    for kind, entries in own.items():
        yield f"\n## {KINDS[kind].title.capitalize()}\n"
        for entry in entries:
            yield f"### {entry.name} {{ #{kind}-{entry.name} }}\n\n{entry.summary.capitalize()}.\n"
            yield f"::: {entry.target.replace(':', '.')}"
            yield "    options: {show_root_heading: false, show_root_toc_entry: false, heading_level: 4,"
            yield "              members: false, merge_init_into_class: false}\n"


def python_page() -> Iterator[str]:
    """The public names of the package."""
    yield "# Python\n"
    yield "Everything that `import gesture_core` offers. A name is imported when it is first used; importing the"
    yield "package imports no NumPy.\n"
    yield from public_names("gesture_core")


def dtw_page() -> Iterator[str]:
    """The public names of the warping distances."""
    yield "# Warping distances\n"
    yield "`gesture_core.dtw`: a library of warping distances that needs no keypoints and no videos."
    yield "Which choices other libraries make:\n"
    yield "| library | the same as |\n|---|---|"
    yield '| dtaidistance, tslearn | `DtwSpec(cost="squared", root=True)` |'
    yield '| aeon | `DtwSpec(cost="squared")` |'
    yield '| fastdtw | `DtwSpec(cost="absolute")` |\n'
    yield from public_names("gesture_core.dtw")


def public_names(module_name: str) -> Iterator[str]:
    """A directive of mkdocstrings for each public name of a module, where it is defined."""
    module = importlib.import_module(module_name)
    for name in getattr(module, "__all__", ()):
        value = getattr(module, name)
        if name == "__version__" or inspect.ismodule(value):
            continue
        yield f"::: {defined_in(name, value)}.{name}\n"


def defined_in(name: str, value: Any) -> str:
    """The module in which a public name is defined."""
    home = getattr(value, "__module__", None)
    if home and home.startswith("gesture_") and hasattr(value, "__qualname__"):
        return str(home)
    for module_name, module in sorted(sys.modules.items()):
        if module_name.startswith("gesture_core.") and vars(module).get(name) is value:
            return module_name
    raise LookupError(f"no module of gesture_core defines {name}")
