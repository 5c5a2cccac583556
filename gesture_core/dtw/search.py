"""Exact nearest neighbours with few warpings: lower bounds first, then warpings in their order.

LB_Kim (Kim, Park and Chu 2001) and LB_Keogh (Keogh and Ratanamahatana 2005) are of one dimension's
accumulated cost, before norm and root, and hold for padded batches of unequal lengths. They are
computed in float64 and lowered by a margin, so that none exceeds the distance that a float32 kernel
computes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np

from gesture_core.dtw.bands import is_banded, row_spans
from gesture_core.dtw.batches import Series, check_batches, common_dtype, subset, used_dimensions, weighted
from gesture_core.dtw.distances import Options, check_distances, choose_kernel, pair_distances
from gesture_core.dtw.spec import DtwSpec, as_spec
from gesture_core.errors import ConfigError, InputError, PluginError
from gesture_core.plugin.abilities import SearchKernel
from gesture_core.types import Neighbors, SignalBatch

Keogh = Callable[[np.ndarray, np.ndarray, np.ndarray, bool], np.ndarray]

_ROUND = 32
"""Examples of a query that are warped, at least, between two looks at its k-th best distance."""
_PAIRS_AT_ONCE = 1 << 22
"""Pairs whose bounds are held at once; more queries follow in parts."""
_REST = 0.5
"""Where the bounds allow more than this share of what is left, all of it is warped at once."""
_PAIRS_PER_SHAPE = 100
"""Pairs that share their two lengths, on average, from which on bounds are faster than warping all."""
_MARGIN = {np.dtype(np.float32): 1e-4, np.dtype(np.float64): 1e-10}
"""Relative share by which a bound of short series is lowered."""


def nearest(
    queries: Series,
    examples: Series,
    k: int = 1,
    spec: DtwSpec | None = None,
    kernel: str = "auto",
    options: Options | None = None,
) -> Neighbors:
    """The k nearest examples of each query: those of `warping_distances`, with fewer warpings.

    Examples that are searched more than once are prepared once by `ExampleIndex`.

    Parameters
    ----------
    queries, examples : sequences of Q and N Signals or (T,) or (T, D) arrays
    k : int
        1 to N.
    spec, kernel, options
        As in `warping_distances`, and so are the errors.

    Returns
    -------
    Neighbors
        (Q, k) distances and indices, nearest first; ties go to the lower index.

    Raises
    ------
    ConfigError
        Where ``k`` is no whole number between 1 and the number of examples.

    Notes
    -----
    The lower bounds are LB_Kim (Kim, Park and Chu 2001) and LB_Keogh (Keogh and Ratanamahatana
    2005). Where hardly two series have the same length they take longer than they save, and soft-DTW
    has none: all distances are computed then, and the neighbours are the same.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import nearest
    >>> examples = [np.zeros(5), np.arange(5.0), np.arange(5.0)]
    >>> nearest([np.arange(9.0) / 2], examples, k=2, kernel="numpy").indices.tolist()
    [[1, 2]]
    """
    return ExampleIndex(examples, spec, kernel, options).nearest(queries, k)


@dataclass(frozen=True, eq=False)
class _Prepared:
    """Examples in one dtype, what the kernel and what the bounds keep of them.

    Attributes
    ----------
    batch : SignalBatch
    state : object
        The kernel's own.
    values : (N, T, D) float64
        Weighted.
    ends : (2, N, D) float64
        First and last frames.
    """

    batch: SignalBatch
    state: Any
    values: np.ndarray
    ends: np.ndarray


class ExampleIndex:
    """Examples prepared once for exact search; see `nearest` for parameters and errors.

    Examples
    --------
    >>> import numpy as np
    >>> from gesture_core.dtw import ExampleIndex
    >>> index = ExampleIndex([np.zeros(5), np.arange(5.0)], kernel="numpy")
    >>> index.nearest([np.ones(4)]).indices.tolist()
    [[0]]
    """

    def __init__(
        self,
        examples: Series,
        spec: DtwSpec | None = None,
        kernel: str = "auto",
        options: Options | None = None,
    ) -> None:
        self.spec = as_spec(spec)
        dtype, self._bare = common_dtype((), examples)
        self._batch = SignalBatch.of(examples, dtype, name="example")
        self.kernel, self._kernel = choose_kernel(kernel, self.spec, options)
        self._prepared: dict[type[np.floating], _Prepared] = {}

    def nearest(self, queries: Series, k: int = 1, among: np.ndarray | None = None) -> Neighbors:
        """The k nearest examples of each query.

        Parameters
        ----------
        queries : sequence of Q Signals or (T,) or (T, D) arrays
        k : int
            1 to N.
        among : (Q, N) bool, optional
            Examples that each query may be compared with; the others are infinitely far away.

        Returns
        -------
        Neighbors
            (Q, k) distances and indices, nearest first; ties go to the lower index.
        """
        count = len(self._batch)
        if not isinstance(k, Integral) or not 1 <= k <= count:
            raise ConfigError(f"k = {k} of {count} examples", code="E_OPTION")
        dtype, bare = common_dtype(queries, ())
        batch = SignalBatch.of(queries, dtype, name="query")
        if among is not None and among.shape != (len(batch), count):
            raise InputError(
                f"among has shape {among.shape}, expected {(len(batch), count)}", code="E_DIMENSIONS"
            )
        # Computed in the wider of the two types.
        dtype = np.result_type(dtype, self._batch.values.dtype).type
        batch = SignalBatch(batch.values.astype(dtype, copy=False), batch.lengths, batch.masks, batch.present)
        examples = self._examples(dtype)
        check_batches(batch, examples.batch, self.spec, bare=bare or self._bare)
        parts = []
        size = max(1, _PAIRS_AT_ONCE // count)
        for start in range(0, len(batch), size):
            part = np.arange(start, min(start + size, len(batch)))
            values = self._search(subset(batch, part), examples, k, None if among is None else among[part])
            parts.append(_least(values, k))
        return Neighbors(*(np.concatenate(sides) for sides in zip(*parts, strict=True)))

    def _examples(self, dtype: type[np.floating]) -> _Prepared:
        """The examples in ``dtype``, prepared at their first use."""
        if dtype not in self._prepared:
            own = self._batch
            batch = SignalBatch(own.values.astype(dtype, copy=False), own.lengths, own.masks, own.present)
            values = weighted(batch.values, self.spec).astype(np.float64)
            ends = np.stack([values[:, 0], values[np.arange(len(batch)), batch.lengths - 1]])
            state = self._kernel.prepare(batch, self.spec)
            self._prepared[dtype] = _Prepared(batch, state, values, ends)
        return self._prepared[dtype]

    def _search(
        self, queries: SignalBatch, examples: _Prepared, k: int, among: np.ndarray | None
    ) -> np.ndarray:
        """(Q, N) distances of those pairs that may be among the k nearest, infinity for the others."""
        spec, kernel = self.spec, self._kernel
        shapes = len(np.unique(queries.lengths)) * len(np.unique(examples.batch.lengths))
        if spec.gamma is not None or len(queries) * len(examples.batch) < shapes * _PAIRS_PER_SHAPE:
            found = np.asarray(kernel.distances(examples.state, queries))
            check_distances(found, queries, examples.batch, self.kernel)
            return found if among is None else np.where(among, found, np.inf).astype(found.dtype)
        fast = kernel.keogh if isinstance(kernel, SearchKernel) else keogh
        limits = lower_bounds(queries, examples, spec, fast)
        if among is not None:
            limits[~among] = np.inf
        order = np.argsort(limits, axis=1, kind="stable")
        ranked = np.take_along_axis(limits, order, axis=1)
        ranked[np.isinf(ranked)] = np.nan  # below no limit: what is infinitely far away is not warped
        values = np.full(limits.shape, np.inf, queries.values.dtype)
        best = np.full((len(values), k), np.inf)
        position, step = 0, k
        active = np.arange(len(values))
        while len(active) and position < values.shape[1]:
            # The next candidates of every query whose bound still allows a place among the k best.
            ahead = slice(position, position + step)
            row, column = np.nonzero(ranked[active, ahead] <= best[active, -1:])
            qi, ei = active[row], order[active, ahead][row, column]
            found = self._within(queries, examples, qi, ei, best[:, -1])
            values[qi, ei] = found
            seen = np.full((len(active), k + step), np.inf)
            seen[:, :k] = best[active]
            seen[row, k + column] = found
            best[active] = np.sort(np.partition(seen, k - 1, axis=1)[:, :k], axis=1)
            position += step
            # Few candidates first, to learn the k-th best distance cheaply; then more at a time.
            step = max(_ROUND, position // 4)
            if position < values.shape[1]:
                active = active[ranked[active, position] <= best[active, -1]]
                allowed = (ranked[active, position:] <= best[active, -1:]).mean() if len(active) else 0
                if position > _ROUND and allowed > _REST:
                    step = values.shape[1]
        return values

    def _within(
        self, queries: SignalBatch, examples: _Prepared, qi: np.ndarray, ei: np.ndarray, limits: np.ndarray
    ) -> np.ndarray:
        """(K,) distances of chosen pairs; infinity is allowed for those above their query's limit."""
        if len(qi) == 0:
            return np.empty(0, queries.values.dtype)
        kernel = self._kernel
        if isinstance(kernel, SearchKernel):
            # Above the rounding of sums: what equals the limit must not be abandoned.
            roomy = limits * (1 + _MARGIN[queries.values.dtype])
            found = np.asarray(kernel.within(examples.state, queries, qi, ei, roomy))
        else:
            found = pair_distances(kernel, queries, examples.batch, self.spec, qi, ei, examples.state)
        if found.shape != qi.shape or np.isnan(found).any():
            raise PluginError(
                f"distance kernel {self.kernel!r} returned NaN, or other than {len(qi)} distances",
                remedy="another --kernel, and a report to its author",
                code="E_PLUGIN_CONTRACT",
            )
        return found


def _least(values: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """(Q, k) the least values of each row and their columns; ties go to the lower column."""
    worst = np.partition(values, k - 1, axis=1)[:, k - 1]
    rows, columns = np.nonzero(values <= worst[:, None])
    order = np.lexsort((columns, values[rows, columns], rows))
    starts = np.flatnonzero(np.diff(rows, prepend=-1))
    chosen = order[starts[:, None] + np.arange(k)]
    return values[rows[chosen], columns[chosen]], columns[chosen].astype(np.int64)


def lower_bounds(queries: SignalBatch, examples: _Prepared, spec: DtwSpec, keogh: Keogh) -> np.ndarray:
    """(Q, N) float64 numbers that no hard warping distance is below; infinity where it is infinite.

    The greater of LB_Kim and LB_Keogh for each dimension, summed over the dimensions of the pair.
    """
    squared = spec.cost == "squared" or (spec.cost == "euclidean" and spec.mode == "dependent")
    dtype, width = queries.values.dtype, queries.values.shape[2]
    q_values = weighted(queries.values, spec).astype(np.float64)
    batch, every = examples.batch, np.arange(len(examples.batch))
    out = np.empty((len(queries), len(batch)))
    for n in np.unique(queries.lengths).tolist():
        lower, upper = envelope(examples.values, batch.lengths, n, spec)
        single = (batch.lengths == 1) & (n == 1)
        frames = n + batch.lengths
        # A path has fewer cells than both have frames; a cell sums its dimensions. A sum of
        # non-negative numbers, one after the other, is at most its number of terms times half of the
        # machine epsilon off (Higham 2002, section 4.2); twice that is taken off.
        kept = 1 - np.maximum(_MARGIN[dtype], (frames + width) * float(np.finfo(dtype).eps))[:, None]
        # Squares and shares of squares that lie below the dtype's range.
        lost = 2 * float(np.finfo(dtype).tiny) * frames[:, None]
        for index in np.flatnonzero(queries.lengths == n):
            use = used_dimensions(queries, batch, np.full(len(batch), index), every)
            x = q_values[index, :n]
            outside = keogh(np.ascontiguousarray(x.T), lower, upper, squared)
            bound = np.maximum(kim(x, examples.ends, single, squared), outside)
            bound = np.maximum(bound * kept - lost, 0)
            out[index] = _combine(bound, use, frames, spec)
    return out


def envelope(
    values: np.ndarray, lengths: np.ndarray, rows: int, spec: DtwSpec
) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest value that each of ``rows`` query frames can meet in each example.

    Parameters
    ----------
    values : (N, T, D) float
    lengths : (N,) int64

    Returns
    -------
    lower, upper : (N, D, rows)
        LB_Keogh's envelope, for any band; without a band the range of the whole example.
    """
    count, _, width = values.shape
    lower, upper = np.empty((count, width, rows)), np.empty((count, width, rows))
    for length in np.unique(lengths).tolist():
        which = np.flatnonzero(lengths == length)
        part = values[which, :length].transpose(0, 2, 1)
        if not is_banded(spec):
            lower[which], upper[which] = part.min(axis=2, keepdims=True), part.max(axis=2, keepdims=True)
            continue
        (low,), (high,) = row_spans(rows, np.array([length]), spec)
        for side, pick in ((lower, np.minimum), (upper, np.maximum)):
            # Over every span at once, by windows that double in width (a sparse table).
            levels = [part]
            span = 1
            while span * 2 <= int((high - low).max()):
                levels.append(pick(levels[-1][..., :-span], levels[-1][..., span:]))
                span *= 2
            level = np.floor(np.log2(high - low)).astype(np.int64)
            for k in np.unique(level):
                row = np.flatnonzero(level == k)
                found = pick(levels[k][..., low[row]], levels[k][..., high[row] - (1 << k)])
                side[np.ix_(which, np.arange(width), row)] = found
    return lower, upper


def keogh(query: np.ndarray, lower: np.ndarray, upper: np.ndarray, squared: bool) -> np.ndarray:
    """(N, D) LB_Keogh of one query (D, n) against envelopes (N, D, n), without a margin."""
    outside = np.maximum(query - upper, lower - query)
    np.maximum(outside, 0, out=outside)
    if squared:
        outside *= outside
    return np.asarray(outside.sum(axis=2))


def kim(query: np.ndarray, ends: np.ndarray, single: np.ndarray, squared: bool) -> np.ndarray:
    """(N, D) LB_Kim of its first and last frames, which every path matches, without a margin.

    Parameters
    ----------
    query : (n, D)
    ends : (2, N, D)
        First and last frames of the examples.
    single : (N,) bool
        Pairs of two single frames, whose two ends are one cell.
    """
    difference = query[[0, -1], None] - ends
    first, last = np.square(difference) if squared else np.abs(difference)
    both: np.ndarray = np.where(single[:, None], first, first + last)
    return both


def _combine(bound: np.ndarray, use: np.ndarray, frames: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """(N,) bound of the distance from (N, D) bounds of the dimensions."""
    bound = np.where(use, bound, 0)
    count = use.sum(axis=1)
    if spec.mode == "independent":
        if spec.length_norm:
            bound = bound / frames[:, None]
        total = (np.sqrt(bound) if spec.root else bound).sum(axis=1)
        total = total / np.maximum(count, 1) if spec.reduce == "mean" else total
    else:
        total = bound.sum(axis=1)
        if spec.reduce == "mean":
            total = total / np.maximum(count, 1)
        if spec.cost == "euclidean":
            # The sum of square roots is at least the square root of the sum.
            total = np.sqrt(total)
        if spec.length_norm:
            total = total / frames
        if spec.root:
            total = np.sqrt(total)
    return np.where(count == 0, np.inf, total)
