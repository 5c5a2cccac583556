"""The inputs of a run, found again where it left them, each by itself: what is gone costs itself only."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from gesture_core.errors import GestureError, InputError
from gesture_core.files import printable
from gesture_core.records import Job
from gesture_core.run.inputs import Input, discover
from gesture_core.run.workers.engines import Assistant
from gesture_core.settings import Settings


def find_inputs(
    places: Mapping[str, str | os.PathLike[str] | None], settings: Settings
) -> dict[str, Input | GestureError]:
    """The input of each name, or why there is none.

    Parameters
    ----------
    places : mapping
        Absolute paths by the names of inputs, as the run knows them; None where it does not.
    settings : Settings
        Of the run.
    """
    found: dict[str, Input | GestureError] = {}
    looked: dict[Path, dict[str, Input]] = {}
    with Assistant(Job(settings.as_dict(), ""), settings.limits) as assistant, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for name, place in places.items():
            path, member = _path(name, os.fspath(place or "")), name.partition("::")[2]
            try:
                if path not in looked:
                    every = discover([path], assistant=assistant)
                    looked[path] = {_spelled(item.path, printable(item.member)): item for item in every}
                item = looked[path].get(_spelled(path, member)) or looked[path][_spelled(path, "")]
                readable = item.kind in ("video", "keypoints") and printable(item.member) == member
                fault, code = item.fault or "is not what the run found there", item.code or "E_CHANGED"
                found[name] = item if readable else replace(item, name=name, fault=fault, code=code).error()
            except (GestureError, KeyError):
                found[name] = InputError(
                    "is not where the run found it",
                    subject=name,
                    remedy="to put it back",
                    code="E_NOT_FOUND",
                )
    return found


def input_called(known: Iterable[str], name: str) -> str:
    """The input called ``name`` among those of a run, or the only one whose name ends so, or holds it.

    Raises
    ------
    InputError
        ``E_NOT_FOUND`` where there is none, or several.
    """
    names = dict.fromkeys(known)
    found = (
        [one for one in names if one == name]
        or [one for one in names if one.endswith(name)]
        or [one for one in names if name in one]
    )
    if len(found) != 1:
        some = ", ".join((found or list(names))[:5])
        raise InputError(
            f"{name!r} could be any of {len(found)} inputs" if found else f"no input of the run is {name!r}",
            remedy=f"one of {some}{' …' if len(found or names) > 5 else ''}",
            code="E_NOT_FOUND",
        )
    return found[0]


def _path(name: str, place: str) -> Path:
    """Where an input is: at its place, or, after a move, where its name leads from here."""
    typed = Path(name.partition("::")[0])
    return typed if not place or (typed.exists() and not Path(place).exists()) else Path(place)


def _spelled(path: Path, member: str) -> str:
    """The same for all spellings of an input."""
    return f"{path.resolve()}::{member}"
