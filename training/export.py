"""The trained network to ONNX: norms folded, paddings explicit, two bytes a weight, checked against torch."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from gesture_core.errors import ModelError

from .network import Compact

if TYPE_CHECKING:
    import onnx

OPSET = 13
LARGEST = 4 * 1024 * 1024
FEW = 256  # values of a tensor that is not worth a conversion


def halve(model: onnx.ModelProto) -> None:
    """Store the weights as float16, in place: half the file; a Cast makes them float32 again at loading.

    onnxruntime and cv2 both fold the Cast away, so that what runs is float32 throughout.
    """
    from onnx import TensorProto, helper, numpy_helper

    graph, casts = model.graph, []
    for tensor in list(graph.initializer):
        values = numpy_helper.to_array(tensor)
        if values.dtype != np.float32 or values.size < FEW:
            continue
        graph.initializer.remove(tensor)
        half = f"{tensor.name}.half"
        graph.initializer.append(numpy_helper.from_array(values.astype(np.float16), half))
        casts.append(helper.make_node("Cast", [half], [tensor.name], to=TensorProto.FLOAT))
    rest = list(graph.node)
    del graph.node[:]
    graph.node.extend([*casts, *rest])


def export(model: Compact, path: Path, size: int = 192) -> str:
    """Write ``path``; returns its SHA-256.

    The batch is free, height and width are fixed: cv2 up to 4.14 infers neither reliably where the
    graph resizes, and a fixed size is what both backends feed anyway.

    Raises
    ------
    ModelError
        Where the file is larger than 4 MB, or onnxruntime disagrees with torch by 0.001 before and 0.01
        after the rounding of the weights.
    """
    import onnx

    model = model.eval()
    example = torch.rand(2, 3, size, size) * 255
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.onnx.export(
        model,
        (example,),
        str(path),
        dynamo=False,
        opset_version=OPSET,
        input_names=["image"],
        output_names=["maps"],
        dynamic_axes={"image": {0: "batch"}, "maps": {0: "batch"}},
    )
    with torch.no_grad():
        expected = model(example).numpy()
    whole = onnx.load(str(path))
    _check(whole, example.numpy(), expected, 1e-3, path)
    halve(whole)
    data = _check(whole, example.numpy(), expected, 1e-2, path)
    path.write_bytes(data)
    if len(data) > LARGEST:
        raise ModelError(f"{len(data)} bytes, at most {LARGEST}", subject=str(path), code="E_MODEL_SIZE")
    return hashlib.sha256(data).hexdigest()


def _check(
    model: onnx.ModelProto, example: np.ndarray, expected: np.ndarray, tolerance: float, path: Path
) -> bytes:
    """The file's bytes, of which onnxruntime makes the ``expected`` maps to within ``tolerance``."""
    import onnx
    import onnxruntime

    onnx.checker.check_model(model)
    data: bytes = model.SerializeToString()
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    apart = float(np.abs(session.run(None, {"image": example})[0] - expected).max())
    if apart > tolerance:
        raise ModelError(f"onnxruntime differs from torch by {apart:.2g}", subject=str(path), code="E_MODEL")
    return data
