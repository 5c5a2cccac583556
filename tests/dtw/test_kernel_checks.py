"""The conformance suite of kernels: what is right passes, what is wrong does not.

`tests/plugin/test_conformance.py` runs it over every registered kernel.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from gesture_core.dtw.spec import DtwSpec
from gesture_core.dtw.subsequence import reference_subsequences
from gesture_core.settings import load_settings, presets
from gesture_core.testing import KERNEL_CHECKS, Case, compare, draw_batch
from gesture_core.testing.kernels import (
    check_nothing_in_common,
    check_reference,
    check_single_frames,
    check_subsequences,
)
from gesture_core.types import SignalBatch


class PlainKernel:
    """Hard, dependent warping, one pair at a time, as a third party may write it."""

    def supports(self, spec: DtwSpec) -> bool:
        plain = DtwSpec(mode="dependent", reduce="sum", cost=spec.cost)
        return spec == plain and spec.cost in ("absolute", "squared")

    def prepare(self, examples: SignalBatch, spec: DtwSpec) -> tuple[SignalBatch, np.ufunc]:
        return examples, np.square if spec.cost == "squared" else np.abs

    def distances(self, state: tuple[SignalBatch, np.ufunc], queries: SignalBatch) -> np.ndarray:
        examples, cost = state
        out = np.full((len(queries), len(examples)), np.inf)
        for q in range(len(queries)):
            for e in range(len(examples)):
                used = (queries.masks[q] | examples.masks[e]) & queries.present[q] & examples.present[e]
                if used.any():
                    a = queries.values[q, : queries.lengths[q], used].T
                    b = examples.values[e, : examples.lengths[e], used].T
                    out[q, e] = self.warp(cost(a[:, None] - b[None]).sum(axis=2))
        return out

    def warp(self, cost: np.ndarray) -> float:
        total = np.full((cost.shape[0] + 1, cost.shape[1] + 1), np.inf)
        total[0, 0] = 0
        for i in range(cost.shape[0]):
            for j in range(cost.shape[1]):
                best = min(total[i, j], total[i, j + 1], total[i + 1, j])
                total[i + 1, j + 1] = cost[i, j] + best
        return float(total[-1, -1])


class DiagonalKernel(PlainKernel):
    """A wrong one, which sums the diagonal alone."""

    def warp(self, cost: np.ndarray) -> float:
        return float(np.trace(cost))


def test_a_third_partys_kernel_passes_as_it_stands() -> None:
    for check in KERNEL_CHECKS:
        check(PlainKernel())
    rng = np.random.default_rng(0)
    spec = DtwSpec(mode="dependent", reduce="sum")
    assert compare(PlainKernel(), Case(draw_batch(rng, 3, 9, 2), draw_batch(rng, 4, 9, 2), spec)) == 12


def test_a_wrong_kernel_does_not_pass() -> None:
    with pytest.raises(AssertionError):
        for check in KERNEL_CHECKS:
            check(DiagonalKernel())


class Constant:
    """One for everything, under ``spec`` alone."""

    def __init__(self, spec: DtwSpec) -> None:
        self.spec = spec

    def supports(self, spec: DtwSpec) -> bool:
        return spec == self.spec

    def prepare(self, examples: SignalBatch, spec: DtwSpec) -> SignalBatch:
        return examples

    def distances(self, state: SignalBatch, queries: SignalBatch) -> np.ndarray:
        return np.ones((len(queries), len(state)))


@pytest.mark.parametrize("preset", presets())
def test_a_kernel_for_one_preset_alone_is_held_to_it(preset: str) -> None:
    kernel = Constant(load_settings(preset, environment={}).dtw)
    for check in (check_reference, check_single_frames, check_nothing_in_common):
        with pytest.raises(AssertionError):
            check(kernel)


@pytest.mark.parametrize("cost", ["absolute", "squared", "euclidean"])
@pytest.mark.parametrize("mode", ["independent", "dependent"])
def test_a_kernel_for_one_form_alone_is_held_to_it(mode: str, cost: str) -> None:
    spec = DtwSpec(mode=mode, cost=cost, reduce="sum")  # type: ignore[arg-type]
    for check in (check_reference, check_single_frames, check_nothing_in_common):
        with pytest.raises(AssertionError):
            check(Constant(spec))


def test_a_kernel_of_which_nothing_is_compared_does_not_pass() -> None:
    with pytest.raises(AssertionError, match="supports none of the specifications"):
        check_reference(Constant(DtwSpec(window=3, cost="squared", length_norm=True)))


class ForgetfulKernel(PlainKernel):
    """A wrong one, which begins anew with each block of a stream."""

    def subsequences(self, examples: Sequence[np.ndarray], floor: float) -> ForgetfulKernel:
        self._examples, self._floor = examples, floor
        return self

    def push(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = [reference_subsequences(frames, example, self._floor) for example in self._examples]
        distances, lengths = zip(*found, strict=True)
        return np.stack(distances, axis=1), np.stack(lengths, axis=1)


def test_a_kernel_that_forgets_a_stream_between_blocks_is_found_out() -> None:
    with pytest.raises(AssertionError, match="other bits in other blocks"):
        check_subsequences(ForgetfulKernel())
