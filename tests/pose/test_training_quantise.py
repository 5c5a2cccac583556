"""The network of eight bits: which parts are, what they hold, and that it sees what the whole one sees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

for _module in ("torch", "onnx", "onnxruntime", "cv2"):
    pytest.importorskip(_module, reason=f"the training needs {_module}: pip install 'gesture-core[train]'")

import onnx  # noqa: E402
import onnxruntime  # noqa: E402
from onnx import numpy_helper  # noqa: E402

from training.__main__ import PACKAGED  # noqa: E402
from training.quantise import FLOAT, quantise  # noqa: E402


def answers(path: Path, pictures: np.ndarray) -> list[np.ndarray]:
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    found: list[np.ndarray] = session.run(None, {"image": pictures.astype(np.float32)})
    return found


def test_a_quantised_network_clips_nowhere_and_keeps_its_ends_in_float(tmp_path: Path) -> None:
    pictures = np.random.default_rng(1).integers(0, 255, (3, 3, 192, 192)).astype(np.uint8)
    target = tmp_path / "small.onnx"
    quantise(PACKAGED, target, pictures)
    graph = onnx.load(str(target)).graph
    values = {one.name: numpy_helper.to_array(one) for one in graph.initializer}
    eight = {name: one for name, one in values.items() if one.dtype == np.int8 and one.ndim == 4}
    assert len(eight) > 30
    # Two products with a feature of at most 255 fit into 16 bits, wherever they are added.
    assert all(np.abs(one.astype(int)).max() <= 64 for one in eight.values())
    for node in graph.node:
        if node.name.startswith(FLOAT) and node.op_type == "Conv":
            assert values.get(node.input[1], np.zeros(0, np.float32)).dtype == np.float32
    for one, two in zip(answers(PACKAGED, pictures), answers(target, pictures), strict=True):
        np.testing.assert_allclose(one, two, atol=0.1)
