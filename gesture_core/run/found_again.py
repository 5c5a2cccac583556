"""The inputs of a run, found again where it left them, each by itself."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from gesture_core.errors import GestureError, InputError
from gesture_core.files import printable
from gesture_core.records import Job
from gesture_core.run.addresses import fetch, is_address, look
from gesture_core.run.inputs import Input, Walk, exists
from gesture_core.run.readers import Readers
from gesture_core.run.workers.engines import Assistant
from gesture_core.settings import Settings

GONE = "is not where the run found it"
Places = Mapping[str, str | os.PathLike[str] | None]
"""Absolute paths by the names of inputs, as a run knows them; None where it does not."""


def find_inputs(places: Places, settings: Settings) -> dict[str, Input | GestureError]:
    """The inputs of a run by their names, or why they cannot be read: what is gone costs itself only."""
    found: dict[str, Input | GestureError] = {}
    for name, item in look_again(places, settings).items():
        if item is None:
            remedy = "to put it back"
            found[name] = InputError(GONE, subject=name, remedy=remedy, code="E_NOT_FOUND")
        elif item.readable and (
            item.name == name if item.address else printable(item.member) == _parted(name, places[name])[1]
        ):
            found[name] = item
        else:
            fault, code = item.fault or "is not what the run found there", item.code or "E_CHANGED"
            found[name] = replace(item, name=name, fault=fault, code=code).error()
    return found


def look_again(places: Places, settings: Settings) -> dict[str, Input | None]:
    """What lies where a run found its inputs, by their names; None where there is nothing.

    After a move, an input is where its name leads from here.
    """
    found: dict[str, Input | None] = {}
    looked: dict[Path, dict[str, Input]] = {}
    with Assistant(Job(settings.as_dict(), ""), settings.limits) as assistant:
        readers = Readers(assistant)
        for name, place in places.items():
            if is_address(name):
                found[name] = _fetched_again(name, readers)
                continue
            shown, member = _parted(name, place)
            path = Path(place or shown)
            path = Path(shown) if not exists(path) and exists(Path(shown)) else path
            if path not in looked:
                every = Walk(None, readers).path(path) if exists(path) else ()
                looked[path] = {printable(item.member): item for item in every if item.path == path}
            found[name] = looked[path].get(member) or looked[path].get("")
    return found


def _parted(name: str, place: str | os.PathLike[str] | None) -> tuple[str, str]:
    """The path in the name of an input, and the sequence in that file: either may hold ``::`` itself."""
    parts = name.split("::")
    for n in range(len(parts), 0, -1):
        shown = "::".join(parts[:n])
        if Path(shown).name == printable(Path(place).name) if place else exists(Path(shown)):
            return shown, "::".join(parts[n:])
    return parts[0], "::".join(parts[1:])


def _fetched_again(name: str, readers: Readers) -> Input | None:
    """The input of an address, fetched; None where it is not there."""
    for whole in (name, name.rpartition("::")[0]):  # which may end in the name of a sequence in a file
        with suppress(GestureError):
            every = Walk(None, readers).address(whole) if whole else ()
            item = next((one for one in every if one.name == name), None)
            if item:
                fetch(look(item.address), item.path)
                return item
    return None
