"""Pose networks of a few kilobytes with the input and output layouts of real ones.

`dot_network` really sees: it finds a figure whose joints are dots of 18 different colours, so that
following, letterboxing and decoding are tested on pictures. The others give fixed or random outputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from gesture_core.skeletons import COCO18

GREY = 96
COLOURS = np.array(
    [(b, g, r) for b in (0, 128, 255) for g in (0, 128, 255) for r in (0, 128, 255)], np.float32
)[[0, 1, 2, 3, 5, 6, 7, 8, 9, 11, 15, 17, 18, 20, 21, 23, 24, 26]]
"""One colour for each COCO-18 joint, BGR, far from each other and from the grey of the background."""

FIGURE = np.array(
    [
        (0.50, 0.10), (0.50, 0.22), (0.38, 0.22), (0.32, 0.36), (0.30, 0.50), (0.62, 0.22),
        (0.68, 0.36), (0.70, 0.50), (0.42, 0.52), (0.42, 0.72), (0.42, 0.92), (0.58, 0.52),
        (0.58, 0.72), (0.58, 0.92), (0.44, 0.02), (0.56, 0.02), (0.38, 0.08), (0.62, 0.08),
    ]
)  # fmt: skip
"""COCO-18 joints of a standing figure in a unit square."""


def dot_picture(size: tuple[int, int], joints: np.ndarray, radius: int) -> np.ndarray:
    """(height, width, 3) picture of a figure with its joints (18, 2) as coloured dots, NaN left out."""
    import cv2

    picture = np.full((*size, 3), GREY, np.uint8)
    for (x, y), colour in zip(joints, COLOURS.tolist(), strict=True):
        if not np.isnan(x):
            centre = (round(16 * float(x)), round(16 * float(y)))
            cv2.circle(picture, centre, 16 * radius, colour, -1, cv2.LINE_AA, shift=4)
    return picture


def dot_network(path: Path, side: int | None = 96, stride: int = 4, fields: bool = False) -> Path:
    """A network in the OpenPose layout that sees the dots of `dot_picture`."""
    joints = len(COLOURS)
    spread = np.zeros((3 * joints, 3, 1, 1), np.float32)
    for joint in range(joints):
        spread[3 * joint : 3 * joint + 3, :, 0, 0] = np.eye(3)
    gather = np.zeros((joints, 3 * joints, 1, 1), np.float32)
    for joint in range(joints):
        gather[joint, 3 * joint : 3 * joint + 3] = -1 / 120
    outputs = joints + 1 + (38 if fields else 0)
    widen = np.zeros((outputs, joints, 1, 1), np.float32)
    widen[:joints, :, 0, 0] = 4 * np.eye(joints)
    nodes = [
        helper.make_node("Conv", ["image", "spread", "colours"], ["difference"], kernel_shape=[1, 1]),
        helper.make_node("Abs", ["difference"], ["distance"]),
        helper.make_node("Conv", ["distance", "gather", "one"], ["likeness"], kernel_shape=[1, 1]),
        helper.make_node("Relu", ["likeness"], ["dots"]),
        helper.make_node(
            "AveragePool",
            ["dots"],
            ["coarse"],
            kernel_shape=[2 * stride] * 2,
            strides=[stride] * 2,
            pads=[stride // 2] * 4,
        ),
        helper.make_node("Conv", ["coarse", "widen"], ["maps"], kernel_shape=[1, 1]),
    ]
    weights = {
        "spread": spread,
        "colours": -COLOURS.reshape(-1),
        "gather": gather,
        "one": np.ones(joints, np.float32),
        "widen": widen,
    }
    shape: list[int | str] = ["N", 3, side or "H", side or "W"]
    cells: list[int | str] = [side // stride, side // stride] if side else ["h", "w"]
    return _save(path, nodes, weights, ("image", TensorProto.FLOAT, shape), {"maps": ["N", outputs, *cells]})


def random_maps(path: Path, channels: int = 57, side: int = 64, stride: int = 8, seed: int = 0) -> Path:
    """A network whose outputs are smooth random functions of the picture."""
    random = np.random.default_rng(seed)
    first = random.normal(0, 0.02, (16, 3, 5, 5)).astype(np.float32)
    second = random.normal(0, 0.06, (channels, 16, 1, 1)).astype(np.float32)
    nodes = [
        helper.make_node("Conv", ["image", "first"], ["a"], kernel_shape=[5, 5], pads=[2, 2, 2, 2]),
        helper.make_node("Relu", ["a"], ["b"]),
        helper.make_node("AveragePool", ["b"], ["c"], kernel_shape=[stride] * 2, strides=[stride] * 2),
        helper.make_node("Conv", ["c", "second"], ["d"], kernel_shape=[1, 1]),
        helper.make_node("Sigmoid", ["d"], ["maps"]),
    ]
    shape: list[int | str] = ["N", 3, side, side]
    cells: list[int | str] = ["N", channels, side // stride, side // stride]
    weights = {"first": first, "second": second}
    return _save(path, nodes, weights, ("image", TensorProto.FLOAT, shape), {"maps": cells})


def constant(
    path: Path,
    outputs: Mapping[str, np.ndarray],
    image: Sequence[int | str] = (1, 3, 64, 64),
    kind: int = TensorProto.FLOAT,
) -> Path:
    """A network that gives ``outputs``, whatever it is shown."""
    nodes = []
    weights = {"nothing": np.zeros(1, np.float32)}
    if kind != TensorProto.FLOAT:
        nodes.append(helper.make_node("Cast", ["image"], ["pixels"], to=TensorProto.FLOAT))
    pixels = "image" if kind == TensorProto.FLOAT else "pixels"
    nodes.append(helper.make_node("ReduceMean", [pixels], ["mean"], keepdims=0))
    nodes.append(helper.make_node("Mul", ["mean", "nothing"], ["zero"]))
    for name, value in outputs.items():
        weights[f"{name}_value"] = np.asarray(value, np.float32)
        nodes.append(helper.make_node("Add", [f"{name}_value", "zero"], [name]))
    shapes = {name: list(np.shape(value)) for name, value in outputs.items()}
    return _save(path, nodes, weights, ("image", kind, list(image)), shapes)


def _save(
    path: Path,
    nodes: list[onnx.NodeProto],
    weights: Mapping[str, np.ndarray],
    image: tuple[str, int, list[int | str]],
    outputs: Mapping[str, Sequence[int | str]],
) -> Path:
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info(*image)],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, list(s)) for name, s in outputs.items()],
        [numpy_helper.from_array(value, name) for name, value in weights.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return path


assert len(COLOURS) == len(COCO18.joints)
