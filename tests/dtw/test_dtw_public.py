"""The public face of `gesture_core.dtw`: lazy, typed, and documented by examples that run."""

from __future__ import annotations

import ast
import doctest
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT

from gesture_core import dtw
from gesture_core.errors import InputError

NAMES = """BandMask DtwSpec ExampleIndex SoftGradient barycenter derivatives nearest soft_divergence
soft_warping soft_warping_gradient warping_distance warping_distances warping_path""".split()


def test_the_lazy_names_are_those_that_type_checkers_see() -> None:
    tree = ast.parse((ROOT / "gesture_core" / "dtw" / "__init__.py").read_text("utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {
        alias.name: f"{node.module}".removeprefix("gesture_core.dtw.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert typed == dtw._MODULES
    assert NAMES == dtw.__all__ == dir(dtw)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = dtw.nonsense


def test_importing_it_imports_no_numpy() -> None:
    script = "import sys, gesture_core.dtw\ndir(gesture_core.dtw)\nassert 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", script], check=True)


@pytest.mark.parametrize("name", [name for name in NAMES if name != "SoftGradient"])
def test_examples_of_docstrings_run(name: str) -> None:
    (found,) = doctest.DocTestFinder(recurse=False).find(getattr(dtw, name), name)
    assert found.examples
    assert doctest.DocTestRunner().run(found).failed == 0


def test_two_bare_arrays_are_refused_with_what_to_write_instead() -> None:
    one = np.zeros((5, 2))
    for queries, examples, named in ((one, one, "queries"), ([one], one, "examples")):
        with pytest.raises(InputError, match=rf"{named} are one array of shape \(5, 2\)") as refused:
            dtw.warping_distances(queries, examples)  # type: ignore[arg-type]
        assert "warping_distance(a, b)" in str(refused.value) and "[a], [b]" in str(refused.value)
    assert dtw.warping_distance(one, one, kernel="numpy") == 0.0
