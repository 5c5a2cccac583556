"""Conformance suites: what a plugin of each kind must do, as checks for its author's own tests.

>>> import pytest
>>> from gesture_core.testing import KERNEL_CHECKS
>>> @pytest.mark.parametrize("check", KERNEL_CHECKS)
... def test_my_kernel(check):
...     check(MyKernel())

A check takes a plugin and raises `AssertionError`, whose message says which line of the contract is
broken. The package's own tests run the suites over every registered plugin.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gesture_core.testing.kernels import KERNEL_CHECKS, Case, compare, draw_batch, reference_table

_SUITES = {"kernel": "KERNEL_CHECKS"}
_MODULES = {
    "Case": "kernels",
    "KERNEL_CHECKS": "kernels",
    "compare": "kernels",
    "draw_batch": "kernels",
    "reference_table": "kernels",
}

__all__ = ["Case", "KERNEL_CHECKS", "checks_for", "compare", "draw_batch", "reference_table"]


def checks_for(kind: str) -> tuple[Callable[..., None], ...]:
    """The suite of a kind of plugin, by its name in `gesture_core.plugin.interfaces.KINDS`."""
    suite: tuple[Callable[..., None], ...] = __getattr__(_SUITES[kind])
    return suite


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'gesture_core.testing' has no attribute {name!r}")
    return getattr(import_module(f"gesture_core.testing.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
