"""Warping distances of all queries to all examples, by whichever kernel is fastest here."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gesture_core.dtw.bands import check_feasible
from gesture_core.dtw.lanes import lane_cost, used_dimensions, weighted
from gesture_core.dtw.spec import DtwSpec, as_spec
from gesture_core.errors import ConfigError, InputError, PluginError
from gesture_core.plugin import registry
from gesture_core.types import SignalBatch, Signals

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import DistanceKernel

CPU_ORDER = ("numba", "jax", "torch", "numpy")
"""Fastest first, as ``benchmarks/kernels.py`` measures them."""
GPU_ORDER = ("torch", "jax")

_LARGEST = {np.dtype(np.float32): 1e9, np.dtype(np.float64): 1e100}
_SMALLEST = {np.dtype(np.float32): 1e-15, np.dtype(np.float64): 1e-150}
"""Where nothing reaches this, squares of differences leave the dtype's range."""

Options = Mapping[str, Mapping[str, Any]]
Series = Sequence[Signals | np.ndarray]


def warping_distances(
    queries: Series,
    examples: Series,
    spec: DtwSpec | None = None,
    kernel: str = "auto",
    options: Options | None = None,
) -> np.ndarray:
    """Warping distances between every query and every example.

    Parameters
    ----------
    queries, examples : sequences of Signals or (T,) or (T, D) arrays
        Lengths may differ, D may not. Computed in float32 where every series is float32 (as
        `Signals` are), else in float64.
    spec : DtwSpec, optional
    kernel : str
        A registered distance kernel, or ``"auto"`` for the fastest installed one.
    options : mapping, optional
        Keyword arguments of kernels by their names; those of other plugins are left alone.

    Returns
    -------
    (Q, N) float array
        Infinity where a pair has no dimension in common; never NaN.

    Raises
    ------
    InputError
        For an empty, ragged-width, NaN or infinite series; it names the index.
    WarpingError
        Where the band leaves a pair without a path; it names the pair.
    """
    spec = as_spec(spec)
    _check_options(options or {})
    query_batch, example_batch = make_batches(queries, examples, spec)
    name, chosen = choose_kernel(kernel, spec, options)
    values = np.asarray(chosen.distances(chosen.prepare(example_batch, spec), query_batch))
    return check_distances(values, query_batch, example_batch, name)


def _check_options(options: Options) -> None:
    """Refuse options of what is no plugin: a kernel's name that is misspelt."""
    known = {name for _, name in registry().entries}
    for name in options:
        if name.partition(":")[0] not in known:
            near = difflib.get_close_matches(name, registry().names("kernel"), 1)
            raise ConfigError(
                f"options of {name!r}, which is no plugin",
                remedy=f"did you mean {near[0]!r}?" if near else "the name of a distance kernel",
                code="E_OPTION",
            )


def make_batches(queries: Series, examples: Series, spec: DtwSpec) -> tuple[SignalBatch, SignalBatch]:
    """Validated batches of one dtype; the boundary at which wrong input is refused."""
    dtype = np.float32 if _all_float32(queries) and _all_float32(examples) else np.float64
    query_batch = SignalBatch.of(queries, dtype, name="query")
    example_batch = SignalBatch.of(examples, dtype, name="example")
    width, other = query_batch.values.shape[2], example_batch.values.shape[2]
    if width != other:
        raise InputError(f"queries have {width} dimensions, examples {other}", code="E_DIMENSIONS")
    check_weights(spec, width)
    # Signals are in body lengths: what is that small there is what rounding left of a part that keeps still.
    bare = not all(isinstance(item, Signals) for item in (*queries, *examples))
    _check_magnitudes(query_batch, example_batch, spec, smallest=bare)
    check_feasible(query_batch.lengths, example_batch.lengths, spec)
    return query_batch, example_batch


def check_weights(spec: DtwSpec, width: int) -> None:
    """A ConfigError where ``spec`` weighs another number of dimensions than ``width``."""
    if spec.weights is not None and len(spec.weights) != width:
        raise ConfigError(
            f"{len(spec.weights)} weights for series of {width} dimensions",
            remedy=f"dtw.weights with {width} numbers, or none",
            code="E_OPTION",
        )


def _check_magnitudes(queries: SignalBatch, examples: SignalBatch, spec: DtwSpec, *, smallest: bool) -> None:
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
    if smallest and lane_cost(spec) != "absolute" and 0 < greatest < _SMALLEST[dtype]:
        raise InputError(
            f"no series reaches more than {greatest:.3g}, below what squared {dtype} costs can hold",
            remedy="float64 series, or a larger unit",
            code="E_MAGNITUDE",
        )


def _all_float32(series: Series) -> bool:
    return all(isinstance(item, Signals) or getattr(item, "dtype", None) == np.float32 for item in series)


def choose_kernel(name: str, spec: DtwSpec, options: Options | None = None) -> tuple[str, DistanceKernel]:
    """The kernel called ``name``, or the fastest installed one that supports ``spec``.

    ``options`` holds the keyword arguments of kernels by their names.

    Returns
    -------
    (name, kernel)

    Raises
    ------
    PluginError
        Where the named kernel is unknown or does not support ``spec``.
    """
    if name != "auto":
        kernel = registry().make("kernel", name, (options or {}).get(name))
        if not kernel.supports(spec):
            raise PluginError(
                f"distance kernel {name!r} does not compute {spec}",
                remedy="--kernel auto",
                code="E_KERNEL_UNSUPPORTED",
            )
        return name, kernel
    usable = registry().names("kernel", usable=True)
    gpu = GPU_ORDER if Path("/dev/nvidiactl").exists() else ()
    for candidate in (*gpu, *CPU_ORDER):
        if candidate not in usable:
            continue
        kernel = registry().make("kernel", candidate, (options or {}).get(candidate))
        wanted = candidate not in gpu or getattr(kernel, "device", "cpu") != "cpu"
        if wanted and kernel.supports(spec):
            return candidate, kernel
    raise PluginError(f"no installed distance kernel computes {spec}", code="E_KERNEL_UNSUPPORTED")


def check_distances(values: np.ndarray, queries: SignalBatch, examples: SignalBatch, name: str) -> np.ndarray:
    """Hold a kernel to its contract: the shape, no NaN, infinity only without a common dimension."""
    if values.shape != (len(queries), len(examples)):
        raise PluginError(
            f"distance kernel {name!r} returned shape {values.shape} "
            f"for {len(queries)} queries and {len(examples)} examples",
            code="E_PLUGIN_CONTRACT",
        )
    qi, ei = np.nonzero(~np.isfinite(values))
    wrong = np.isnan(values[qi, ei]) | used_dimensions(queries, examples, qi, ei).any(axis=1)
    if wrong.any():
        first = int(wrong.argmax())
        raise PluginError(
            f"distance kernel {name!r} returned {values[qi[first], ei[first]]} "
            f"for query {qi[first]} and example {ei[first]}",
            remedy="another --kernel, and a report to its author",
            code="E_PLUGIN_CONTRACT",
        )
    return values
