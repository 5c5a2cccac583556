"""Some queries against some examples: gather lanes, sweep them, add up the dimensions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from gesture_dtw_numba.compiled import LANES, ROWS, compiled, sources
from gesture_dtw_numba.sweep import sweep


@cache
def compiled_tile() -> Callable[..., int]:
    """The compiled function of a tile.

    It takes ``(q, qs, e, es, rule, bands, gamma, costs, room, out)`` and sets ``out``
    (len(qs), len(es)) float64 to the distances of queries ``qs`` and examples ``es``, which ascend
    in length; it returns the checksum of the code that it was compiled from. It is compiled once for each
    dtype and for each of: hard costs of one dimension without a band, other hard ones, soft ones.

    q, e : Batch
    rule : Rule
    bands : Bands
    gamma : None or float
    costs : None or Costs; None only for hard, independent warping without a band
    room : Room
    """
    version = sources()

    def tile(
        q: Any, qs: Any, e: Any, es: Any, rule: Any, bands: Any, gamma: Any, costs: Any, room: Any, out: Any
    ) -> int:
        members = np.empty(len(es), np.int64)
        width = q.values.shape[1]
        out[:] = 0
        # Independent: each dimension by itself, first for queries in which it is salient, then for
        # the others, whose examples are fewer. Dependent: everything at once, shares tell dimensions.
        step = width if rule.dependent else 1
        for d in range(0, width, step):
            for salient in (True, False):
                if not (salient if rule.dependent else _any_query(q, qs, d, salient)):
                    continue
                count = _members(e, es, d, salient, rule.dependent, members)
                for first in range(0, count, LANES):
                    lanes = members[first : min(first + LANES, count)]
                    block = _gather(e, es, lanes, d, d + step, room)
                    rows = -1
                    for k, query in enumerate(qs):
                        if not rule.dependent and (
                            not q.present[query, d] or q.masks[query, d] != salient
                        ):  # fmt: skip
                            continue
                        x, padded = _pad_query(q, query, d, d + step, room)
                        if rows != q.lengths[query]:
                            rows = q.lengths[query]
                            if rule.banded:
                                _fill_band(bands, rows, padded, room)
                        if costs is not None and rule.dependent:
                            _fill_share(q, query, e, es, lanes, rule.mean, costs.share)
                        sweep(x, padded, block, rule, costs, gamma, room)
                        _collect(room, lanes, rows, rule, out[k])
        _reduce(q, qs, e, es, rule.mean and not rule.dependent, out)
        return version

    return compiled(tile)


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
def _gather(e: Any, es: Any, lanes: Any, first: Any, stop: Any, room: Any) -> Any:
    """Turn the chosen examples so that lanes come last; what is beyond a length is never read."""
    block, lengths = room.block, room.lengths
    lengths[:] = 0
    for lane, position in enumerate(lanes):
        example = es[position]
        lengths[lane] = e.lengths[example]
        for d in range(first, stop):
            for j in range(lengths[lane]):
                block[j, d - first, lane] = e.values[example, d, j]
    return block[: lengths.max()]


@njit(nogil=True)
def _pad_query(q: Any, query: Any, first: Any, stop: Any, room: Any) -> Any:
    """The query's frames after as many padded ones as fill the first pass; and their number."""
    frames = q.lengths[query]
    padded = -frames % ROWS
    x = room.x
    x[:padded] = room.far
    for i in range(frames):
        for d in range(first, stop):
            x[padded + i, d - first] = q.values[query, d, i]
    return x[: padded + frames], padded


@njit(nogil=True)
def _fill_band(bands: Any, rows: Any, padded: Any, room: Any) -> None:
    """Each lane's columns in each row; none in padded rows."""
    low, high, lengths = room.low, room.high, room.lengths
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
def _collect(room: Any, lanes: Any, rows: Any, rule: Any, out: Any) -> None:
    """Add each lane's value at its own last column, normed and rooted, to its pair."""
    for lane, position in enumerate(lanes):
        columns = room.lengths[lane]
        value = np.float64(room.above[columns - 1, lane])
        if rule.length_norm:
            value /= rows + columns
        if rule.root:
            value = np.sqrt(value)
        out[position] += value


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
