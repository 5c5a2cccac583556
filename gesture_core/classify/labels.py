"""What labels must be: there, of one kind, and one for each content."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence

import numpy as np

from gesture_core.errors import InputError
from gesture_core.types import Signals


def check_labels(labels: Sequence[object]) -> None:
    """Refuse labels that NumPy would turn into others, or that cannot be sorted.

    Raises
    ------
    InputError
        E_LABELS; it names the first one that is missing or of another kind than the others.
    """
    alike = "labels of one kind, such as all strings"
    for index, label in enumerate(labels):
        if label is None or (isinstance(label, float) and label != label):
            raise InputError(f"label {index} is missing: {label!r}", code="E_LABELS")
    try:
        array = np.asarray(labels)
        np.unique(array)
    except (TypeError, ValueError):
        raise InputError("labels cannot be sorted", remedy=alike, code="E_LABELS") from None
    if array.ndim != 1:
        raise InputError(
            f"labels have shape {array.shape}, expected ({len(labels)},)", remedy="y.ravel()", code="E_LABELS"
        )
    text = array.dtype.kind if array.dtype.kind in "US" else ""
    for index, label in enumerate(labels):
        kind = np.asarray(label).dtype.kind
        if (kind if kind in "US" else "") != text:
            raise InputError(
                f"label {index} is {label!r}, and others are of another kind", remedy=alike, code="E_LABELS"
            )


def warn_of_contradictions(
    series: Sequence[Signals | np.ndarray], labels: Sequence[object], names: Sequence[str], stacklevel: int
) -> None:
    """A UserWarning where equal examples have different labels: their order alone would decide."""
    known: dict[bytes, int] = {}
    firsts = [known.setdefault(_content(item), index) for index, item in enumerate(series)]
    pairs = [(first, index) for index, first in enumerate(firsts) if labels[first] != labels[index]]
    if not pairs:
        return
    said = " and ".join(f"{names[i]!r} ({labels[i]!r})" for i in pairs[0])
    more = f" (and {len(pairs) - 1} more)" if len(pairs) > 1 else ""
    warnings.warn(
        f"examples {said} are equal and have different labels{more}: one of the labels must be wrong, "
        "and which one answers is left to their order",
        UserWarning,
        stacklevel=stacklevel + 1,
    )


def _content(item: Signals | np.ndarray) -> bytes:
    """A hash of all that a distance depends on."""
    if isinstance(item, Signals):
        parts = [item.values, item.mask, item.present]
    else:
        parts = [np.asarray(item, np.float64).reshape(len(item), -1)]
    digest = hashlib.sha256(str(len(item)).encode())
    for part in parts:
        digest.update((np.asarray(part) + 0.0).tobytes())  # no zero has a sign
    return digest.digest()
