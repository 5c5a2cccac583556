"""Reading the value of a setting from text, by the type that the setting has."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Sequence
from typing import Any, get_args, get_origin

from gesture_core.errors import ConfigError


def toml_value(value: Any) -> Any:
    """A string as the TOML value that it spells, or as itself."""
    if not isinstance(value, str):
        return value
    try:
        return tomllib.loads(f"v = {value}")["v"]
    except tomllib.TOMLDecodeError:
        return value


def read_value(key: str, value: Any, hint: Any, origin: str) -> Any:
    """``value`` as the type that ``hint`` names: a scalar, an optional, or a tuple of one scalar.

    Parameters
    ----------
    key : str
        The setting, for the error.
    value : object
        A string is read as the type of the setting (``none`` where it may be absent, a comma between
        the parts of a tuple); anything else must have it.
    hint : type
        From the section's annotations.
    origin : str
        Where the value was given, for the error.

    Raises
    ------
    ConfigError
        E_OPTION, with what would be right.
    """
    options = get_args(hint) if type(None) in get_args(hint) else (hint,)
    if isinstance(value, str) and value.lower() in ("none", "") and type(None) in options:
        return None
    plain = value if hint is str else toml_value(value)
    if value is None and type(None) in options:
        return None
    for option in (o for o in options if o is not type(None)):
        if get_origin(option) is tuple:
            items = plain
            if isinstance(plain, str):
                items = plain.split(",") if plain else ()
            if isinstance(items, list | tuple):
                scalar = get_args(option)[0]
                return tuple(
                    read_value(key, i.strip() if isinstance(i, str) else i, scalar, origin) for i in items
                )
        elif option is float and isinstance(plain, int | float) and not isinstance(plain, bool):
            if int not in options or isinstance(plain, float):
                return float(plain)
        elif option is str and isinstance(value, str):
            return value
        elif type(plain) is option or plain in get_args(option):
            return plain
    wanted = " or ".join(_wanted(option) for option in options if option is not type(None))
    raise ConfigError(f"{origin}: {key} = {value!r}", remedy=wanted, code="E_OPTION")


def _wanted(hint: Any) -> str:
    words = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}
    if hint in words:
        return words[hint]
    if get_origin(hint) is tuple:
        return "a list of names" if get_args(hint)[0] is str else "a list of numbers"
    choices = [choice for choice in get_args(hint) if isinstance(choice, str)]
    return " or ".join(choices) or f"a {hint.__name__}, from Python"


def near(word: str, known: Sequence[str]) -> str:
    """A remedy for ``word``: the known names that are spelled alike, or all of them."""
    alike = difflib.get_close_matches(word, known, 3)
    return f"did you mean {' or '.join(alike)}?" if alike else f"one of {', '.join(known)}"
