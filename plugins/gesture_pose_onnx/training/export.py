"""The trained network to ONNX: batch norms folded, paddings explicit, checked against torch."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import torch

from gesture_core.errors import ModelError

from .network import Compact

OPSET = 13
LARGEST = 4 * 1024 * 1024


def export(model: Compact, path: Path, size: int = 192) -> str:
    """Write ``path``; returns its SHA-256.

    The batch is free, height and width are fixed: cv2 up to 4.14 infers neither reliably where the
    graph resizes, and a fixed size is what both backends feed anyway.

    Raises
    ------
    ModelError
        Where the file is larger than 4 MB or onnxruntime disagrees with torch.
    """
    import onnx
    import onnxruntime

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
    onnx.checker.check_model(onnx.load(str(path)))
    data = path.read_bytes()
    if len(data) > LARGEST:
        raise ModelError(f"{len(data)} bytes, at most {LARGEST}", subject=str(path), code="E_MODEL_SIZE")
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    with torch.no_grad():
        expected = model(example).numpy()
    got = session.run(None, {"image": example.numpy()})[0]
    apart = float(np.abs(got - expected).max())
    if apart > 1e-3:
        raise ModelError(f"onnxruntime differs from torch by {apart:.2g}", subject=str(path), code="E_MODEL")
    return hashlib.sha256(data).hexdigest()
