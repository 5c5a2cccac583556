"""Reads what an ONNX file declares, without a runtime: inputs, outputs, and references to other files.

A file is checked before any runtime sees it: onnxruntime and OpenCV both follow references to external
data while they load, which would let a model file name any file of the machine. The walk follows the
wire format of protocol buffers and the field numbers of ``onnx.proto3``; weights are skipped, not read.

Why not the package ``onnx``? It builds an object of every message before anything can be checked. On a
file of 16 MiB that holds nothing but empty nodes it took 4 s and 1.2 GiB, of empty attributes 1.6 GiB: a
file of 1 GiB, as large as a model may be, would end the process that only asks for a model's name, so that
parsing would need a worker. This walk takes no memory, and a file with more than `MAX_FIELDS` fields is
refused after some seconds; the largest of seven pose networks has 7,000. Both take 10 to 20 ms for
a network of 20 MiB. The package adds 31 MB to an installation, and 0.2 s to every process that opens a
model. Neither follows external data by itself (``onnx.load_model_from_string`` reads no file).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from gesture_core.errors import ModelError
from gesture_core.pose.contract import Tensor

MAX_DEPTH = 32
MAX_FIELDS = 1_000_000
_TYPES = {1: "float32", 2: "uint8", 3: "int8", 6: "int32", 7: "int64", 10: "float16", 11: "float64"}

# Which fields hold messages that are walked: message -> {field number: message}.
_INSIDE: dict[str, dict[int, str]] = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
    "graph": {1: "node", 5: "tensor", 11: "value", 12: "value", 15: "sparse"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "value": {2: "type"},
    "type": {1: "array"},
    "array": {2: "shape"},
    "shape": {1: "dimension"},
}


@dataclass(frozen=True)
class OnnxHeader:
    """Declared inputs and outputs of a graph, without the weights that old files list as inputs."""

    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]


def read_header(data: bytes, subject: str = "") -> OnnxHeader:
    """The header of an ONNX file's bytes.

    Raises
    ------
    ModelError
        ``E_MODEL_FILE`` where the bytes are no ONNX model, ``E_MODEL_EXTERNAL`` where it keeps
        weights in other files, be it in a subgraph, a function, an attribute or the training information.
    """
    found: list[_Declared] = []
    weights: set[str] = set()
    graphs = 0
    try:
        for count, (depth, message, number, value) in enumerate(_walk(memoryview(data), "model", 0)):
            if count >= MAX_FIELDS:
                raise ValueError(f"more than {MAX_FIELDS} fields")
            match depth, message, number:
                case (_, "tensor", 13) | (_, "tensor", 14) if number == 13 or value == 1:
                    # 13: where the data lies; 14: data_location, 1 = EXTERNAL
                    raise ModelError(
                        "the model keeps weights in other files",
                        subject=subject,
                        remedy="save it as one file: onnx.save(model, path, save_as_external_data=False)",
                        code="E_MODEL_EXTERNAL",
                    )
                case 0, "model", 7:
                    graphs += 1
                case 1, "graph", 11 | 12:
                    found.append(_Declared(is_input=number == 11))
                case 2, "tensor", 8:
                    weights.add(_text(value))
                case 2, "value", 1:
                    found[-1].name = _text(value)
                case 4, "array", 1:
                    found[-1].kind = _TYPES.get(value, f"type {value}") if isinstance(value, int) else ""
                case 5, "shape", 1:
                    found[-1].shape.append(None)
                case 6, "dimension", 1 if isinstance(value, int) and 0 < value < 1 << 31:
                    found[-1].shape[-1] = value
        if graphs != 1:
            raise ValueError("no graph")
    except (ValueError, UnicodeDecodeError) as error:
        raise ModelError(
            f"not an ONNX model ({error})", subject=subject, remedy="get the file again", code="E_MODEL_FILE"
        ) from None
    tensors = [(one.is_input, Tensor(one.name, one.kind, tuple(one.shape))) for one in found]
    return OnnxHeader(
        tuple(tensor for is_input, tensor in tensors if is_input and tensor.name not in weights),
        tuple(tensor for is_input, tensor in tensors if not is_input),
    )


@dataclass
class _Declared:
    """What is known so far of an input or output."""

    is_input: bool
    name: str = ""
    kind: str = "type 0"
    shape: list[int | None] = field(default_factory=list)


def _walk(view: memoryview, message: str, depth: int) -> Iterator[tuple[int, str, int, memoryview | int]]:
    """(depth, message, field number, value) of all fields at and below ``view``, in the order of the file.

    Values are bytes as a view, variable-length numbers as int, and 0 for numbers of a fixed length.
    """
    if depth > MAX_DEPTH:
        raise ValueError("nested too deeply")
    inside = _INSIDE.get(message, {})
    at, end = 0, len(view)
    while at < end:
        key, at = _varint(view, at)
        number, kind = key >> 3, key & 7
        value: memoryview | int = 0
        if kind == 0:
            value, at = _varint(view, at)
        elif kind == 2:
            length, at = _varint(view, at)
            value, at = view[at : at + length], at + length
        elif kind in (1, 5):
            at += 8 if kind == 1 else 4
        else:
            raise ValueError(f"wire type {kind}")
        if at > end:
            raise ValueError("cut short")
        if not number:
            raise ValueError("field number 0")
        yield depth, message, number, value
        if number in inside:
            if isinstance(value, int):
                raise ValueError("a number where a message belongs")
            yield from _walk(value, inside[number], depth + 1)


def _text(value: memoryview | int) -> str:
    if isinstance(value, int):
        raise ValueError("a number where a name belongs")
    return bytes(value).decode("utf-8")


def _varint(view: memoryview, at: int) -> tuple[int, int]:
    """The number at a place, and the place after it."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(view):
            raise ValueError("cut short")
        byte = view[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError("a number longer than 64 bits")
