"""Which cells a warping path may visit: Sakoe-Chiba, Itakura, or any boolean mask.

A band is one interval of columns for each row, by formula, so that it costs no memory beside the
series; only a mask with holes has to be held as cells.
"""

from __future__ import annotations

import numpy as np

from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import InputError

__all__ = ["allowed_cells", "has_holes", "is_banded", "row_spans"]

_ROUNDING = 1e-9
_AT_ONCE = 1 << 20
"""Rows of bands, all lengths together, that are held at once."""


def is_banded(spec: DtwSpec) -> bool:
    """Whether ``spec`` forbids any cell."""
    return spec.window is not None or spec.shape == "itakura" or spec.mask is not None


def row_spans(n: int, m: np.ndarray, spec: DtwSpec) -> tuple[np.ndarray, np.ndarray]:
    """First column and column past the last of each row, for a query of ``n`` frames and K examples.

    Sakoe and Chiba (1978): at most the radius away from the line between the two corners, measured
    along the longer series, so that the band is the same whichever series is the query. Itakura
    (1975): slopes from both corners between ``1 / max_slope`` and ``max_slope``, relative to that
    line. A mask of another shape is stretched to (n, m) by its nearest cells; holes between the
    first and the last cell of a row do not count here.

    Parameters
    ----------
    n : int
    m : (K,) int64
        The examples' lengths.
    spec : DtwSpec
        A fraction as its window rounds up, as the published windows of the UCR archive do.

    Returns
    -------
    low, high : (K, n) int32
        Both zero in a row without cells.
    """
    rows, m = np.arange(n, dtype=np.int64), np.asarray(m, np.int64)[:, None]
    low, high = np.zeros((len(m), n), np.int64), np.broadcast_to(m, (len(m), n))
    if spec.mask is not None:
        low, high = _mask_spans(n, m, spec.mask.array())
    if spec.window is not None and n > 1:
        longer = np.maximum(n, m)
        if isinstance(spec.window, int):
            radius = np.minimum(longer, min(spec.window, 1 << 60))
        else:
            radius = np.ceil(spec.window * longer - _ROUNDING).astype(np.int64)
        # Across the line: |row (m - 1) - column (n - 1)| <= reach, with the radius along the longer one.
        line, reach = rows * (m - 1), radius * (np.minimum(n, m) - 1)
        low = np.maximum(low, -((reach - line) // (n - 1)))
        high = np.minimum(high, (line + reach) // (n - 1) + 1)
    if spec.shape == "itakura" and n > 1:
        u, last = rows / (n - 1), m - 1
        steep, flat = spec.max_slope, 1 / spec.max_slope
        least = np.maximum(flat * u, 1 - steep * (1 - u)) - _ROUNDING
        most = np.minimum(steep * u, 1 - flat * (1 - u)) + _ROUNDING
        low = np.where(last > 0, np.maximum(low, np.ceil(least * last).astype(np.int64)), low)
        high = np.where(last > 0, np.minimum(high, np.floor(most * last).astype(np.int64) + 1), high)
    empty = low >= high
    return np.where(empty, 0, low).astype(np.int32), np.where(empty, 0, high).astype(np.int32)


def _mask_spans(n: int, m: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(K, n) first columns and columns past the last of a stretched mask."""
    row = _nearest(n, mask.shape[0])
    any_cell = mask.any(axis=1)
    first = np.where(any_cell, mask.argmax(axis=1), 0)
    past = np.where(any_cell, mask.shape[1] - mask[:, ::-1].argmax(axis=1), 0)
    low, high = np.empty((len(m), n), np.int64), np.empty((len(m), n), np.int64)
    for k, other in enumerate(m[:, 0].tolist()):
        column = _nearest(other, mask.shape[1])
        low[k], high[k] = np.searchsorted(column, first)[row], np.searchsorted(column, past)[row]
    return low, high


def _nearest(size: int, source: int) -> np.ndarray:
    """For each of ``size`` positions, the nearest of ``source`` positions over the same span."""
    if size == 1:
        return np.zeros(1, np.int64)
    step = (source - 1) / (size - 1)
    return np.array(np.rint(np.arange(size) * step), np.int64)


def allowed_cells(n: int, m: int, spec: DtwSpec) -> np.ndarray:
    """(n, m) bool: cells that a path between lengths ``n`` and ``m`` may visit; see `row_spans`."""
    if spec.mask is not None:
        mask = spec.mask.array()
        stretched: np.ndarray = mask[_nearest(n, mask.shape[0])[:, None], _nearest(m, mask.shape[1])[None, :]]
        return stretched
    (low,), (high,) = row_spans(n, np.array([m]), spec)
    column = np.arange(m, dtype=np.int32)
    inside: np.ndarray = (column >= low[:, None]) & (column < high[:, None])
    return inside


def has_holes(spec: DtwSpec) -> bool:
    """Whether some row of the band's mask is not one interval of columns."""
    if spec.mask is None:
        return False
    edges = np.diff(spec.mask.array().astype(np.int8), axis=1, prepend=0)
    return bool((np.maximum(edges, 0).sum(axis=1) > 1).any())


def is_feasible(n: int, m: np.ndarray, spec: DtwSpec) -> np.ndarray:
    """(K,) bool: whether any path leads from corner to corner inside the band, for K lengths of examples."""
    if has_holes(spec):
        return np.array([_has_path(allowed_cells(n, other, spec)) for other in m.tolist()])
    found = np.empty(len(m), bool)
    size = max(1, _AT_ONCE // n)
    for start in range(0, len(m), size):
        part = slice(start, start + size)
        low, high = row_spans(n, m[part], spec)
        # The leftmost column that a path can have reached in each row, which must lie in the row's
        # interval and at most one past the last column of the row before.
        reached = np.maximum.accumulate(low, axis=1)
        inside = (reached < high).all(axis=1) & (reached[:, 1:] <= high[:, :-1]).all(axis=1)
        found[part] = inside & (low[:, 0] == 0) & (high[:, -1] == m[part])
    return found


def _has_path(cells: np.ndarray) -> bool:
    """Whether a path leads from the first of (n, m) bool cells to the last."""
    if not (cells[0, 0] and cells[-1, -1]):
        return False
    position = np.arange(cells.shape[1])
    reached = np.logical_and.accumulate(cells[0])
    for row in cells[1:]:
        entered = row & (reached | np.concatenate(([False], reached[:-1])))
        # From where a row is entered a path may move right, up to the next gap.
        last_entry = np.maximum.accumulate(np.where(entered, position, -1))
        last_gap = np.maximum.accumulate(np.where(row, -1, position))
        reached = row & (last_entry > last_gap)
    return bool(reached[-1])


def check_feasible(query_lengths: np.ndarray, example_lengths: np.ndarray, spec: DtwSpec) -> None:
    """Refuse a band that leaves some pair without a path.

    Raises
    ------
    InputError
        Names the first such pair.
    """
    if not is_banded(spec):
        return
    columns = np.unique(example_lengths)
    for n in np.unique(query_lengths).tolist():
        possible = is_feasible(n, columns, spec)
        if not possible.all():
            m = int(columns[possible.argmin()])
            query = int(np.argmax(query_lengths == n))
            example = int(np.argmax(example_lengths == m))
            raise InputError(
                f"query {query} ({n} frames) and example {example} ({m} frames): "
                "no warping path fits into the band",
                remedy="a wider window, a steeper slope, or series of more similar length",
                code="E_BAND_INFEASIBLE",
            )
