"""`compact-int8`: the trained network with whole numbers of eight bits where they cost no accuracy.

What stays in float32: the first block, whose few channels have ranges that differ most; the last convolution,
whose heat maps are compared by hundredths; and whether anybody is there. Weights have seven bits: with eight,
a processor without instructions for such sums (VNNI) clips them, and would see other joints than one that
has them.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gesture_core.pose.models import find_model
from gesture_core.pose.network import Letterbox, to_batch

from .presence import OWN, SOURCES
from .windows import Track, drawn, photographed

FLOAT = (OWN, "/Sub", "/Mul", "/stem", "/stride4", "/head/head.1", "/ReduceMax", "/Concat")
"""What the names of nodes that stay in float32 begin with."""
PICTURES, FEW = 400, 6
"""By whose features the ranges are set: windows of the pictures of the training, and drawings of nobody; the
most files of a collection, and drawings of a kind."""


def quantise(network: Path, target: Path, pictures: np.ndarray) -> str:
    """Write ``target``; returns its SHA-256.

    Parameters
    ----------
    network : Path
        `compact`.
    target : Path
    pictures : (N, 3, H, W) uint8
        As the network takes them: of nobody on whom it is judged.
    """
    import onnx
    import onnxruntime
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

    class Pictures(CalibrationDataReader):  # type: ignore[misc]
        def __init__(self) -> None:
            self._left: Iterator[np.ndarray] = iter(pictures)

        def get_next(self) -> dict[str, np.ndarray] | None:
            picture = next(self._left, None)
            return None if picture is None else {"image": picture[None].astype(np.float32)}

    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder, "plain.onnx")  # its weights in float32, and no Cast before them
        options = onnxruntime.SessionOptions()
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
        options.optimized_model_filepath = str(plain)
        onnxruntime.InferenceSession(str(network), options, providers=["CPUExecutionProvider"])
        quantize_static(
            str(plain),
            str(target),
            Pictures(),
            quant_format=QuantFormat.QDQ,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            per_channel=True,
            reduce_range=True,
            nodes_to_exclude=[
                node.name for node in onnx.load(str(plain)).graph.node if node.name.startswith(FLOAT)
            ],
        )
    return hashlib.sha256(target.read_bytes()).hexdigest()


def calibration(shared: Path, seed: int, track: Track) -> np.ndarray:
    """`PICTURES` windows (N, 3, H, W) for `quantise`."""
    from gesture_core.plugin import registry

    backend = registry().make("pose", "onnx", {"threads": 1, "presence": 0.0}, model=find_model("compact"))
    found = []
    for name in SOURCES:
        folder = shared / "data" / name
        windows = (
            drawn(seed, track, FEW) if name == "drawn" else photographed(folder, backend, seed, track, FEW)
        )
        for window in windows:
            high, wide = window.picture.shape[:2]
            box = Letterbox.fit((wide, high), backend.contract.input_size)
            found.append(to_batch([window.picture], box, backend.contract)[0].astype(np.uint8))
    chosen = np.random.default_rng(seed).permutation(len(found))[:PICTURES]
    return np.stack([found[i] for i in chosen])
