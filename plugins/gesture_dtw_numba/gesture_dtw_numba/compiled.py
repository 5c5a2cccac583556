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
    """A checksum of the plugin's code."""
    checksum = 0
    for file in sorted(Path(__file__).parent.glob("*.py")):
        checksum = zlib.crc32(file.read_bytes(), checksum)
    return checksum


def compiled(function: Callable[..., None], **more: Any) -> Callable[..., None]:
    """Compile ``function`` to run without the interpreter's lock, and keep the machine code on disk.

    It is kept beside the package or, where that is read-only, in the user's cache folder
    (``NUMBA_CACHE_DIR`` overrides both), under a name with the checksum of the plugin's code: Numba
    itself notices changes in the function's own file alone. Where no folder can be written, each
    process compiles for itself. No fast-math unless ``more`` asks for it: a value has the same bits
    on every path.
    """
    function.__qualname__ = f"{function.__qualname__}_{sources():08x}"
    options = {"nogil": True, "error_model": "numpy", **more}
    try:
        result: Callable[..., None] = njit(function, cache=True, **options)
    except RuntimeError:  # no cache folder can be written
        result = njit(function, **options)
    return result
