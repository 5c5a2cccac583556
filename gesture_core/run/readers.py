"""Whose keypoint file is it? Readers are asked; those of third parties in a process of their own."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from gesture_core.errors import GestureError, PluginError
from gesture_core.plugin import registry
from gesture_core.run.sandbox import Sandbox, SandboxDeath

_TOGETHER = 1000

Fault = tuple[str, str]
"""Code and cause of a reader's failure to say whether a file is its own."""


def accepts(reader: str, path: Path) -> bool | Fault:
    """Whether ``reader`` takes ``path``; where that fails, why."""
    try:
        return bool(registry().make("reader", reader).accepts(path))
    except GestureError as error:
        return error.code, error.cause
    except OSError as error:
        return "E_READ", f"{_title(reader)} cannot read it: {error.strerror or error}"
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin may raise anything
        return "E_PLUGIN_RAISED", f"{_title(reader)} raised {type(error).__name__}: {error}"


def members(reader: str, path: Path) -> list[str]:
    """Names of the sequences in ``path``, one at least.

    Raises
    ------
    GestureError
        What the reader says of the file, or a PluginError that names the reader.
    """
    try:
        found = list(registry().make("reader", reader).members(path))
    except GestureError:
        raise
    except (Exception, SystemExit) as error:
        cause = f"{_title(reader)} raised {type(error).__name__}: {error}"
        raise PluginError(cause, code="E_PLUGIN_RAISED") from error
    if not found or not all(isinstance(member, str) for member in found):
        cause = f"{_title(reader)} says that its members are {str(found)[:80]}"
        raise PluginError(cause, code="E_PLUGIN_CONTRACT")
    return found


def _title(reader: str) -> str:
    entry = registry().find("reader", reader)
    return f"{entry.title} of {entry.origin}"


class Readers:
    """All usable readers.

    Parameters
    ----------
    sandbox : Sandbox or None
        Where those of third parties run; None for this process.
    """

    def __init__(self, sandbox: Sandbox | None) -> None:
        plugins = registry()
        self._sandbox = sandbox
        self._names = plugins.names("reader", usable=True)
        self._foreign = {
            name
            for name in self._names
            if sandbox is not None and not plugins.find("reader", name).origin.built_in
        }
        self._known: dict[tuple[str, Path], bool | Fault] = {}

    def of(self, path: Path) -> tuple[str, Fault | None]:
        """The first reader by name that takes ``path``; or none, and how others failed at it."""
        faults = []
        for name in self._names:
            answer = self._accepts(name, path)
            if answer is True:
                return name, None
            if answer:
                faults.append(answer)
        return "", (faults[0][0], "; ".join(cause for _, cause in faults)) if faults else None

    def expect(self, paths: Sequence[Path]) -> None:
        """Ask the sandbox about many paths at once, of which `of` is going to be asked one by one."""
        self._known.clear()
        for reader in self._foreign:
            for start in range(0, len(paths), _TOGETHER):
                some = paths[start : start + _TOGETHER]
                try:
                    answers = self._ask(reader, some)
                except SandboxDeath:  # one of them did it; each is asked about alone when its turn comes
                    continue
                self._known |= {(reader, path): answer for path, answer in zip(some, answers, strict=True)}

    def members(self, reader: str, path: Path) -> list[str]:
        """As `members`; a death of the sandbox is a PluginError as well."""
        if reader not in self._foreign:
            return members(reader, path)
        assert self._sandbox is not None
        try:
            found: list[str] = self._sandbox.ask_twice("members", reader=reader, path=_hex(path))
        except SandboxDeath as death:
            raise PluginError(f"{_title(reader)}: {death.cause}", code=death.code) from death
        return found

    def _accepts(self, reader: str, path: Path) -> bool | Fault:
        if reader not in self._foreign:
            return accepts(reader, path)
        if (reader, path) in self._known:
            return self._known[reader, path]
        for _ in range(2):
            try:
                return self._ask(reader, [path])[0]
            except SandboxDeath as death:
                fault = death.code, f"{_title(reader)}: {death.cause}"
        return fault

    def _ask(self, reader: str, paths: Sequence[Path]) -> list[bool | Fault]:
        assert self._sandbox is not None
        answers = self._sandbox.ask("accepts", reader=reader, paths=[_hex(path) for path in paths])
        return [answer if isinstance(answer, bool) else (answer[0], answer[1]) for answer in answers]


def _hex(path: Path) -> str:
    return os.fsencode(path).hex()
