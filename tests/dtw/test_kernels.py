"""Every exact kernel against the reference over drawn pairs, and the choice among them."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gesture_core.dtw.batches import make_batches
from gesture_core.dtw.distances import SMALL, cells_of, choose_kernel, warping_distances
from gesture_core.dtw.spec import DtwSpec
from gesture_core.errors import ConfigError, InputError, PluginError
from gesture_core.plugin import registry
from gesture_core.plugin.abilities import ApproximateKernel
from gesture_core.testing import Case, compare, draw_batch, reference_table

KERNELS = [
    name
    for name in registry().names("kernel", usable=True)
    if not isinstance(registry().make("kernel", name), ApproximateKernel)
]
SIZES = ((300, 1, 10), (90, 2, 26), (16, 36, 30), (40, 3, 34))
"""Longest series, dimensions, and series on each side of an example."""
CASES = {False: (7, 2_000), True: (18, 10_000)}
"""How many cases, and at least how many pairs in them, a plain and a thorough suite compare."""


@st.composite
def cases(draw: st.DrawFn) -> Case:
    longest, width, count = draw(st.sampled_from(SIZES))
    band: dict[str, Any] = draw(
        st.sampled_from(
            [{}, {}, {"window": 0.2}, {"window": 0.5}, {"window": 12}, {"shape": "itakura", "max_slope": 2.5}]
        )
    )
    gamma = draw(st.sampled_from([None, None, 1e-3, 0.1, 1.0, 10.0]))
    spec = DtwSpec(
        mode=draw(st.sampled_from(["independent", "dependent"])),
        cost=draw(st.sampled_from(["absolute", "squared", "euclidean"])),
        reduce=draw(st.sampled_from(["sum", "mean"])),
        root=gamma is None and draw(st.booleans()),
        length_norm=draw(st.booleans()),
        gamma=gamma,
        **band,
    )
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    dtype = draw(st.sampled_from([np.float32, np.float64]))
    queries, examples = (draw_batch(rng, count, longest, width, dtype) for _ in range(2))
    return Case(queries, examples, spec)


@cache
def drawn_cases(thorough: bool) -> list[tuple[Case, np.ndarray]]:
    """The cases and what the reference computes for them, once for all kernels."""
    found: list[tuple[Case, np.ndarray]] = []

    @settings(
        max_examples=CASES[thorough][0],
        deadline=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
    )
    @given(cases())
    def draw(case: Case) -> None:
        found.append((case, reference_table(case)))

    draw()
    return found


@pytest.mark.timeout(900)  # mostly compilation, which a busy machine draws out
@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_agrees_with_the_reference_on_drawn_pairs(name: str, thorough: bool) -> None:
    kernel = registry().make("kernel", name)
    compared = sum(compare(kernel, case, expected) for case, expected in drawn_cases(thorough))
    assert compared >= CASES[thorough][1]


def test_auto_takes_the_fastest_that_supports_the_specification() -> None:
    name, _ = choose_kernel("auto", DtwSpec())
    assert name in registry().names("kernel", usable=True)
    assert name != "fastdtw"
    holes = np.ones((5, 5), bool)
    holes[2, 1:4] = False
    assert choose_kernel("auto", DtwSpec(mask=holes))[0] == "numpy"  # type: ignore[arg-type]  # an array becomes a mask
    with pytest.raises(PluginError, match="does not compute"):
        choose_kernel("jax", DtwSpec(mask=holes))  # type: ignore[arg-type]  # an array becomes a mask
    with pytest.raises(PluginError, match="did you mean numpy"):
        choose_kernel("nunpy", DtwSpec())


@pytest.mark.parametrize(
    ("queries", "message"),
    [
        ([np.zeros((3, 2)), np.array([[0, 1], [np.nan, 0]])], "query 1 holds NaN or infinity at frame 1"),
        ([np.array([[np.inf, 0.0]])], "query 0 holds NaN or infinity at frame 0"),
        ([np.zeros((0, 2))], "query 0 has shape"),
        ([], "no query"),
        ([np.zeros((3, 3))], "queries have 3 dimensions, examples 2"),
        ([[[0.0, 1.0], [2.0]]], "query 0 is no array of numbers"),
        ([np.ma.masked_equal(np.array([[0.0, 1], [7, 0]]), 7)], "query 0 has masked values"),
        ([np.full((3, 2), 1e10, np.float32)], "query 0 reaches 1e\\+10"),
    ],
)
def test_wrong_input_is_refused_at_the_boundary(queries: list[np.ndarray], message: str) -> None:
    with pytest.raises(InputError, match=message):
        warping_distances(queries, [np.zeros((4, 2), np.float32)])


def test_an_infeasible_band_names_the_pair() -> None:
    queries, examples = [np.zeros(5), np.zeros(30)], [np.zeros(30), np.zeros(30)]
    with pytest.raises(InputError, match=r"query 0 \(5 frames\) and example 0 \(30 frames\)"):
        warping_distances(queries, examples, DtwSpec(window=0))


def test_precision_follows_the_series() -> None:
    single, double = [np.zeros((3, 1), np.float32)], [np.zeros((3, 1))]
    assert warping_distances(single, single).dtype == np.float32
    assert warping_distances(single, double).dtype == np.float64


def test_a_system_that_tells_no_affinity(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    pytest.importorskip("numba")
    assert warping_distances([np.zeros(3)] * 20, [np.ones(3)], kernel="numba").tolist() == [[3.0]] * 20


def test_a_few_short_series_wait_for_no_compiler() -> None:
    code = (
        "import sys\nimport numpy as np\nfrom gesture_core.dtw import warping_distance, soft_warping\n"
        "rise = np.linspace(0, 1, 60)\n"
        "print(warping_distance(rise, rise[::2]), soft_warping([rise], [rise]))\n"
        "print([name for name in ('numba', 'jax', 'torch') if name in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == "[]" and not found.stderr


def test_which_kernel_is_automatic_is_a_matter_of_size_alone() -> None:
    assert choose_kernel("auto", DtwSpec(), cells=SMALL)[0] == "numpy"
    assert choose_kernel("auto", DtwSpec(), cells=SMALL + 1)[0] == choose_kernel("auto", DtwSpec())[0]
    series = [np.random.default_rng(0).normal(size=(60, 3)) for _ in range(2)]
    assert cells_of(*make_batches(series, series, DtwSpec())) == 120 * 120 * 3 <= SMALL


def test_options_of_what_is_no_plugin_are_refused() -> None:
    series = [np.zeros(3)]
    assert warping_distances(series, series, options={"numba": {"threads": 1}, "gaussian": {"sigma": 2}}) == 0
    with pytest.raises(ConfigError, match=r"E_OPTION options.*nmuba.*did you mean"):
        warping_distances(series, series, options={"nmuba": {"threads": 1}})


@pytest.mark.parametrize("radius", [0, 1.5])
def test_a_radius_is_a_whole_number_of_cells(radius: float) -> None:
    with pytest.raises(ConfigError, match="radius = "):
        warping_distances(
            [np.zeros(3)], [np.zeros(3)], kernel="fastdtw", options={"fastdtw": {"radius": radius}}
        )


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="folder permissions")
def test_compiled_code_runs_where_no_folder_can_be_written(tmp_path: Path) -> None:
    pytest.importorskip("numba")
    code = (
        "import numba.core.caching as c\n"
        "c.CacheImpl._locator_classes = []\n"
        "import numpy as np; from gesture_core import warping_distances\n"
        "print(warping_distances([np.zeros(3)], [np.ones(3)], kernel='numba')[0, 0])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.strip() == "3.0", done.stderr
