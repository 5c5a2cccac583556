"""Reads what an ONNX file declares, without a runtime: inputs, outputs, and references to other files.

A file is checked before any runtime sees it: onnxruntime and OpenCV both follow references to external
data while they load, which would let a model file name any file of the machine. The walk follows the
wire format of protocol buffers and the field numbers of ``onnx.proto3``; weights are skipped, not read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gesture_core.errors import ModelError
from gesture_core.pose.layouts import Tensor

_MAX_DEPTH = 32
_TYPES = {1: "float32", 2: "uint8", 3: "int8", 6: "int32", 7: "int64", 10: "float16", 11: "float64"}


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
        weights in other files.
    """
    view = memoryview(data)
    try:
        graphs = [value for number, value in _fields(view) if number == 7 and isinstance(value, memoryview)]
        if len(graphs) != 1:
            raise ValueError("no graph")
        if any(_external(view, "model", 0)):
            raise ModelError(
                "the model keeps weights in other files",
                subject=subject,
                remedy="save it as one file: onnx.save(model, path, save_as_external_data=False)",
                code="E_MODEL_EXTERNAL",
            )
        inputs: list[Tensor] = []
        outputs: list[Tensor] = []
        weights: set[str] = set()
        for number, value in _fields(graphs[0]):
            if not isinstance(value, memoryview):
                continue
            if number == 5:
                weights.update(_text(v) for n, v in _fields(value) if n == 8)
            elif number == 11:
                inputs.append(_tensor(value))
            elif number == 12:
                outputs.append(_tensor(value))
    except (ValueError, IndexError, UnicodeDecodeError) as error:
        raise ModelError(
            f"not an ONNX model ({error})", subject=subject, remedy="get the file again", code="E_MODEL_FILE"
        ) from None
    return OnnxHeader(tuple(t for t in inputs if t.name not in weights), tuple(outputs))


# Where messages that may hold tensors lie: message -> {field number: message}.
_INSIDE = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
}


def _external(view: memoryview, message: str, depth: int) -> Iterator[bool]:
    """True for every tensor below `view` whose data lies in another file."""
    if depth > _MAX_DEPTH:
        raise ValueError("nested too deeply")
    for number, value in _fields(view):
        if message == "tensor":
            # 13: where the data lies; 14: data_location, 1 = EXTERNAL
            yield number == 13 or (number == 14 and value == 1)
        elif number in _INSIDE[message] and isinstance(value, memoryview):
            yield from _external(value, _INSIDE[message][number], depth + 1)


def _tensor(view: memoryview) -> Tensor:
    """ValueInfoProto: name (1), type (2) -> tensor type (1) -> element type (1), shape (2)."""
    name, kind = "", 0
    shape: tuple[int | None, ...] = ()
    for number, value in _fields(view):
        if number == 1:
            name = _text(value)
        elif number == 2 and isinstance(value, memoryview):
            for _, tensor in (f for f in _fields(value) if f[0] == 1):
                for part, inner in _fields(_message(tensor)):
                    if part == 1 and isinstance(inner, int):
                        kind = inner
                    elif part == 2 and isinstance(inner, memoryview):
                        shape = tuple(_dimension(d) for n, d in _fields(inner) if n == 1)
    return Tensor(name, _TYPES.get(kind, f"type {kind}"), shape)


def _dimension(view: memoryview | int) -> int | None:
    for number, value in _fields(_message(view)):
        if number == 1 and isinstance(value, int) and 0 < value < 1 << 31:
            return value
    return None


def _message(value: memoryview | int) -> memoryview:
    if isinstance(value, int):
        raise ValueError("a number where a message belongs")
    return value


def _text(value: memoryview | int) -> str:
    if isinstance(value, int):
        raise ValueError("a number where a name belongs")
    return bytes(value).decode("utf-8")


def _fields(view: memoryview) -> Iterator[tuple[int, memoryview | int]]:
    """(field number, value) of one message: bytes as a view, varints as int, fixed words skipped."""
    at, end = 0, len(view)
    while at < end:
        key, at = _varint(view, at)
        number, wire = key >> 3, key & 7
        if wire == 0:
            value, at = _varint(view, at)
            yield number, value
        elif wire == 2:
            length, at = _varint(view, at)
            if length > end - at:
                raise ValueError("cut short")
            yield number, view[at : at + length]
            at += length
        elif wire in (1, 5):
            at += 8 if wire == 1 else 4
            if at > end:
                raise ValueError("cut short")
        else:
            raise ValueError(f"wire type {wire}")
        if not number:
            raise ValueError("field number 0")


def _varint(view: memoryview, at: int) -> tuple[int, int]:
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
