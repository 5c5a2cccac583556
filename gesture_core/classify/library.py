"""The example library: signals, labels and names of the examples that queries are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gesture_core.classify.labels import check_labels
from gesture_core.errors import InputError
from gesture_core.types import Signals


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

    Raises
    ------
    InputError
        Where there is no example, and for labels that are missing, of several kinds, or cannot be sorted.
    """

    series: tuple[Signals | np.ndarray, ...]
    labels: tuple[object, ...]
    names: tuple[str, ...]

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
        check_labels(self.labels)

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

    @property
    def classes(self) -> np.ndarray:
        """(C,) the labels, each once, sorted."""
        return np.unique(np.asarray(self.labels))

    @property
    def codes(self) -> np.ndarray:
        """(N,) int64: index of each example's label in `classes`."""
        return np.unique(np.asarray(self.labels), return_inverse=True)[1].astype(np.int64).reshape(-1)

    def take(self, indices: Sequence[int] | np.ndarray) -> ExampleLibrary:
        """The examples at ``indices``, in that order."""
        chosen = [int(i) for i in indices]
        return ExampleLibrary(
            tuple(self.series[i] for i in chosen),
            tuple(self.labels[i] for i in chosen),
            tuple(self.names[i] for i in chosen),
        )


def medoids(distances: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """The representative example of each class.

    That is the example with the smallest total distance to the others of its class (Schneider
    et al. 2019, section III). Pairs without a common dimension (infinite distance) weigh more
    than any sum of finite ones; ties go to the lower index.

    Parameters
    ----------
    distances : (N, N) float array
        Among the examples, row example against column example.
    codes : (N,) int array
        Class of each example.

    Returns
    -------
    (C,) int64
        Index of one example for each class, in ascending order of index.
    """
    chosen = []
    for code in np.unique(codes):
        members = np.flatnonzero(codes == code)
        block = np.asarray(distances, np.float64)[np.ix_(members, members)]
        finite = np.isfinite(block)
        total = np.where(finite, block, 0).sum(axis=1)
        order = np.lexsort((members, total, (~finite).sum(axis=1)))
        chosen.append(members[order[0]])
    return np.sort(np.array(chosen, np.int64))
