"""Examples inside a stream: every kernel against the reference, in whatever blocks the frames come."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from gesture_core.dtw.subsequence import choose_subsequence_kernel, reference_subsequences
from gesture_core.errors import InputError, PluginError
from gesture_core.plugin.abilities import SubsequenceKernel

KERNELS = ("numpy", "numba", "jax", "torch")
LENGTHS = (1, 2, 3, 7, 20)
FLOOR = 0.05


def kernel(name: str) -> SubsequenceKernel:
    pytest.importorskip(name)
    return choose_subsequence_kernel(name)[1]


def drawn(seed: int, frames: int = 70, width: int = 5) -> tuple[np.ndarray, list[np.ndarray]]:
    rng = np.random.default_rng(seed)
    stream = rng.normal(size=(frames, width)).astype(np.float32)
    return stream, [rng.normal(size=(m, width)).astype(np.float32) for m in LENGTHS]


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("seed", range(3))
def test_kernels_meet_the_reference(name: str, seed: int) -> None:
    stream, examples = drawn(seed)
    distances, lengths = kernel(name).subsequences(examples, FLOOR).push(stream)
    for column, example in enumerate(examples):
        expected, spans = reference_subsequences(stream, example, FLOOR)
        np.testing.assert_allclose(distances[:, column], expected, rtol=1e-4)
        np.testing.assert_array_equal(lengths[:, column], spans)


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("width", [1, 4, 36])
def test_blocks_make_no_difference(name: str, width: int) -> None:
    stream, examples = drawn(3, 200, width)
    wide = np.asfortranarray(stream)
    whole = kernel(name).subsequences(examples, FLOOR).push(wide)
    state = kernel(name).subsequences(examples, FLOOR)
    cuts = [0, 1, 2, 9, 9, 10, 60, 200]
    parts = [state.push(stream[a:b]) for a, b in pairwise(cuts)]
    for index in range(2):
        np.testing.assert_array_equal(np.concatenate([part[index] for part in parts]), whole[index])


@pytest.mark.parametrize("name", KERNELS)
def test_an_example_is_found_where_it_is_performed_at_any_tempo(name: str) -> None:
    rng = np.random.default_rng(0)
    example = np.cumsum(rng.normal(size=(30, 4)), axis=0).astype(np.float32)
    for tempo in (0.6, 1.0, 1.8):
        frames = round(30 * tempo)
        places = np.linspace(0, 29, frames)
        performed = np.stack([np.interp(places, np.arange(30), c) for c in example.T], axis=1)
        rest = np.repeat(example[:1], 40, axis=0), np.repeat(example[-1:], 40, axis=0)
        stream = np.concatenate([rest[0], performed.astype(np.float32), rest[1]])
        distances, lengths = kernel(name).subsequences([example], FLOOR).push(stream)
        end = int(distances[:, 0].argmin())
        assert abs(end - (39 + frames)) <= 3
        assert abs(int(lengths[end, 0]) - frames) <= 4
        assert distances[end, 0] < 0.1


def test_a_subsequence_lasts_from_half_to_twice_the_example() -> None:
    stream, examples = drawn(5, 300)
    _, lengths = kernel("numpy").subsequences(examples, FLOOR).push(stream)
    for column, m in enumerate(LENGTHS):
        reached = lengths[lengths[:, column] > 0, column]
        assert reached.min() >= m / 2 and reached.max() <= 2 * m


def test_many_examples_in_many_chunks_are_those_alone() -> None:
    rng = np.random.default_rng(1)
    stream = rng.normal(size=(50, 8)).astype(np.float32)
    examples = [rng.normal(size=(m, 8)).astype(np.float32) for m in rng.integers(1, 90, 60)]
    together = kernel("numba").subsequences(examples, FLOOR).push(stream)
    for number in (0, 17, 59):
        alone = kernel("numba").subsequences([examples[number]], FLOOR).push(stream)
        np.testing.assert_array_equal(together[0][:, number], alone[0][:, 0])
        np.testing.assert_array_equal(together[1][:, number], alone[1][:, 0])


def test_what_cannot_be_looked_for_is_refused() -> None:
    numpy = kernel("numpy")
    with pytest.raises(InputError, match="no example"):
        numpy.subsequences([], FLOOR)
    with pytest.raises(InputError, match="example 1"):
        numpy.subsequences([np.zeros((3, 2)), np.zeros((3, 1))], FLOOR)
    with pytest.raises(InputError, match="NaN"):
        numpy.subsequences([np.full((3, 2), np.nan)], FLOOR)
    with pytest.raises(InputError, match="shape"):
        numpy.subsequences([np.zeros((3, 2))], FLOOR).push(np.zeros((4, 3)))
    with pytest.raises(PluginError, match="fastdtw"):
        choose_subsequence_kernel("fastdtw")
