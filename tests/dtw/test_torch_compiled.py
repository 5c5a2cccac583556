"""The compiled form of the Torch kernel: the same distances, and a word where nothing can be compiled."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest
from test_kernels import CASES, drawn_cases

from gesture_core.plugin import registry
from gesture_core.testing import KERNEL_CHECKS, compare

pytest.importorskip("torch")
pytestmark = [
    pytest.mark.timeout(900),  # mostly compilation, which a busy machine draws out
    pytest.mark.skipif(not shutil.which("g++"), reason="Torch compiles with g++, which is not installed"),
]


def test_the_compiled_form_agrees_with_the_reference_on_drawn_pairs(thorough: bool) -> None:
    kernel = registry().make("kernel", "torch", {"compiled": True})
    compared = sum(compare(kernel, case, expected) for case, expected in drawn_cases(thorough))
    assert compared >= CASES[thorough][1]


def test_the_compiled_form_passes_the_conformance_suite() -> None:
    kernel = registry().make("kernel", "torch", {"compiled": True})
    for check in KERNEL_CHECKS:
        check(kernel)


def test_a_machine_without_compiler_is_told_so(tmp_path: os.PathLike[str]) -> None:
    code = (
        "import numpy as np\n"
        "from gesture_core.plugin import registry\n"
        "from gesture_core.dtw.distances import warping_distances\n"
        "kernel = registry().make('kernel', 'torch', {'compiled': True})\n"
        "from gesture_core.testing import draw_batch\n"
        "from gesture_core.dtw.spec import DtwSpec\n"
        "batch = draw_batch(np.random.default_rng(0), 2, 5, 2)\n"
        "kernel.distances(kernel.prepare(batch, DtwSpec()), batch)\n"
    )
    environment = {**os.environ, "CXX": "/nowhere/c++", "TORCHINDUCTOR_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 1
    assert "E_MISSING_DEPENDENCY torch: Torch cannot compile here" in done.stderr
    assert "install a C++ compiler" in done.stderr
