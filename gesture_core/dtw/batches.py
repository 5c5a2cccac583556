"""What every kernel shares: batches of one precision, dimensions in use, weights, padding.

Here wrong input is refused, before any kernel sees it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from gesture_core.dtw.bands import check_feasible
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError, InputError
from gesture_core.types import SignalBatch, Signals

__all__ = ["FAR", "UNREACHED", "lane_cost", "used_dimensions", "warping_dtype", "weighted"]

Series = Sequence[Signals | np.ndarray]

FAR = {np.dtype(np.float32): 1e15, np.dtype(np.float64): 1e120}
"""The value of padded frames: matching one with a real frame costs more than any path of those."""
UNREACHED = {np.dtype(np.float32): 1e32, np.dtype(np.float64): 1e250}
"""The value of cells that no path reaches: above any cost, finite so that soft minima stay numbers."""

_LARGEST = {np.dtype(np.float32): 1e9, np.dtype(np.float64): 1e100}
_SMALLEST = {np.dtype(np.float32): 1e-15, np.dtype(np.float64): 1e-150}
"""Where nothing reaches this, squares of differences leave the dtype's range."""


def make_batches(queries: Series, examples: Series, spec: DtwSpec) -> tuple[SignalBatch, SignalBatch]:
    """Checked batches of one dtype; see `common_dtype` and `check_batches` for what is refused."""
    dtype, bare = common_dtype(queries, examples)
    query_batch = SignalBatch.of(queries, dtype, name="query")
    example_batch = SignalBatch.of(examples, dtype, name="example")
    check_batches(query_batch, example_batch, spec, bare=bare)
    return query_batch, example_batch


def common_dtype(queries: Series, examples: Series) -> tuple[type[np.floating], bool]:
    """float32 where every series is (Signals are), else float64; and whether there is any bare array."""
    dtype: type[np.floating] = np.float32
    bare = False
    for name, several in (("queries", queries), ("examples", examples)):
        refuse_one(several, name)
        for item in several:
            if not isinstance(item, Signals):
                bare = True
                if getattr(item, "dtype", None) != np.float32:
                    dtype = np.float64
    return dtype, bare


def refuse_one(series: Series, name: str = "series") -> None:
    """An InputError where one series stands in the place of a sequence of them."""
    one = series.values if isinstance(series, Signals) else series
    several = isinstance(one, np.ndarray) and (one.ndim > 2 or one.dtype == object)
    if not several and hasattr(one, "__array__") and len(np.shape(one)) < 3:  # of any library
        raise InputError(
            f"{name} are one array of shape {tuple(np.shape(one))}, expected a sequence of series",
            remedy="warping_distance(a, b) for one pair, [a], [b] for lists of one series, "
            "list(array) where each row is a series",
            code="E_DIMENSIONS",
        )
    if isinstance(one, str | bytes) or not isinstance(one, Iterable):
        cause = f"{name} are a {type(one).__name__}, expected a sequence of series"
        raise InputError(cause, remedy="lists of (T,) or (T, D) arrays", code="E_DTYPE")


def check_batches(queries: SignalBatch, examples: SignalBatch, spec: DtwSpec, *, bare: bool) -> None:
    """Refuse batches between which ``spec`` defines no distances, or none that the dtype holds.

    Signals are in body lengths: with ``bare`` false, values so small that squares vanish are what
    rounding left of a part that keeps still, and no wrong unit.

    Raises
    ------
    InputError
        For widths that differ, for values too large or too small for the dtype, and where the band leaves a
        pair without a path; it names the pair.
    ConfigError
        Where ``spec`` weighs another number of dimensions.
    """
    width, other = queries.values.shape[2], examples.values.shape[2]
    if width != other:
        raise InputError(f"queries have {width} dimensions, examples {other}", code="E_DIMENSIONS")
    check_weights(spec, width)
    dtype, greatest = queries.values.dtype, 0.0
    for name, batch in (("query", queries), ("example", examples)):
        largest = np.abs(weighted(batch.values, spec)).max(axis=(1, 2))
        greatest = max(greatest, float(largest.max()))
        if greatest > _LARGEST[dtype]:
            raise InputError(
                f"{name} {int(largest.argmax())} reaches {largest.max():.3g}, "
                f"beyond what {dtype} costs can hold",
                remedy="float64 series, or a smaller unit",
                code="E_MAGNITUDE",
            )
    if bare and lane_cost(spec) != "absolute" and 0 < greatest < _SMALLEST[dtype]:
        raise InputError(
            f"no series reaches more than {greatest:.3g}, below what squared {dtype} costs can hold",
            remedy="float64 series, or a larger unit",
            code="E_MAGNITUDE",
        )
    check_feasible(queries.lengths, examples.lengths, spec)


def check_weights(spec: DtwSpec, width: int) -> None:
    """A ConfigError where ``spec`` weighs another number of dimensions than ``width``."""
    if spec.weights is not None and len(spec.weights) != width:
        raise ConfigError(
            f"{len(spec.weights)} weights for series of {width} dimensions",
            remedy=f"dtw.weights with {width} numbers, or none",
            code="E_OPTION",
        )


def subset(batch: SignalBatch, index: np.ndarray) -> SignalBatch:
    """The chosen series of ``batch``, in that order."""
    lengths = batch.lengths[index]
    values = batch.values[index, : int(lengths.max())]
    return SignalBatch(values, lengths, batch.masks[index], batch.present[index])


def used_dimensions(
    queries: SignalBatch, examples: SignalBatch, query_index: np.ndarray, example_index: np.ndarray
) -> np.ndarray:
    """(K, D) bool: the dimensions that each of K pairs is compared on."""
    salient = queries.masks[query_index] | examples.masks[example_index]
    used: np.ndarray = salient & queries.present[query_index] & examples.present[example_index]
    return used


def warping_dtype(dtype: np.dtype, spec: DtwSpec) -> np.dtype:
    """In which precision distances of a batch are accumulated: soft ones and their gradients in float64.

    A soft distance is a sum of costs less ``gamma`` times the logarithm of a number of paths. Both
    grow with the length and may cancel: the condition number, their sum over the distance,
    has no bound, and float32 loses what cancels. Gradients weigh paths by differences of such
    sums, divided by ``gamma``.
    """
    return np.dtype(np.float64) if spec.gamma is not None else dtype


def weighted(values: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """``values`` (..., D) scaled so that an unweighted cost of them is the weighted cost of the originals."""
    if spec.weights is None:
        return values
    factors = np.array(spec.weights)
    if lane_cost(spec) != "absolute":
        factors = np.sqrt(factors)
    scaled: np.ndarray = values * factors.astype(values.dtype)
    return scaled


def lane_cost(spec: DtwSpec) -> str:
    """The cost over the dimensions of one warping; over a single dimension Euclidean is absolute."""
    return "absolute" if spec.mode == "independent" and spec.cost == "euclidean" else spec.cost
