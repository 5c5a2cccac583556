"""Warping distances: tables of all queries and all examples, one pair, chosen pairs, and of slopes."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gesture_core.dtw.batches import Series, make_batches, refuse_one, subset, used_dimensions
from gesture_core.dtw.spec import DtwSpec, as_spec
from gesture_core.errors import ConfigError, InputError, PluginError, SignalError
from gesture_core.plugin import registry
from gesture_core.plugin.abilities import DeviceKernel, PairKernel
from gesture_core.types import SignalBatch, Signals

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import DistanceKernel

CPU_ORDER = ("numba", "jax", "torch", "numpy")
"""Fastest first, as ``benchmarks/kernels.py`` measures them."""
GPU_ORDER = ("torch", "jax")
SMALL = 1 << 16
"""Cells of all pairs times dimensions up to which ``auto`` is NumPy, which is done before others have loaded
or compiled anything. By the size alone: the same series have the same bits, whatever was compiled before."""

Options = Mapping[str, Mapping[str, Any]]


def warping_distances(
    queries: Series,
    examples: Series,
    spec: DtwSpec | None = None,
    kernel: str = "auto",
    options: Options | None = None,
) -> np.ndarray:
    """Warping distances between every query and every example (Sakoe and Chiba 1978).

    Parameters
    ----------
    queries, examples : sequences of Signals or (T,) or (T, D) arrays
        Lengths may differ, D may not. Computed in float32 where every series is float32 (as
        `Signals` are), else in float64.
    spec : DtwSpec, optional
        One warping for each dimension, absolute costs and their mean by default.
    kernel : str
        A registered distance kernel, or ``"auto"`` for the fastest installed one; for a few short series,
        of `SMALL` cells together, that is NumPy's.
    options : mapping, optional
        Keyword arguments of kernels by their names; those of other plugins are left alone.

    Returns
    -------
    (Q, N) float array
        In the unit of the series, squared for ``cost="squared"`` without a root. Infinity where a
        pair has no dimension in common; never NaN.

    Raises
    ------
    InputError
        For an empty, ragged-width, NaN or infinite series; it names the index. Also for one array
        instead of a sequence of them, and where the band leaves a pair without a path; it names the pair.
    ConfigError
        For what is no specification, and options of what is no plugin.
    PluginError
        Where the kernel is unknown, does not compute ``spec``, or breaks its contract.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import warping_distances
    >>> rise, fall = np.array([0.0, 1.0, 2.0]), np.array([2.0, 1.0, 1.0, 0.0])
    >>> warping_distances([rise, fall], [rise], kernel="numpy").tolist()
    [[0.0], [4.0]]
    """
    spec = as_spec(spec)
    query_batch, example_batch = make_batches(queries, examples, spec)
    name, chosen = choose_kernel(kernel, spec, options, cells_of(query_batch, example_batch))
    values = np.asarray(chosen.distances(chosen.prepare(example_batch, spec), query_batch))
    return check_distances(values, query_batch, example_batch, name)


def warping_distance(
    query: Signals | np.ndarray,
    example: Signals | np.ndarray,
    spec: DtwSpec | None = None,
    kernel: str = "auto",
    options: Options | None = None,
) -> float:
    """The warping distance of one pair; many pairs are faster by `warping_distances`.

    Parameters
    ----------
    query, example : Signals or (n,) or (n, D), (m,) or (m, D) arrays
    spec, kernel, options
        As in `warping_distances`, and so are the errors.

    Returns
    -------
    float
        Infinity where the two have no dimension in common.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import warping_distance
    >>> warping_distance(np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0, 2.0]), kernel="numpy")
    1.0
    """
    return float(warping_distances([query], [example], spec, kernel, options)[0, 0])


def derivatives(series: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The slope estimate of each series; warp these for derivative DTW (Keogh and Pazzani 2001).

    A slope is the mean of that to the left neighbour and of that between both neighbours; the first
    and the last frame take their neighbour's, so that lengths stay.

    Parameters
    ----------
    series : sequence of (T,) or (T, D) arrays, T at least 3

    Returns
    -------
    list of arrays of the same shapes
        In the unit of the series for each frame. float32 where a series is, else float64: whole
        numbers without a sign would wrap.

    Raises
    ------
    SignalError
        Where a series is shorter than three frames.
    InputError
        Where one is no array of frames, or has masked values.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import derivatives
    >>> derivatives([np.array([0.0, 1.0, 4.0, 9.0, 16.0])])[0].tolist()
    [1.5, 1.5, 3.5, 5.5, 5.5]
    """
    refuse_one(series)
    slopes = []
    for index, item in enumerate(series):
        if np.ma.is_masked(item):
            raise InputError(
                f"series {index} has masked values", remedy="fill the gaps first", code="E_NOT_FINITE"
            )
        x = np.asarray(item)
        if x.ndim not in (1, 2) or x.dtype.kind not in "iuf":
            raise InputError(
                f"series {index} is {x.dtype} of shape {x.shape}, expected numbers of shape (T,) or (T, D)",
                code="E_DIMENSIONS",
            )
        if len(x) < 3:
            raise SignalError(
                f"series {index} has {len(x)} frames, derivative DTW needs 3", code="E_SIGNAL_SHORT"
            )
        x = x if x.dtype == np.float32 else x.astype(np.float64)
        slope = ((x[1:-1] - x[:-2]) + (x[2:] - x[:-2]) / 2) / 2
        slopes.append(np.concatenate([slope[:1], slope, slope[-1:]]))
    return slopes


def choose_kernel(
    name: str, spec: DtwSpec, options: Options | None = None, cells: float = math.inf
) -> tuple[str, DistanceKernel]:
    """The kernel called ``name``, or the fastest installed one that supports ``spec``.

    ``options`` holds the keyword arguments of kernels by their names, ``cells`` is from `cells_of`; without
    it the job is a large one.

    Returns
    -------
    (name, kernel)

    Raises
    ------
    ConfigError
        For options of what is no plugin: a kernel's name that is misspelt.
    PluginError
        Where the named kernel is unknown or does not support ``spec``.
    """
    options = options or {}
    plugins = set(map(itemgetter(1), registry().entries))
    for owner in options:
        if owner.partition(":")[0] not in plugins:
            near = difflib.get_close_matches(owner, registry().names("kernel"), 1)
            raise ConfigError(
                f"options of {owner!r}, which is no plugin",
                remedy=f"did you mean {near[0]!r}?" if near else "the name of a distance kernel",
                code="E_OPTION",
            )
    if name != "auto":
        kernel: DistanceKernel = registry().make("kernel", name, options.get(name))
        if not kernel.supports(spec):
            raise PluginError(
                f"distance kernel {name!r} does not compute {spec}",
                remedy="--kernel auto",
                code="E_KERNEL_UNSUPPORTED",
            )
        return name, kernel
    usable = registry().names("kernel", usable=True)
    gpu = GPU_ORDER if Path("/dev/nvidiactl").exists() else ()
    if cells <= SMALL:
        gpu, usable = (), tuple(candidate for candidate in usable if candidate == "numpy") or usable
    for place, candidate in enumerate((*gpu, *CPU_ORDER)):
        if candidate not in usable:
            continue
        kernel = registry().make("kernel", candidate, options.get(candidate))
        if place < len(gpu) and not (isinstance(kernel, DeviceKernel) and kernel.device != "cpu"):
            continue
        if kernel.supports(spec):
            return candidate, kernel
    raise PluginError(f"no installed distance kernel computes {spec}", code="E_KERNEL_UNSUPPORTED")


def cells_of(queries: SignalBatch, examples: SignalBatch) -> float:
    """Cells of the tables of all pairs, times the dimensions."""
    return float(queries.lengths.sum() * float(examples.lengths.sum()) * queries.values.shape[2])


def pair_distances(
    kernel: DistanceKernel,
    queries: SignalBatch,
    examples: SignalBatch,
    spec: DtwSpec,
    query_index: np.ndarray,
    example_index: np.ndarray,
    state: Any = None,
) -> np.ndarray:
    """(K,) distances of the pairs ``(query_index[k], example_index[k])``, by any kernel.

    For a kernel that only computes tables, each query's examples are a table of one row. ``state``
    is what the kernel prepared for ``examples``, where the caller has it.
    """
    if isinstance(kernel, PairKernel):
        if state is None:
            state = kernel.prepare(examples, spec)
        return np.asarray(kernel.pairs(state, queries, query_index, example_index))
    out = np.empty(len(query_index), queries.values.dtype)
    order = np.argsort(query_index, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(query_index[order])) + 1):
        chosen = kernel.prepare(subset(examples, example_index[group]), spec)
        out[group] = kernel.distances(chosen, subset(queries, query_index[group[:1]]))[0]
    return out


def check_distances(values: np.ndarray, queries: SignalBatch, examples: SignalBatch, name: str) -> np.ndarray:
    """Hold a kernel to its contract: the shape, no NaN, infinity only without a common dimension."""
    entries = registry().entries.get(("kernel", name), [])
    kernel = str(entries[0]) if entries else f"distance kernel {name!r}"
    if values.shape != (len(queries), len(examples)):
        raise PluginError(
            f"{kernel} returned shape {values.shape} for {len(queries)} queries and {len(examples)} examples",
            code="E_PLUGIN_CONTRACT",
        )
    qi, ei = np.nonzero(~np.isfinite(values))
    wrong = np.isnan(values[qi, ei]) | used_dimensions(queries, examples, qi, ei).any(axis=1)
    if wrong.any():
        first = int(wrong.argmax())
        raise PluginError(
            f"{kernel} returned {values[qi[first], ei[first]]} for query {qi[first]} and example {ei[first]}",
            remedy="another --kernel, and a report to its author",
            code="E_PLUGIN_CONTRACT",
        )
    return values
