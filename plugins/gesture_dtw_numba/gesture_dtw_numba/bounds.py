"""LB_Keogh in compiled code: what exact search computes for every pair."""

from __future__ import annotations

from typing import Any

from gesture_dtw_numba.compiled import compiled


def _keogh(query: Any, lower: Any, upper: Any, squared: Any, out: Any) -> None:
    count, width, frames = lower.shape
    for example in range(count):
        for d in range(width):
            low, high, x = lower[example, d], upper[example, d], query[d]
            total = 0.0
            if squared:
                for i in range(frames):
                    outside = max(max(x[i] - high[i], low[i] - x[i]), 0.0)
                    total += outside * outside
            else:
                for i in range(frames):
                    total += max(max(x[i] - high[i], low[i] - x[i]), 0.0)
            out[example, d] = total


keogh = compiled(_keogh, fastmath={"reassoc", "nnan", "nsz"})
"""``keogh(query, lower, upper, squared, out)`` sets ``out`` (N, D) to the sums over frames of how far
``query`` (D, n) lies outside ``lower`` and ``upper`` (N, D, n), squared where asked. All float64. The
order of a sum is the compiler's choice: bounds have a margin for it."""
