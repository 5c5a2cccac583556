"""Groups of queries and examples: gather lanes, sweep them, add up the dimensions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from gesture_dtw_numba.compiled import LANES, ROWS, compiled
from gesture_dtw_numba.sweep import sweep


@compiled
def groups(
    q: Any,
    qs: Any,
    q_ends: Any,
    e: Any,
    es: Any,
    e_ends: Any,
    rule: Any,
    bands: Any,
    square: Any,
    gamma: Any,
    costs: Any,
    limits: Any,
    scratch: Any,
    out: Any,
) -> None:
    """The distances of groups of queries and examples.

    Group g is every query of ``qs[q_ends[g]:q_ends[g + 1]]`` with every example of
    ``es[e_ends[g]:e_ends[g + 1]]``, which ascend in length; its distances are the next numbers of
    ``out``, a row for each query. Compiled once for each dtype, for absolute differences and for
    squared ones, and for each of: hard costs of one dimension without a band, other hard ones, soft ones.

    Parameters
    ----------
    q, e : Batch
    qs, es, q_ends, e_ends : int64
    rule : Rule
    bands : Bands
    square : None or True
        As in `sweep`.
    gamma : None or float
    costs : None or Costs
        None only for hard, independent warping without a band.
    limits : float64
        Empty, or a distance for each of the queries that are stored in ``q``: a pair that is certain
        to exceed its query's is left at infinity as soon as that is known.
    scratch : Scratch
    out : float64
    """
    at = 0
    for g in range(len(q_ends) - 1):
        own_qs, own_es = qs[q_ends[g] : q_ends[g + 1]], es[e_ends[g] : e_ends[g + 1]]
        shape = (len(own_qs), len(own_es))
        stop = at + shape[0] * shape[1]
        found = out[at:stop].reshape(shape)
        _group(q, own_qs, e, own_es, rule, bands, square, gamma, costs, limits, scratch, found)
        at = stop


@njit(nogil=True, error_model="numpy")
def _group(
    q: Any,
    qs: Any,
    e: Any,
    es: Any,
    rule: Any,
    bands: Any,
    square: Any,
    gamma: Any,
    costs: Any,
    limits: Any,
    scratch: Any,
    out: Any,
) -> None:
    members = np.empty(len(es), np.int64)
    width = q.values.shape[1]
    limited = len(limits) > 0
    out[:] = 0
    # Independent: each dimension by itself, first for queries in which it is salient, then for the
    # others, whose examples are fewer. Dependent: everything at once, shares tell dimensions apart.
    step = width if rule.dependent else 1
    for d in range(0, width, step):
        for salient in (True, False):
            if not (salient if rule.dependent else _any_query(q, qs, d, salient)):
                continue
            count = _members(e, es, d, salient, rule.dependent, members)
            for first in range(0, count, LANES):
                lanes = members[first : min(first + LANES, count)]
                block = _gather(e, es, lanes, d, d + step, scratch)
                rows = -1
                for k, query in enumerate(qs):
                    if not rule.dependent and (not q.present[query, d] or q.masks[query, d] != salient):
                        continue
                    if limited and not _set_limits(
                        q, query, e, es, lanes, limits[query], rule, scratch, out[k]
                    ):
                        for position in lanes:
                            out[k, position] = np.inf
                        continue
                    x, padded = _pad_query(q, query, d, d + step, scratch)
                    if rows != q.lengths[query]:
                        rows = q.lengths[query]
                        if rule.banded:
                            _fill_band(bands, rows, padded, scratch)
                    if costs is not None and rule.dependent:
                        _fill_share(q, query, e, es, lanes, rule.mean, costs.share)
                    complete = sweep(x, padded, block, rule, costs, square, gamma, limited, scratch)
                    _collect(scratch, lanes, rows, complete, rule, out[k])
    _reduce(q, qs, e, es, rule.mean and not rule.dependent, out)


@njit(nogil=True, error_model="numpy")
def _set_limits(
    q: Any, query: Any, e: Any, es: Any, lanes: Any, limit: Any, rule: Any, scratch: Any, out: Any
) -> bool:
    """What each lane may accumulate before its pair exceeds ``limit``; whether any may at all."""
    scratch.limit[:] = -1
    any_left = False
    for lane, position in enumerate(lanes):
        example = es[position]
        whole = limit
        if rule.mean and not rule.dependent:
            whole *= _used(q, query, e, example)
        left = whole - out[position]
        if left >= 0:
            any_left = True
            if rule.root:
                left *= left
            if rule.length_norm:
                left *= q.lengths[query] + e.lengths[example]
            scratch.limit[lane] = left
    return any_left


@njit(nogil=True)
def _any_query(q: Any, qs: Any, d: Any, salient: Any) -> Any:
    count = 0
    for query in qs:
        count += q.present[query, d] and q.masks[query, d] == salient
    return count > 0


@njit(nogil=True)
def _members(e: Any, es: Any, d: Any, salient: Any, every: Any, members: Any) -> Any:
    """Positions in ``es`` that use dimension ``d`` with a query in which it is (not) salient, or all."""
    count = 0
    for position, example in enumerate(es):
        if every or (e.present[example, d] and (salient or e.masks[example, d])):
            members[count] = position
            count += 1
    return count


@njit(nogil=True)
def _gather(e: Any, es: Any, lanes: Any, first: Any, stop: Any, scratch: Any) -> Any:
    """Turn the chosen examples so that lanes come last; what is beyond a length is never read."""
    block, lengths = scratch.block, scratch.lengths
    lengths[:] = 0
    for lane, position in enumerate(lanes):
        example = es[position]
        lengths[lane] = e.lengths[example]
        for d in range(first, stop):
            for j in range(lengths[lane]):
                block[j, d - first, lane] = e.values[example, d, j]
    return block[: lengths.max()]


@njit(nogil=True)
def _pad_query(q: Any, query: Any, first: Any, stop: Any, scratch: Any) -> Any:
    """The query's frames after as many padded ones as fill the first pass; and their number."""
    frames = q.lengths[query]
    padded = -frames % ROWS
    x = scratch.x
    x[:padded] = scratch.far
    for i in range(frames):
        for d in range(first, stop):
            x[padded + i, d - first] = q.values[query, d, i]
    return x[: padded + frames], padded


@njit(nogil=True)
def _fill_band(bands: Any, rows: Any, padded: Any, scratch: Any) -> None:
    """Each lane's columns in each row; none in padded rows."""
    low, high, lengths = scratch.low, scratch.high, scratch.lengths
    low[:], high[:] = 0, 0
    for lane in range(LANES):
        if lengths[lane] > 0:
            offset = bands.offset[bands.query_index[rows], bands.example_index[lengths[lane]]]
            for i in range(rows):
                low[padded + i, lane] = bands.low[offset + i]
                high[padded + i, lane] = bands.high[offset + i]


@njit(nogil=True)
def _fill_share(q: Any, query: Any, e: Any, es: Any, lanes: Any, mean: Any, share: Any) -> None:
    """What each dimension counts for in each lane's local cost: 1, 1 / number of dimensions, or 0."""
    share[:] = 0
    for lane, position in enumerate(lanes):
        example = es[position]
        count = _used(q, query, e, example)
        for d in range(share.shape[0]):
            if (q.masks[query, d] or e.masks[example, d]) and q.present[query, d] and e.present[example, d]:
                share[d, lane] = 1 / count if mean else 1


@njit(nogil=True)
def _used(q: Any, query: Any, e: Any, example: Any) -> Any:
    """Number of dimensions that a pair is compared on."""
    count = 0
    for d in range(q.values.shape[1]):
        if (q.masks[query, d] or e.masks[example, d]) and q.present[query, d] and e.present[example, d]:
            count += 1
    return count


@njit(nogil=True, error_model="numpy")
def _collect(scratch: Any, lanes: Any, rows: Any, complete: Any, rule: Any, out: Any) -> None:
    """Add each lane's value at its own last column, normed and rooted, to its pair.

    Infinity where the table is not ``complete``: every pair exceeds its limit.
    """
    for lane, position in enumerate(lanes):
        columns = scratch.lengths[lane]
        value = np.float64(scratch.above[columns - 1, lane])
        if rule.length_norm:
            value /= rows + columns
        if rule.root:
            value = np.sqrt(value)
        out[position] += value if complete else np.inf


@njit(nogil=True, error_model="numpy")
def _reduce(q: Any, qs: Any, e: Any, es: Any, mean: Any, out: Any) -> None:
    """Divide by the number of dimensions where asked; infinity where there is none."""
    for k, query in enumerate(qs):
        for position, example in enumerate(es):
            count = _used(q, query, e, example)
            if count == 0:
                out[k, position] = np.inf
            elif mean:
                out[k, position] /= count
