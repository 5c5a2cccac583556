"""Conformance suites that authors of plugins run; the package's own tests run them over every plugin.

>>> import pytest
>>> from gesture_core.testing import KERNEL_CHECKS
>>> @pytest.mark.parametrize("check", KERNEL_CHECKS)
... def test_my_kernel(check):
...     check(MyKernel())
"""

from gesture_core.testing.kernels import (
    KERNEL_CHECKS,
    Case,
    check_bits,
    check_gradients,
    check_lower_bound,
    check_nothing_in_common,
    check_pairs,
    check_reference,
    check_single_frames,
    compare,
    draw_batch,
    reference_table,
    specifications,
)

__all__ = [
    "KERNEL_CHECKS",
    "Case",
    "check_bits",
    "check_gradients",
    "check_lower_bound",
    "check_nothing_in_common",
    "check_pairs",
    "check_reference",
    "check_single_frames",
    "compare",
    "draw_batch",
    "reference_table",
    "specifications",
]
