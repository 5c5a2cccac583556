"""How this plugin's functions are compiled, and the sizes that they are written for."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit

LANES = 32
"""Warpings that advance together: two AVX-512 or four AVX2 registers of float32."""
ROWS = 4
"""Rows of the table that one pass over the columns computes; the passes are written out."""


@cache
def sources() -> int:
    """A checksum of the plugin's code: part of the key under which machine code is kept on disk."""
    checksum = 0
    for file in sorted(Path(__file__).parent.glob("*.py")):
        checksum = zlib.crc32(file.read_bytes(), checksum)
    return checksum


def compiled(function: Callable[..., Any], **more: Any) -> Callable[..., Any]:
    """Compile ``function`` to run without the interpreter's lock, and keep the machine code on disk.

    It is kept beside the package or, where that is read-only, in the user's cache folder
    (``NUMBA_CACHE_DIR`` overrides both). Where neither can be written, each process compiles for
    itself. No fast-math unless ``more`` asks for it: a value has the same bits on every path.
    """
    options = {"nogil": True, "error_model": "numpy", **more}
    try:
        result: Callable[..., Any] = njit(function, cache=True, **options)
    except RuntimeError:  # no cache folder can be written
        result = njit(function, **options)
    return result
