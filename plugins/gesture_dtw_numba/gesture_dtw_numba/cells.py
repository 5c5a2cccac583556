"""One cell of the warping table, in forms that the compiler turns into vector instructions.

Numba has no vector exponential of its own, so the two functions that a soft minimum needs are
polynomials here, accurate to the last bits of their type and the same on every path.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import overload

ULP_ONE_32, ULP_ONE_64 = np.float32(1 << 23), np.float64(1 << 52)
"""What the lowest exponent bit is worth in the integer that shares a float's bits."""


@njit(inline="always")
def least(up: Any, left: Any, diagonal: Any) -> Any:
    """The least of three; ``up``, which is the last to be known, comes last."""
    return min(min(left, diagonal), up)


@njit(inline="always")
def soft_least(up: Any, left: Any, diagonal: Any, gamma: Any, sharpness: Any) -> Any:
    """``-gamma * log(sum(exp(-v / gamma)))`` of three; ``sharpness`` is ``1 / gamma``.

    Written around the least of the three, whose own term is one: two exponentials remain.
    """
    low, high = min(up, left), max(up, left)
    first, second, third = min(low, diagonal), max(low, min(high, diagonal)), max(high, diagonal)
    rest = exp_negative((first - second) * sharpness) + exp_negative((first - third) * sharpness)
    return first - gamma * log_one_plus(rest)


@njit(inline="always")
def soft_shares(up: Any, left: Any, diagonal: Any, gamma: Any, sharpness: Any) -> Any:
    """`soft_least`, and the shares of it that ``up`` and ``left`` have: its derivatives."""
    low, high = min(up, left), max(up, left)
    first, second, third = min(low, diagonal), max(low, min(high, diagonal)), max(high, diagonal)
    of_second = exp_negative((first - second) * sharpness)
    of_third = exp_negative((first - third) * sharpness)
    one = gamma / gamma
    rest = of_second + of_third
    whole = one / (one + rest)
    of_up = one if up == first else (of_second if up == second else of_third)
    of_left = one if left == first else (of_second if left == second else of_third)
    return first - gamma * log_one_plus(rest), of_up * whole, of_left * whole


def exp_negative(x: Any) -> Any:
    """The exponential of a number that is not positive."""
    raise NotImplementedError("compiled code only")


def log_one_plus(x: Any) -> Any:
    """``log(1 + x)`` for x between 0 and 2; exactly 0 at 0."""
    raise NotImplementedError("compiled code only")


@overload(exp_negative, inline="always")
def _exp_negative(x: Any) -> Any:
    return _exp_32 if x == types.float32 else _exp_64


@overload(log_one_plus, inline="always")
def _log_one_plus(x: Any) -> Any:
    return _log_32 if x == types.float32 else _log_64


def _exp_32(x: Any) -> Any:
    # Cody and Waite's reduction to |r| <= log(2) / 2, then a Taylor polynomial.
    x = max(x, np.float32(-87.0))
    n = np.floor(x * np.float32(1.4426950408889634) + np.float32(0.5))
    r = x - n * np.float32(0.693359375) + n * np.float32(2.1219444e-4)
    p = r * np.float32(1 / 5040) + np.float32(1 / 720)
    p = p * r + np.float32(1 / 120)
    p = p * r + np.float32(1 / 24)
    p = p * r + np.float32(1 / 6)
    p = p * r + np.float32(1 / 2)
    p = p * r + np.float32(1)
    p = p * r + np.float32(1)
    return p * np.int32((n + np.float32(127)) * ULP_ONE_32).view(np.float32)


def _exp_64(x: Any) -> Any:
    x = max(x, -708.0)
    n = np.floor(x * 1.4426950408889634 + 0.5)
    r = x - n * 0.6931471803691238 - n * 1.9082149292705877e-10
    p = r * (1 / 6227020800) + 1 / 479001600
    p = p * r + 1 / 39916800
    p = p * r + 1 / 3628800
    p = p * r + 1 / 362880
    p = p * r + 1 / 40320
    p = p * r + 1 / 5040
    p = p * r + 1 / 720
    p = p * r + 1 / 120
    p = p * r + 1 / 24
    p = p * r + 1 / 6
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    return p * np.int64((n + 1023.0) * ULP_ONE_64).view(np.float64)


def _log_32(x: Any) -> Any:
    # log(c) + 2 atanh((1 + x - c) / (1 + x + c)), with c = 1 or 2, whichever is nearer.
    offset = np.float32(x > np.float32(0.5))
    t = (x - offset) / (x + np.float32(2) + offset)
    s = t * t
    p = s * np.float32(1 / 9) + np.float32(1 / 7)
    p = p * s + np.float32(1 / 5)
    p = p * s + np.float32(1 / 3)
    p = p * s + np.float32(1)
    return np.float32(2) * t * p + offset * np.float32(0.6931471805599453)


def _log_64(x: Any) -> Any:
    offset = np.float64(x > 0.5)
    t = (x - offset) / (x + 2.0 + offset)
    s = t * t
    p = s * (1 / 23) + 1 / 21
    p = p * s + 1 / 19
    p = p * s + 1 / 17
    p = p * s + 1 / 15
    p = p * s + 1 / 13
    p = p * s + 1 / 11
    p = p * s + 1 / 9
    p = p * s + 1 / 7
    p = p * s + 1 / 5
    p = p * s + 1 / 3
    p = p * s + 1.0
    return 2.0 * t * p + offset * 0.6931471805599453
