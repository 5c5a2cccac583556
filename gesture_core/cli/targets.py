"""Where a command is to write, looked at before the work begins instead of after hours of it."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from gesture_core.errors import ConfigError, InputError


def check_file(
    path: Path, suffixes: Sequence[str] = (), *, flag: str = "--out", replace: bool = True
) -> None:
    """Raise where no file can be written at ``path``.

    Parameters
    ----------
    path : path
    suffixes : sequence of str
        What its name may end in; anything by default.
    flag : str
        The flag that named it.
    replace : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    InputError
        ``E_OPTION`` for another suffix, ``E_EXISTS`` for a file that is to stay.
    ConfigError
        ``E_OUT`` for a folder, or a place that cannot be written to.
    """
    if suffixes and path.suffix.lower() not in suffixes:
        remedy = f"a name that ends in {' or '.join(suffixes)}"
        raise InputError(f"{flag} {path}", remedy=remedy, code="E_OPTION")
    if path.is_dir():
        raise ConfigError(f"{flag} {path} is a folder", remedy="a file", code="E_OUT")
    if path.exists() and not replace:
        raise InputError(
            "there is a file of this name",
            subject=str(path),
            kept="that one",
            remedy=f"--overwrite, or another {flag}",
            code="E_EXISTS",
        )
    _check_writable(path.parent, f"{flag} {path}")


def check_folder(path: Path, *, flag: str = "--out") -> None:
    """Raise ``E_OUT`` where ``path`` is a file, or no folder that can be written to."""
    if path.exists() and not path.is_dir():
        raise ConfigError(f"{flag} {path} is a file", remedy="a folder", code="E_OUT")
    _check_writable(path, f"{flag} {path}")


def _check_writable(folder: Path, what: str) -> None:
    """Try it, in the nearest folder that is there: no permission bit knows as much."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        cause = f"{what} cannot be written ({there}: {error.strerror or error})"
        raise ConfigError(cause, remedy="another place, or its permissions", code="E_OUT") from None
