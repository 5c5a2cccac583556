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
    files = sorted(Path(__file__).parent.glob("*.py"))
    return zlib.crc32(b"".join(file.read_bytes() for file in files))


def compiled(function: Callable[..., Any], **more: Any) -> Callable[..., Any]:
    """Compile ``function`` to run without the interpreter's lock, and keep the machine code on disk.

    It is kept beside the package or, where that is read-only, in the user's cache folder
    (``NUMBA_CACHE_DIR`` overrides both). Where neither can be written, each process compiles for
    itself. No fast-math unless ``more`` asks for it: a value has the same bits on every path.
    """
    options = {"nogil": True, "error_model": "numpy", **more}
    try:
        return njit(function, cache=True, **options)
    except RuntimeError:  # numba's way of saying that no cache folder can be written
        return njit(function, **options)
