"""The conformance suite of distance kernels; see `gesture_core.testing`.

Every check takes a kernel and raises `AssertionError` where it breaks its contract. What a kernel
does not support is left out, unless that is everything. An `ApproximateKernel` is not held to the
reference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from gesture_core.dtw import reference, search
from gesture_core.dtw.bands import is_feasible
from gesture_core.dtw.batches import subset, used_dimensions
from gesture_core.dtw.spec import BandMask, DtwSpec
from gesture_core.dtw.subsequence import reference_subsequences
from gesture_core.plugin.abilities import (
    ApproximateKernel,
    GradientKernel,
    PairKernel,
    SearchKernel,
    SubsequenceKernel,
)
from gesture_core.settings import load_settings, presets
from gesture_core.types import SignalBatch

if TYPE_CHECKING:
    from gesture_core.plugin.interfaces import DistanceKernel

TOLERANCE = {np.dtype(np.float32): (1e-5, 1e-6), np.dtype(np.float64): (1e-10, 1e-10)}
"""Relative and absolute, against the float64 reference."""


@dataclass(frozen=True, eq=False)
class Case:
    """Queries, examples and a specification."""

    queries: SignalBatch
    examples: SignalBatch
    spec: DtwSpec


def draw_batch(
    rng: np.random.Generator,
    count: int,
    longest: int,
    width: int,
    dtype: type = np.float64,
    masked: bool = True,
) -> SignalBatch:
    """Random walks and noise of 1 to ``longest`` frames; ``masked`` draws masks and missing channels."""
    lengths = rng.integers(1, longest + 1, count)
    lengths[: min(2, count)] = (longest, 1)[: min(2, count)]
    values = np.zeros((count, longest, width))
    for index, length in enumerate(lengths):
        noise = rng.normal(size=(length, width))
        values[index, :length] = noise if index % 2 else np.cumsum(noise, axis=0) / 4
    masks = rng.random((count, width)) < 0.5 if masked else np.ones((count, width), bool)
    present = rng.random((count, width)) < 0.9 if masked else np.ones((count, width), bool)
    values = np.where(present[:, None, :], values, 0).astype(dtype)
    return SignalBatch(values, lengths.astype(np.int64), masks, present)


@cache
def _recursion() -> Callable[[np.ndarray, np.ndarray, float], np.ndarray]:
    """The loops of the reference, compiled where a compiler of Python loops is installed."""
    try:
        from numba import njit
    except ImportError:
        return reference.accumulate
    compiled: Callable[[np.ndarray, np.ndarray, float], np.ndarray] = njit(reference.accumulate)
    return compiled


def reference_table(case: Case) -> np.ndarray:
    """(Q, N) float64 distances by the reference; NaN where the band leaves no path."""
    queries, examples, spec = case.queries, case.examples, case.spec
    every = np.arange(len(examples))
    out = np.full((len(queries), len(examples)), np.nan)
    for i, n in enumerate(queries.lengths.tolist()):
        use = used_dimensions(queries, examples, np.full(len(every), i), every)
        for j in np.flatnonzero(is_feasible(n, examples.lengths, spec)):
            x, y = queries.values[i, :n], examples.values[j, : examples.lengths[j]]
            out[i, j] = reference.reference_distance(x, y, spec, use[j], _recursion())
    return out


def compare(kernel: DistanceKernel, case: Case, expected: np.ndarray | None = None) -> int:
    """Hold a kernel to the reference; returns how many pairs were compared.

    Pairs without a path in the band are compared with nothing, and are not passed to the kernel
    together with others: the caller of a kernel has refused them before.
    """
    if not kernel.supports(case.spec):
        return 0
    expected = reference_table(case) if expected is None else expected
    relative, absolute = TOLERANCE[case.queries.values.dtype]
    compared = 0
    for rows, columns in _feasible_blocks(expected):
        chosen = subset(case.queries, rows), subset(case.examples, columns)
        got = np.asarray(kernel.distances(kernel.prepare(chosen[1], case.spec), chosen[0]))
        wanted = expected[np.ix_(rows, columns)]
        assert got.shape == wanted.shape, f"shape {got.shape}, expected {wanted.shape}"
        assert not np.isnan(got).any(), f"NaN under {case.spec}"
        np.testing.assert_allclose(got, wanted, relative, absolute, err_msg=str(case.spec))
        compared += got.size
    return compared


def _feasible_blocks(expected: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows and columns of blocks without NaN that together hold every number."""
    patterns, group = np.unique(np.isnan(expected), axis=0, return_inverse=True)
    for index, pattern in enumerate(patterns):
        if not pattern.all():
            yield np.flatnonzero(group.reshape(-1) == index), np.flatnonzero(~pattern)


def specifications() -> Iterator[DtwSpec]:
    """Specifications that between them use every choice, and those of all presets."""
    yield DtwSpec()
    yield DtwSpec(mode="dependent", reduce="sum")
    yield DtwSpec(cost="squared", root=True, reduce="sum")
    yield DtwSpec(mode="dependent", cost="euclidean", length_norm=True)
    yield DtwSpec(mode="dependent", cost="squared", weights=(0.5, 0.0, 2.0), window=0.3)
    yield DtwSpec(cost="euclidean", weights=(1.0, 3.0, 0.25), window=4, reduce="sum")
    yield DtwSpec(shape="itakura", max_slope=3.0)
    yield DtwSpec(mask=BandMask.of(np.abs(np.subtract.outer(np.arange(9), np.arange(9))) < 4))
    yield DtwSpec(mode="dependent", mask=BandMask.of(_ring(9)))
    yield DtwSpec(gamma=1.0, cost="squared")
    yield DtwSpec(gamma=1e-3, mode="dependent", reduce="sum")
    yield DtwSpec(gamma=10.0, mode="dependent", cost="euclidean", window=0.5, length_norm=True)
    yield from _preset_specifications()


def _preset_specifications() -> Iterator[DtwSpec]:
    for name in presets():
        yield load_settings(name, environment={}).dtw


def _plain_specifications() -> Iterator[DtwSpec]:
    """Hard warping without a band or norm, in every form."""
    for mode, cost, reduce, root in product(
        ("dependent", "independent"), ("absolute", "squared", "euclidean"), ("sum", "mean"), (False, True)
    ):
        yield DtwSpec(mode=mode, cost=cost, reduce=reduce, root=root)  # type: ignore[arg-type]


def _supported(kernel: DistanceKernel, preferred: Iterable[DtwSpec]) -> list[DtwSpec]:
    """What the kernel supports of the preferred specifications, or of the plain ones if of them nothing."""
    return [spec for spec in preferred if kernel.supports(spec)] or [
        spec for spec in _plain_specifications() if kernel.supports(spec)
    ]


def _ring(size: int) -> np.ndarray:
    """A band with a hole in its middle."""
    distance = np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
    middle = np.zeros((size, size), bool)
    middle[3:-3, 3:-3] = True
    return (distance < 4) & ~middle


def check_reference(kernel: DistanceKernel) -> None:
    """Agrees with the float64 reference, in float64 and float32, under every choice of `DtwSpec`."""
    if isinstance(kernel, ApproximateKernel):
        return
    chosen = _supported(kernel, specifications())
    assert chosen, "supports none of the specifications of this suite: use `compare` under its own"
    for seed, spec in enumerate(chosen):
        for dtype in (np.float64, np.float32):
            rng = np.random.default_rng(seed)
            case = Case(draw_batch(rng, 6, 17, 3, dtype), draw_batch(rng, 7, 21, 3, dtype), spec)
            assert compare(kernel, case) > 0, f"nothing was compared under {spec}"


def _plainest(kernel: DistanceKernel) -> list[DtwSpec]:
    """What the kernel supports of specifications under which frames of one channel are their cost apart."""
    modes = (DtwSpec(), DtwSpec(mode="dependent"), DtwSpec(mode="dependent", reduce="sum"))
    return _supported(kernel, (*modes, *_preset_specifications()))


def check_single_frames(kernel: DistanceKernel) -> None:
    """Series of one frame cost what their frames cost, to the last bit."""
    values = np.array([[[0.25]], [[-1.5]], [[3.0]]])
    every = np.ones((3, 1), bool)
    batch = SignalBatch(values, np.ones(3, np.int64), every, every)
    difference = np.abs(values[:, 0] - values[:, 0].T)
    for spec in _plainest(kernel):
        expected = difference**2 if spec.cost == "squared" else difference
        expected = expected / 2 if spec.length_norm else expected
        expected = np.sqrt(expected) if spec.root else expected
        np.testing.assert_array_equal(kernel.distances(kernel.prepare(batch, spec), batch), expected)


def check_nothing_in_common(kernel: DistanceKernel) -> None:
    """A pair without a common dimension is infinitely far apart; other pairs do not notice."""
    batch = draw_batch(np.random.default_rng(3), 4, 9, 2, masked=False)
    other = SignalBatch(batch.values, batch.lengths, batch.masks, batch.present.copy())
    other.present[1] = False
    for spec in _plainest(kernel):
        got = kernel.distances(kernel.prepare(other, spec), batch)
        assert np.isinf(got[:, 1]).all() and np.isfinite(np.delete(got, 1, axis=1)).all()


def check_bits(kernel: DistanceKernel) -> None:
    """A pair has the same bits alone, in any order, among others, and with more padding."""
    if isinstance(kernel, ApproximateKernel):
        return
    specs = (
        DtwSpec(),
        DtwSpec(mode="dependent", cost="euclidean", window=1.0),
        DtwSpec(gamma=0.5, cost="squared", reduce="sum"),
    )
    for spec in _supported(kernel, specs):
        for dtype in (np.float32, np.float64):
            rng = np.random.default_rng(5)
            queries, examples = draw_batch(rng, 5, 30, 3, dtype), draw_batch(rng, 70, 41, 3, dtype)
            whole = kernel.distances(kernel.prepare(examples, spec), queries)
            order = rng.permutation(70)
            turned = kernel.distances(kernel.prepare(subset(examples, order), spec), queries)
            np.testing.assert_array_equal(turned, whole[:, order], err_msg=f"order, {spec}")
            one = kernel.distances(
                kernel.prepare(subset(examples, order[:1]), spec), subset(queries, np.array([2]))
            )
            np.testing.assert_array_equal(one, whole[2:3, order[:1]], err_msg=f"alone, {spec}")
            wide = SignalBatch(
                np.pad(examples.values, ((0, 0), (0, 50), (0, 0))),
                examples.lengths,
                examples.masks,
                examples.present,
            )
            padded = kernel.distances(kernel.prepare(wide, spec), queries)
            np.testing.assert_array_equal(padded, whole, err_msg=f"padding, {spec}")


def check_pairs(kernel: DistanceKernel) -> None:
    """Where a kernel computes chosen pairs, they have the bits of the table, unless they may be abandoned."""
    if not isinstance(kernel, PairKernel | SearchKernel):
        return
    rng = np.random.default_rng(8)
    queries, examples = draw_batch(rng, 6, 25, 3), draw_batch(rng, 40, 25, 3)
    qi, ei = rng.integers(0, 6, 100), rng.integers(0, 40, 100)
    specs = (DtwSpec(), DtwSpec(mode="dependent", cost="euclidean", root=True, length_norm=True))
    for spec in _supported(kernel, specs):
        state = kernel.prepare(examples, spec)
        whole = np.asarray(kernel.distances(state, queries))
        wanted = whole[qi, ei]
        if isinstance(kernel, PairKernel):
            np.testing.assert_array_equal(kernel.pairs(state, queries, qi, ei), wanted, err_msg=str(spec))
            nothing = kernel.pairs(state, queries, qi[:0], ei[:0])
            assert np.shape(nothing) == (0,), f"no pairs give shape {np.shape(nothing)}"
        if isinstance(kernel, SearchKernel):
            limits = np.median(whole, axis=1)
            got = np.asarray(kernel.within(state, queries, qi, ei, limits))
            kept = (wanted <= limits[qi]) | np.isfinite(got)
            np.testing.assert_array_equal(got[kept], wanted[kept], err_msg=str(spec))
            assert np.isposinf(got[~kept]).all(), f"an abandoned pair is not infinite under {spec}"


def check_lower_bound(kernel: DistanceKernel) -> None:
    """Where a kernel computes LB_Keogh, it agrees with the definition."""
    if not isinstance(kernel, SearchKernel):
        return
    rng = np.random.default_rng(9)
    query, middle = rng.normal(size=(3, 17)), rng.normal(size=(5, 3, 17))
    lower, upper = middle - rng.random(middle.shape), middle + rng.random(middle.shape)
    for squared in (False, True):
        wanted = search.keogh(query, lower, upper, squared)
        np.testing.assert_allclose(kernel.keogh(query, lower, upper, squared), wanted, 1e-12, 1e-12)


def check_subsequences(kernel: DistanceKernel) -> None:
    """Where a kernel finds examples inside a stream, it agrees with the reference, in any blocks."""
    if not isinstance(kernel, SubsequenceKernel):
        return
    rng = np.random.default_rng(10)
    stream = rng.normal(size=(50, 3)).astype(np.float32)
    examples = [rng.normal(size=(m, 3)).astype(np.float32) for m in (1, 2, 9, 16)]
    distances, lengths = kernel.subsequences(examples, 0.05).push(stream)
    for column, example in enumerate(examples):
        wanted, spans = reference_subsequences(stream, example, 0.05)
        np.testing.assert_allclose(distances[:, column], wanted, 1e-4, 1e-6)
        np.testing.assert_array_equal(lengths[:, column], spans, "frames of the best subsequences")
    state = kernel.subsequences(examples, 0.05)
    parts = [state.push(block) for block in np.split(stream, [1, 1, 4, 30])]
    for index, whole in enumerate((distances, lengths)):
        got = np.concatenate([part[index] for part in parts])
        np.testing.assert_array_equal(got, whole, "other bits in other blocks")


def check_gradients(kernel: DistanceKernel) -> None:
    """Where a kernel computes soft gradients, they agree with finite differences of the reference."""
    if not isinstance(kernel, GradientKernel) or isinstance(kernel, ApproximateKernel):
        return
    for mode, cost in (("independent", "squared"), ("dependent", "euclidean"), ("dependent", "absolute")):
        spec = DtwSpec(mode=mode, cost=cost, gamma=0.5, window=0.8, weights=(1.0, 2.0))  # type: ignore[arg-type]
        rng = np.random.default_rng(2)
        case = Case(_of_lengths(rng, (5, 6)), _of_lengths(rng, (6, 4, 5)), spec)
        weights = rng.normal(size=(2, 3))
        _, *slopes = kernel.gradients(kernel.prepare(case.examples, spec), case.queries, weights)
        for side, slope in enumerate(slopes):
            for index in [(0, 0, 0), (1, 3, 1), (1, 2, 0), (0, 4, 1)]:
                wanted = _slope(case, weights, side, index)
                assert abs(slope[index] - wanted) < 1e-6, f"{spec}: {slope[index]}, expected {wanted}"
    # Long series and a small softness in float32: what cancels in accumulated costs shows here.
    spec = DtwSpec(mode="dependent", cost="squared", reduce="sum", gamma=0.01)
    if not kernel.supports(spec):
        return
    every = np.ones((1, 2), bool)
    walks = [np.cumsum(np.random.default_rng(n).normal(size=(1, n, 2)), axis=1) for n in (200, 220)]
    queries, examples = (
        SignalBatch(walk.astype(np.float32), np.array([walk.shape[1]]), every, every) for walk in walks
    )
    exact = [SignalBatch(b.values.astype(np.float64), b.lengths, every, every) for b in (queries, examples)]
    case = Case(exact[0], exact[1], spec)
    _, *slopes = kernel.gradients(kernel.prepare(examples, spec), queries, np.ones((1, 1)))
    for side, slope in enumerate(slopes):
        largest = np.unravel_index(np.abs(slope).argmax(), slope.shape)
        for index in [largest, (0, 0, 0), (0, 57, 1), (0, 121, 0), (0, 199, 1)]:
            wanted = _slope(case, np.ones((1, 1)), side, index)
            error = abs(slope[index] - wanted) / np.abs(slope).max()
            assert error < 1e-5, f"{spec}, float32: {slope[index]}, expected {wanted}"


def _slope(case: Case, weights: np.ndarray, side: int, index: tuple[int, ...]) -> float:
    """A finite difference: how much one value of the queries (0) or examples (1) moves the weighted sum."""
    values, step, sums = (case.queries, case.examples)[side].values, 1e-5, []
    kept = values[index]
    for sign in (1, -1):
        values[index] = kept + sign * step
        sums.append(float((reference_table(case) * weights).sum()))
    values[index] = kept
    return (sums[0] - sums[1]) / (2 * step)


def _of_lengths(rng: np.random.Generator, lengths: tuple[int, ...]) -> SignalBatch:
    every = np.ones((len(lengths), 2), bool)
    values = rng.normal(size=(len(lengths), max(lengths), 2))
    beyond = np.arange(max(lengths))[None, :] >= np.array(lengths)[:, None]
    values[beyond] = 0
    return SignalBatch(values, np.array(lengths), every, every)


KERNEL_CHECKS: tuple[Callable[[DistanceKernel], None], ...] = (
    check_reference,
    check_single_frames,
    check_nothing_in_common,
    check_bits,
    check_pairs,
    check_lower_bound,
    check_subsequences,
    check_gradients,
)
"""The conformance suite; each takes a kernel and raises `AssertionError`."""
