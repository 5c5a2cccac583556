"""Every registered kernel, the project's own and third parties', passes the conformance suite."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from conftest import ROOT

from gesture_core.dtw.spec import DtwSpec
from gesture_core.plugin import registry
from gesture_core.settings import load_settings, presets
from gesture_core.testing import KERNEL_CHECKS, Case, compare, draw_batch
from gesture_core.testing.kernels import check_nothing_in_common, check_reference, check_single_frames
from gesture_core.types import SignalBatch

KERNELS = registry().names("kernel", usable=True)


@pytest.mark.timeout(900)  # mostly compilation, which a busy machine draws out
@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("check", KERNEL_CHECKS, ids=lambda check: check.__name__)
def test_kernel(name: str, check: Callable[..., None]) -> None:
    check(registry().make("kernel", name))


def test_a_third_partys_kernel_passes_as_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "example_plugin"))
    from gesture_example.plain import PlainKernel

    kernel = PlainKernel()
    for check in KERNEL_CHECKS:
        check(kernel)
    rng = np.random.default_rng(0)
    spec = DtwSpec(mode="dependent", reduce="sum")
    assert compare(kernel, Case(draw_batch(rng, 3, 9, 2), draw_batch(rng, 4, 9, 2), spec)) == 12


def test_a_wrong_kernel_does_not_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "example_plugin"))
    from gesture_example import plain

    monkeypatch.setattr(plain, "_warp", lambda cost: float(np.trace(cost)))
    with pytest.raises(AssertionError):
        for check in KERNEL_CHECKS:
            check(plain.PlainKernel())


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
