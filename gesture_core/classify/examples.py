"""The example library: signals, labels and names of the examples that queries are compared with."""

from __future__ import annotations

import hashlib
import re
import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from gesture_core.errors import InputError
from gesture_core.types import Signals

_MISSING = ("NAType", "NaTType")
"""Types of what pandas puts in the place of no value."""


@dataclass(frozen=True, eq=False)
class ExampleLibrary:
    """Examples in the order in which they were given; that order decides ties.

    Attributes
    ----------
    series : tuple of Signals or (T, D) arrays
    labels : tuple
        One for each example: strings, or whatever else can be sorted.
    names : tuple of str
        What to call each example in a result.
    classes : (C,) array
        The labels, each once, sorted.
    codes : (N,) int64
        Index of each example's label in `classes`.

    Raises
    ------
    InputError
        Where there is no example, and for labels that are missing, of several kinds, or cannot be sorted.
    """

    series: tuple[Signals | np.ndarray, ...]
    labels: tuple[object, ...]
    names: tuple[str, ...]
    classes: np.ndarray = field(init=False)
    codes: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        if not len(self.series) == len(self.labels) == len(self.names):
            raise InputError(
                f"{len(self.series)} examples, {len(self.labels)} labels and {len(self.names)} names",
                code="E_EXAMPLES",
            )
        if not self.series:
            raise InputError(
                "no example can be used",
                remedy="examples/<label>/<clip> with one clip at least",
                code="E_EXAMPLES",
            )
        classes, codes = _encoded(self.labels)
        object.__setattr__(self, "classes", classes)
        object.__setattr__(self, "codes", codes)

    @classmethod
    def of(
        cls,
        series: Sequence[Signals | np.ndarray],
        labels: Sequence[object],
        names: Sequence[str] | None = None,
    ) -> ExampleLibrary:
        """A library with names taken from the sources of the signals where none are given."""
        if names is None:
            names = [
                (item.source if isinstance(item, Signals) else "") or str(index)
                for index, item in enumerate(series)
            ]
        return cls(tuple(series), tuple(labels), tuple(names))

    def __len__(self) -> int:
        return len(self.series)

    def take(self, indices: Sequence[int] | np.ndarray) -> ExampleLibrary:
        """The examples at ``indices``, in that order."""
        return ExampleLibrary(
            tuple(self.series[i] for i in indices),
            tuple(self.labels[i] for i in indices),
            tuple(self.names[i] for i in indices),
        )


def _encoded(labels: tuple[object, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The classes and each label's index in them; labels that NumPy would turn into others are refused.

    Raises
    ------
    InputError
        E_LABELS; it names the first label that is missing or of another kind than the others.
    """
    alike = "labels of one kind, such as all strings"
    for index, label in enumerate(labels):
        if label is None or type(label).__name__ in _MISSING or (isinstance(label, float) and label != label):
            raise InputError(f"label {index} is missing: {label!r}", code="E_LABELS")
    try:
        array = np.asarray(labels)
        classes, codes = np.unique(array, return_inverse=True)
    except (TypeError, ValueError):
        raise InputError("labels cannot be sorted", remedy=alike, code="E_LABELS") from None
    if array.ndim != 1:
        raise InputError(
            f"labels have shape {array.shape}, expected ({len(labels)},)",
            remedy="y.ravel()" if array.size == len(labels) else "one label for each example",
            code="E_LABELS",
        )
    for index, label in enumerate(labels):
        kinds = {array.dtype.kind, np.asarray(label).dtype.kind}
        if len(kinds) > 1 and kinds & {"U", "S"}:
            raise InputError(
                f"label {index} is {label!r}, and others are of another kind", remedy=alike, code="E_LABELS"
            )
    return classes, codes.astype(np.int64)


def sided_labels(labels: Collection[str]) -> list[str]:
    """The labels on the left that have their like on the right: ``left`` of left, right and wave.

    Where an example also stands for the movement of the other hand (`classify.mirror`), such a pair may be
    two names of one gesture.
    """
    every, sided = set(map(str.casefold, labels)), []
    for label in sorted(labels):
        other = re.sub("left", "right", label.casefold())
        if other != label.casefold() and other in every:
            sided.append(label)
    return sided


def warn_of_contradictions(library: ExampleLibrary, stacklevel: int) -> None:
    """A UserWarning where equal examples have different labels: their order alone would decide."""
    firsts: dict[bytes, int] = {}
    pairs = []
    for index, item in enumerate(library.series):
        content = [item.values, item.mask, item.present] if isinstance(item, Signals) else [item]
        digest = hashlib.sha256(str(len(item)).encode())
        for part in content:
            # Adding zero takes the sign from every zero; one column is the same as none.
            digest.update((np.asarray(part, np.float64) + 0.0).tobytes())
        first = firsts.setdefault(digest.digest(), index)
        if library.labels[first] != library.labels[index]:
            pairs.append((first, index))
    if not pairs:
        return
    both = " and ".join(f"{library.names[i]!r} ({library.labels[i]!r})" for i in pairs[0])
    more = f" (and {len(pairs) - 1} more)" if len(pairs) > 1 else ""
    warnings.warn(
        f"examples {both} are equal and have different labels{more}: one of the labels must be wrong, "
        "and which one answers is left to their order",
        UserWarning,
        stacklevel=stacklevel + 1,
    )
