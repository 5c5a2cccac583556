"""benchmarks/choose.py, which chooses the preset's weights, sees the distances that the product computes."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from swings import pose, swing

from gesture_core.classify.comparison import compare
from gesture_core.settings import load_settings
from gesture_core.signals.chain import Chain
from gesture_core.skeletons import COCO18

pytest.importorskip("torch")
LEGS = [COCO18.index(f"{side}_{joint}") for side in ("right", "left") for joint in ("knee", "ankle")]


@pytest.fixture(scope="module")
def choose() -> Iterator[ModuleType]:
    folder = Path(__file__).resolve().parents[2] / "benchmarks"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        spec = importlib.util.spec_from_file_location("benchmark_choose", folder / "choose.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        patch.setitem(sys.modules, module.__name__, module)  # dataclasses look their module up
        spec.loader.exec_module(module)
        yield module


@pytest.mark.parametrize("missing", [(), LEGS, [COCO18.index("left_wrist")]])
def test_a_choice_has_the_distances_of_the_product(choose: ModuleType, missing: list[int]) -> None:
    items = []
    for number, (joint, axis) in enumerate((("right_wrist", 0), ("left_wrist", 1), ("right_wrist", 1)) * 3):
        points = swing(joint, axis, 1.0 + 0.1 * number, 20 + number)
        points[:, LEGS] += swing("right_knee", 0, 1.0 + 0.1 * number, 20 + number)[:, [LEGS[0]]] / 4
        found = pose(points)
        if number in (1, 4):
            points = found.keypoints.copy()
            points[:, list(missing)] = np.nan
            found = replace(found, keypoints=points)
        items.append(choose.Item(found, joint, f"s{number % 2}", f"clip{number}"))
    modern = load_settings("modern", environment={})
    weights = modern.options["parts"]["weights"]
    problem = choose.load("swings", lambda: items, "numpy", None)
    amounts = np.array([weights.get(term, 0.0) for term in choose.TERMS], np.float32)
    rest = 0.01
    choice = choose.Choice(amounts, modern.classify.mirror, rest, 0.0)
    size = np.median(amounts @ problem.sizes) / np.median(problem.frames)
    settings = replace(modern, classify=replace(modern.classify, kernel="numpy", rest=float(rest * size)))
    chain = Chain.from_settings(settings)
    signals = [chain(item.pose) for item in items]
    expected = compare(signals, signals, settings)
    np.testing.assert_allclose(choice.distances(problem), expected, rtol=1e-3, atol=1e-5)
    assert problem.whole == (not missing)
