"""The header reader agrees with the onnx package, refuses other files, and survives any bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_networks import constant, dot_network, random_maps

from gesture_core.errors import ModelError
from gesture_core.pose import onnx_header
from gesture_core.pose.onnx_header import read_header


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return random_maps(tmp_path_factory.mktemp("header") / "random.onnx").read_bytes()


def _declared(model: onnx.ModelProto) -> list[tuple[str, tuple[int | None, ...]]]:
    found = []
    for value in [*model.graph.input, *model.graph.output]:
        dims = value.type.tensor_type.shape.dim
        found.append((value.name, tuple(d.dim_value or None for d in dims)))
    return found


def test_it_reads_what_the_onnx_package_reads(tmp_path: Path) -> None:
    for path in (
        random_maps(tmp_path / "a.onnx"),
        dot_network(tmp_path / "b.onnx", side=None),
        constant(tmp_path / "c.onnx", {"x": np.ones((1, 17, 3)), "y": np.ones((2, 2))}),
    ):
        header = read_header(path.read_bytes())
        tensors = [(t.name, t.shape) for t in (*header.inputs, *header.outputs)]
        assert tensors == _declared(onnx.load(path))
        assert header.inputs[0].dtype == "float32"


def test_it_reads_real_networks(shared_models: Path) -> None:
    for path in shared_models.glob("*.onnx"):
        header = read_header(path.read_bytes())
        tensors = [(t.name, t.shape) for t in (*header.inputs, *header.outputs)]
        assert tensors == _declared(onnx.load(path))


def test_weights_in_other_files_are_refused(tmp_path: Path) -> None:
    model = onnx.load(random_maps(tmp_path / "a.onnx"))
    onnx.save(model, tmp_path / "b.onnx", save_as_external_data=True, size_threshold=0)
    with pytest.raises(ModelError, match="E_MODEL_EXTERNAL"):
        read_header((tmp_path / "b.onnx").read_bytes())


def test_weights_in_other_files_are_refused_wherever_they_hide() -> None:
    tensor = onnx.TensorProto(name="w", dims=[1], data_type=1)
    tensor.external_data.add(key="location", value="/etc/passwd")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    inner = onnx.helper.make_graph([], "inner", [], [], [tensor])
    sparse = onnx.SparseTensorProto(values=tensor)
    for node in (
        onnx.helper.make_node("Constant", [], ["c"], value=tensor),
        onnx.helper.make_node("If", ["c"], ["d"], then_branch=inner, else_branch=inner),
        onnx.helper.make_node("Constant", [], ["c"], sparse_value=sparse),
    ):
        model = onnx.helper.make_model(onnx.helper.make_graph([node], "outer", [], []))
        with pytest.raises(ModelError, match="E_MODEL_EXTERNAL"):
            read_header(model.SerializeToString())
    plain = onnx.helper.make_model(onnx.helper.make_graph([], "outer", [], []))
    assert not read_header(plain.SerializeToString()).inputs
    for place in ("function", "training"):
        model = onnx.helper.make_model(onnx.helper.make_graph([], "outer", [], []))
        if place == "function":
            node = onnx.helper.make_node("Constant", [], ["c"], value=tensor)
            model.functions.append(onnx.helper.make_function("own", "f", [], ["c"], [node], []))
        else:
            model.training_info.add().algorithm.CopyFrom(inner)
        with pytest.raises(ModelError, match="E_MODEL_EXTERNAL"):
            read_header(model.SerializeToString())


def test_weights_listed_as_inputs_are_no_pictures(tmp_path: Path) -> None:
    model = onnx.load(random_maps(tmp_path / "a.onnx"))
    model.graph.input.append(onnx.helper.make_tensor_value_info("first", 1, [16, 3, 5, 5]))
    assert [t.name for t in read_header(model.SerializeToString()).inputs] == ["image"]


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_damaged_files_are_model_errors_and_nothing_else(network: bytes, data: st.DataObject) -> None:
    damaged = bytearray(network)
    for _ in range(data.draw(st.integers(1, 4))):
        # Most of the file is weights; the ends hold the structure.
        at = data.draw(st.integers(0, 200) | st.integers(1, len(network)).map(lambda n: -n))
        damaged[at] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(network)))
    for sample in (bytes(damaged), bytes(damaged[:cut])):
        try:
            read_header(sample)
        except ModelError as error:
            assert error.code in ("E_MODEL_FILE", "E_MODEL_EXTERNAL")


@given(st.binary(max_size=300))
def test_any_bytes_are_answered(data: bytes) -> None:
    try:
        read_header(data)
    except ModelError as error:
        assert error.code in ("E_MODEL_FILE", "E_MODEL_EXTERNAL")


def test_endless_nesting_is_refused() -> None:
    message = b""
    for _ in range(200):  # graph > node > attribute > graph > ...
        attribute = b"\x32" + _length(message) + message
        node = b"\x2a" + _length(attribute) + attribute
        message = b"\x0a" + _length(node) + node
    with pytest.raises(ModelError, match="nested too deeply"):
        read_header(b"\x3a" + _length(message) + message)


@pytest.mark.parametrize(
    "field",
    [b"\x0a\x00", b"\xa0\x06\x01", b"\xad\x06....", b"\xa9\x06........"],
    ids=["node", "number", "32", "64"],
)
def test_a_file_of_nothing_but_fields_is_refused_soon(field: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnx_header, "MAX_FIELDS", 5_000)
    few, many = field * 4_000, field * 6_000
    read_header(b"\x3a" + _length(few) + few)
    with pytest.raises(ModelError, match="more than 5000 fields"):
        read_header(b"\x3a" + _length(many) + many)


def _length(data: bytes) -> bytes:
    value, out = len(data), b""
    while value > 0x7F:
        out += bytes([value & 0x7F | 0x80])
        value >>= 7
    return out + bytes([value])
