"""Contracts are validated, and unknown networks are recognised by the shapes of their outputs."""

from __future__ import annotations

import pytest

from gesture_core.errors import ModelError
from gesture_core.pose.contract import ModelContract, Tensor, infer_contract, split_openpose
from gesture_core.pose.models import known_models
from gesture_core.pose.people import LIMBS
from gesture_core.skeletons import SKELETONS

IMAGE = Tensor("image", "float32", (None, 3, 256, 256))


@pytest.mark.parametrize(
    ("outputs", "layout", "skeleton"),
    [
        ([(1, 57, 32, 32)], "openpose", "coco18"),
        ([(1, 19, 32, 32)], "openpose", "coco18"),
        ([(1, 18, 32, 32)], "openpose", "coco18"),
        ([(1, 78, 32, 32)], "openpose", "body25"),
        ([(1, 44, 32, 32)], "openpose", "mpi15"),
        ([(1, 19, 32, 32), (1, 38, 32, 32)], "openpose", "coco18"),
        ([(1, 38, 32, 32), (1, 19, 32, 32), (1, 38, 32, 32), (1, 19, 32, 32)], "openpose", "coco18"),
        ([(1, 1, 17, 3)], "movenet", "coco17"),
        ([(1, 17, 384), (1, 17, 512)], "simcc", "coco17"),
        ([(1, 56, 8400)], "yolo-pose", "coco17"),
        ([(1, 8400, 56)], "yolo-pose", "coco17"),
    ],
)
def test_outputs_say_what_a_network_is(outputs: list[tuple[int, ...]], layout: str, skeleton: str) -> None:
    contract = infer_contract([IMAGE], outputs)
    assert (contract.layout, contract.skeleton, contract.input_size) == (layout, skeleton, (256, 256))


def test_the_input_is_read_off_too() -> None:
    tensor = Tensor("input", "uint8", (1, 192, 192, 3))
    contract = infer_contract([tensor], [(1, 1, 17, 3)])
    assert (contract.dtype, contract.channels_first, contract.batch) == ("uint8", False, 1)
    free = infer_contract([Tensor("i", "float32", (None, 3, None, None))], [(None, 57, None, None)])
    assert free.input_size is None and free.batch is None
    assert infer_contract([IMAGE], [(1, 19, 64, 64)]).stride == 4


@pytest.mark.parametrize(
    "outputs", [[], [(1, 1000)], [(1, 20, 32, 32)], [(1, 17, 64), (1, 17, 64), (1, 17, 64)], [(1, 133, 3)]]
)
def test_other_outputs_are_shown_in_the_error(outputs: list[tuple[int, ...]]) -> None:
    with pytest.raises(ModelError, match="E_MODEL_LAYOUT") as error:
        infer_contract([IMAGE], outputs)
    for shape in outputs:
        assert ", ".join(map(str, shape)) in str(error.value)
    assert "MoveNet" in str(error.value)


@pytest.mark.parametrize("shape", [(1, 1, 64, 64), (1, 3), (64, 64, 64)])
def test_an_input_that_takes_no_picture_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ModelError, match="E_MODEL_INPUT"):
        infer_contract([Tensor("x", "float32", shape)], [(1, 57, 8, 8)])
    with pytest.raises(ModelError, match="2 inputs"):
        infer_contract([IMAGE, IMAGE], [(1, 57, 8, 8)])


def test_the_last_stage_counts() -> None:
    shapes = [(1, 38, 8, 8), (1, 19, 8, 8), (1, 38, 8, 8), (1, 19, 8, 8)]
    assert split_openpose(shapes, "coco18") == (3, 2)
    with pytest.raises(ModelError, match="body25"):
        split_openpose(shapes, "body25")


@pytest.mark.parametrize(
    "change",
    [
        {"layout": "magic"}, {"colour": "grey"}, {"dtype": "float16"}, {"skeleton": "cat"}, {"mean": (1.0,)},
        {"input_size": (0, 10)}, {"stride": 0}, {"multiple": 5000}, {"wings": 2}, {"mean": 3},
        {"input_size": (10,)}, {"scale": ("a", "b", "c")}, {"stride": "8"}, {"pad": 300}, {"batch": 0},
        {"follow": "yes"}, {"crop": 0}, {"crop": "1"}, {"crop": float("nan")}, {"crop": True},
        {"score": 1.5}, {"score": "0.1"}, {"score": float("nan")}, {"mean": (1.0, float("nan"), 1.0)},
        {"scale": (1.0, 1.0, float("inf"))}, {"layout": "movenet"},
        {"layout": "yolo-pose", "skeleton": "mpi15"}, {"dtype": "uint8", "mean": (1.0, 2.0, 3.0)},
        {"dtype": "int32", "scale": (0.5, 1.0, 1.0)},
    ],
)  # fmt: skip
def test_impossible_contracts_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ModelError, match="E_MODEL_CONTRACT"):
        ModelContract.from_table({"layout": "openpose", **change})


def test_a_network_that_takes_bytes_scales_them_itself() -> None:
    shapes = [(1, 17, 128), (1, 17, 128)]
    bytes_ = infer_contract([Tensor("x", "uint8", (1, 3, 64, 64))], shapes)
    assert (bytes_.dtype, bytes_.mean, bytes_.scale) == ("uint8", (0.0,) * 3, (1.0,) * 3)
    assert infer_contract([Tensor("x", "float32", (1, 3, 64, 64))], shapes).mean != (0.0,) * 3


def test_known_networks_are_complete() -> None:
    known = known_models()
    assert {"compact", "hpe0001", "movenet-lightning", "rtmpose-t", "yolo-pose", "openpose-coco"} <= set(
        known
    )
    hashes = [value for model in known.values() for value in model.sha256]
    assert len(hashes) == len(set(hashes)) and all(len(value) == 64 for value in hashes)
    for model in known.values():
        assert model.licence and model.summary and (model.where or model.packaged or model.member)
        assert bool(model.member) == bool(model.wheel or (model.url and model.archive_sha256))
        assert not model.member or len(model.sha256) == 1


def test_fields_cover_all_joints_that_can_be_joined() -> None:
    for name, limbs in LIMBS.items():
        joints = SKELETONS[name].joints
        assert {j for limb in limbs for j in limb} == set(range(len(joints)))
        # A person is one piece: every joint can be reached from the neck.
        reached = {1}
        for _ in limbs:
            reached |= {b for limb in limbs for a, b in (limb, limb[::-1]) if a in reached}
        assert len(reached) == len(joints)
