"""What the suites share: asking a plugin, and comparing what it was given before and after."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

from gesture_core.errors import GestureError
from gesture_core.types import PoseSequence, Signals

Given = ParamSpec("Given")
Answer = TypeVar("Answer")
Question = TypeVar("Question", PoseSequence, Signals)


def ask(method: Callable[Given, Answer], *args: Given.args, **kwargs: Given.kwargs) -> Answer:
    """What ``method`` of a plugin answers; an `AssertionError` that names it where it raises."""
    try:
        return method(*args, **kwargs)
    except Exception as error:
        raise AssertionError(f"{title(method)} raises {type(error).__name__}: {error}") from error


def ask_or_refuse(
    what: str, method: Callable[Given, Answer], *args: Given.args, **kwargs: Given.kwargs
) -> Answer | None:
    """What ``method`` answers, or None for a `GestureError`, which it may raise where it cannot answer.

    ``what`` is said of the arguments: "one frame", "a folder".
    """
    try:
        return method(*args, **kwargs)
    except GestureError:
        return None
    except Exception as error:
        raise AssertionError(
            f"{title(method)} of {what} raises {type(error).__name__}: {error}; for what it cannot use it "
            "raises a GestureError that says why"
        ) from error


def title(method: Callable[..., object]) -> str:
    """The method with its class: ``SpeedFilter.apply``."""
    return str(getattr(method, "__qualname__", method))


def check_memory(
    method: Callable[[Question], np.ndarray | Signals], given: Question, other: Question
) -> None:
    """``method`` answers ``given`` with the same bits whatever came in between, and leaves it as it is."""
    before = _contents(given)
    first, _, again = (_contents(ask(method, each)) for each in (given, other, given))
    assert _contents(given) == before, f"{title(method)} changes what it was given"
    assert first == again, (
        f"{title(method)} answers the same question differently the second time; it must not remember others"
    )


def _contents(item: PoseSequence | Signals | np.ndarray) -> tuple[object, ...]:
    """What to compare of an item: its names and the bytes of its arrays."""
    if isinstance(item, PoseSequence):
        arrays: tuple[object, ...] = (item.keypoints, item.scores, item.times)
        return tuple(np.asarray(array).tobytes() for array in arrays)
    if isinstance(item, Signals):
        arrays = (item.values, item.times, item.mask, item.present)
        return (item.channels, *(np.asarray(array).tobytes() for array in arrays))
    return np.shape(item), np.asarray(item).tobytes()
