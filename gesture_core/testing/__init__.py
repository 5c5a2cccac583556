"""Conformance suites: what a plugin of each kind must do, as checks for its author's own tests.

>>> import pytest
>>> from gesture_core.testing import FILTER_CHECKS
>>> @pytest.mark.parametrize("check", FILTER_CHECKS)
... def test_my_filter(check):
...     check(MyFilter())

A check takes a plugin, of keypoint readers a sample file as well, and raises `AssertionError`, whose
message says which line of the contract is broken. The package's own tests run the suites over every
registered plugin.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gesture_core.testing.classifiers import CLASSIFIER_CHECKS
    from gesture_core.testing.engines import ENGINE_CHECKS
    from gesture_core.testing.kernels import KERNEL_CHECKS, Case, compare, draw_batch, reference_table
    from gesture_core.testing.poses import POSE_CHECKS, draw_frames
    from gesture_core.testing.readers import READER_CHECKS
    from gesture_core.testing.signals import (
        FILTER_CHECKS,
        NORMALIZER_CHECKS,
        SELECTOR_CHECKS,
        draw_pose,
        draw_signals,
    )
    from gesture_core.testing.videos import VIDEO_CHECKS, draw_video
    from gesture_core.testing.writers import WRITER_CHECKS, draw_rows

_MODULES = {
    "CLASSIFIER_CHECKS": "classifiers",
    "Case": "kernels",
    "ENGINE_CHECKS": "engines",
    "FILTER_CHECKS": "signals",
    "KERNEL_CHECKS": "kernels",
    "NORMALIZER_CHECKS": "signals",
    "POSE_CHECKS": "poses",
    "READER_CHECKS": "readers",
    "SELECTOR_CHECKS": "signals",
    "VIDEO_CHECKS": "videos",
    "WRITER_CHECKS": "writers",
    "compare": "kernels",
    "draw_batch": "kernels",
    "draw_frames": "poses",
    "draw_pose": "signals",
    "draw_rows": "writers",
    "draw_signals": "signals",
    "draw_video": "videos",
    "reference_table": "kernels",
}

__all__ = [
    "CLASSIFIER_CHECKS",
    "ENGINE_CHECKS",
    "FILTER_CHECKS",
    "KERNEL_CHECKS",
    "NORMALIZER_CHECKS",
    "POSE_CHECKS",
    "READER_CHECKS",
    "SELECTOR_CHECKS",
    "VIDEO_CHECKS",
    "WRITER_CHECKS",
    "Case",
    "checks_for",
    "compare",
    "draw_batch",
    "draw_frames",
    "draw_pose",
    "draw_rows",
    "draw_signals",
    "draw_video",
    "reference_table",
]


def checks_for(kind: str) -> tuple[Callable[..., None], ...]:
    """The suite of a kind of plugin.

    Parameters
    ----------
    kind : str
        Its name in `gesture_core.plugin.hooks.KINDS`, such as ``"filter"``.

    Raises
    ------
    ValueError
        Where there is no such kind.
    """
    name = f"{kind.upper()}_CHECKS"
    if name not in _MODULES:
        kinds = sorted(name.removesuffix("_CHECKS").lower() for name in _MODULES if name.isupper())
        raise ValueError(f"no kind of plugin {kind!r}; one of {', '.join(kinds)}")
    checks: tuple[Callable[..., None], ...] = __getattr__(name)
    return checks


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'gesture_core.testing' has no attribute {name!r}")
    return getattr(import_module(f"gesture_core.testing.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
