"""How this plugin's functions are compiled, and the sizes that they are written for."""

from __future__ import annotations

import logging
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import config, event

LANES = 32
"""Warpings that advance together: two AVX-512 or four AVX2 registers of float32."""
ROWS = 4
"""Rows of the table that one pass over the columns computes; the passes are written out."""


_SOURCES = zlib.crc32(b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py"))))
"""A checksum of the plugin's code."""

_numba: Any = config
"""Its settings, which its package declares while it is imported."""


def compiled(function: Callable[..., None], **more: Any) -> Callable[..., None]:
    """Compile ``function`` to run without the interpreter's lock, and keep the machine code on disk.

    It is kept beside the package or, where that is read-only, in ``GESTURE_CACHE``, otherwise in the
    user's cache folder (``NUMBA_CACHE_DIR`` overrides all), under a name with the checksum of the
    plugin's code: Numba itself notices changes in the function's own file alone. Where no folder can
    be written, each process compiles for itself. No fast-math unless ``more`` asks for it: a value
    has the same bits on every path.
    """
    function.__qualname__ = f"{function.__qualname__}_{_SOURCES:08x}"
    options = {"nogil": True, "error_model": "numpy", **more}
    own, before = os.environ.get("GESTURE_CACHE"), _numba.CACHE_DIR
    if own and not before and not os.access(Path(__file__).parent, os.W_OK):
        _numba.CACHE_DIR = str(Path(own) / "numba")
    try:
        dispatcher = njit(function, cache=True, **options)
        _forgive(dispatcher._cache)
    except RuntimeError:  # no cache folder can be written
        dispatcher = njit(function, **options)
    finally:
        _numba.CACHE_DIR = before
    result: Callable[..., None] = dispatcher
    return result


def _forgive(kept: Any) -> None:
    """Compile again where what is kept cannot be read, such as that of a class which has another name now."""
    load = kept.load_overload

    def load_or_forget(signature: Any, target: Any) -> Any:
        try:
            return load(signature, target)
        except Exception:  # noqa: BLE001 - what a damaged pickle raises has no end
            kept.flush()
            return None

    kept.load_overload = load_or_forget


class _Said(event.Listener):
    """Says, once in a process, what a user waits for."""

    said = False

    def on_start(self, started: event.Event) -> None:
        mine = started.data["dispatcher"].py_func.__module__.startswith(__package__ or "")
        if mine and not self.said:
            self.said = True
            logging.getLogger("gesture_core").warning(
                "compiling the distance kernel for these settings, once on this machine: about ten seconds"
            )

    def on_end(self, ended: event.Event) -> None:
        """Nothing to say."""


event.register("numba:compile", _Said())  # type: ignore[no-untyped-call]
