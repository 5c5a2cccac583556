"""Every layout that networks come in, through a real runtime, from a network that gives known outputs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto
from tiny_networks import constant

from gesture_core.errors import PoseError
from gesture_core.plugin import registry
from gesture_core.pose.models import find_model
from gesture_core.pose.network import NetworkBackend
from gesture_core.pose.people import LIMBS
from gesture_core.skeletons import SKELETONS

GREY = np.full((128, 128, 3), 90, np.uint8)  # twice the size of the input


def backend(path: Path, **options: object) -> NetworkBackend:
    made: NetworkBackend = registry().make("pose", "onnx", options, model=find_model(path))
    return made


def spots(joints: int, seed: int = 0) -> np.ndarray:
    """(J, 2) places well inside an input of 64 by 64 pixels."""
    return np.random.default_rng(seed).uniform(10, 54, (joints, 2))


def maps_of(points: np.ndarray, stride: int, side: int = 64) -> np.ndarray:
    cells = side // stride
    rows, columns = np.mgrid[:cells, :cells]
    x, y = ((points + 0.5) / stride - 0.5).T[..., None, None]
    maps: np.ndarray = 0.8 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 4)
    return maps


def in_picture(points: np.ndarray) -> np.ndarray:
    return (points + 0.5) * 2 - 0.5


@pytest.mark.parametrize(
    ("skeleton", "channels"),
    [
        ("coco18", 57),
        ("coco18", 19),
        ("coco18", 18),
        ("body25", 78),
        ("body25", 26),
        ("mpi15", 44),
        ("mpi15", 16),
    ],
)
@pytest.mark.parametrize("stride", [4, 8])
def test_openpose_maps_of_every_skeleton(skeleton: str, channels: int, stride: int, tmp_path: Path) -> None:
    joints = len(SKELETONS[skeleton].joints)
    points = spots(joints)
    maps = np.zeros((1, channels, 64 // stride, 64 // stride), np.float32)
    maps[0, :joints] = maps_of(points, stride)
    if channels > joints:
        maps[0, joints] = 1  # the background must not be taken for a joint
    found = backend(constant(tmp_path / "x.onnx", {"maps": maps}))
    assert found.skeleton == skeleton
    (person,) = found.estimate([GREY])[0]
    np.testing.assert_allclose(person.keypoints, in_picture(points), atol=0.3)
    np.testing.assert_allclose(person.scores, 0.8, atol=0.15)


def test_separate_maps_and_fields_of_two_stages(tmp_path: Path) -> None:
    points = spots(18)
    maps = np.zeros((1, 19, 16, 16), np.float32)
    maps[0, :18] = maps_of(points, 4)
    outputs: dict[str, np.ndarray] = {
        "fields1": np.zeros((1, 38, 16, 16)),
        "maps1": np.ones((1, 19, 16, 16)),
        "fields2": np.zeros((1, 38, 16, 16)),
        "maps2": maps,
    }
    found = backend(constant(tmp_path / "x.onnx", outputs))
    np.testing.assert_allclose(found.estimate([GREY])[0][0].keypoints, in_picture(points), atol=0.3)
    assert found.estimate([GREY], "multi") == [[]]


@pytest.mark.parametrize(("skeleton", "channels"), [("coco18", 57), ("body25", 78), ("mpi15", 44)])
def test_the_fields_of_every_skeleton_join_its_joints(skeleton: str, channels: int, tmp_path: Path) -> None:
    """Each limb's field is drawn into its own channels; a wrong channel order would tear people apart."""
    joints = len(SKELETONS[skeleton].joints)
    columns_of = np.linspace(6, 58, joints)
    people = [np.stack([columns_of, np.full(joints, y)], 1) for y in (16.0, 48.0)]
    maps = np.zeros((1, channels, 16, 16), np.float32)
    for points in people:
        maps[0, :joints] = np.maximum(maps[0, :joints], maps_of(points, 4))
    for k, (a, b) in enumerate(LIMBS[skeleton]):
        maps[0, joints + 1 + 2 * k] = np.sign(columns_of[b] - columns_of[a])
    found = backend(constant(tmp_path / "x.onnx", {"maps": maps})).estimate([GREY], "multi")[0]
    assert len(found) == 2
    for person in found:
        assert np.isfinite(person.keypoints).all()
        assert np.ptp(person.keypoints[:, 1]) < 2


def test_movenet_takes_bytes_and_gives_fractions(tmp_path: Path) -> None:
    points = spots(17)
    rows = np.concatenate([(points[:, ::-1] + 0.5) / 64, np.full((17, 1), 0.7)], 1)
    path = constant(tmp_path / "x.onnx", {"x": rows[None, None]}, (1, 64, 64, 3), TensorProto.UINT8)
    found = backend(path)
    assert found.contract.layout == "movenet" and found.skeleton == "coco17" and found.batch_size == 1
    for people in found.estimate([GREY, GREY, GREY]):
        np.testing.assert_allclose(people[0].keypoints, in_picture(points), atol=0.01)
        np.testing.assert_allclose(people[0].scores, 0.7)
    with pytest.raises(PoseError, match="E_POSE_PEOPLE"):
        found.estimate([GREY], "multi")


@pytest.mark.parametrize("size", [(64, 48), (64, 64)])
def test_simcc_classifies_x_and_y(size: tuple[int, int], tmp_path: Path) -> None:
    high, wide = size
    points = np.floor(spots(17) * (wide / 64, high / 64)) + np.array([0.0, 0.5])
    x, y = (np.zeros((1, 17, 2 * side), np.float32) for side in (wide, high))
    for joint, (px, py) in enumerate(points):
        x[0, joint, int(2 * px)], y[0, joint, int(2 * py)] = 0.9, 0.6
    path = constant(tmp_path / "x.onnx", {"simcc_x": x, "simcc_y": y}, (1, 3, high, wide))
    (person,) = backend(path).estimate([np.zeros((high, wide, 3), np.uint8)])[0]
    np.testing.assert_allclose(person.keypoints, points, atol=0.01)
    np.testing.assert_allclose(person.scores, 0.6)


@pytest.mark.parametrize("transposed", [False, True])
def test_yolo_pose_gives_boxes_each_person_once(transposed: bool, tmp_path: Path) -> None:
    points = [spots(17, seed) / 2 + offset for seed, offset in ((0, 0), (1, 28))]
    boxes = np.zeros((1, 56, 40), np.float32)
    for column, (who, score) in enumerate(((0, 0.6), (1, 0.9), (0, 0.8), (1, 0.5))):
        low, high = points[who].min(0) - 2, points[who].max(0) + 2
        boxes[0, :5, column] = (*(low + high) / 2, *(high - low), score)
        boxes[0, 5:, column] = np.concatenate([points[who] + 0.5, np.full((17, 1), score)], 1).reshape(-1)
    value = boxes.transpose(0, 2, 1) if transposed else boxes
    found = backend(constant(tmp_path / "x.onnx", {"boxes": value}))
    people = found.estimate([GREY], "multi")[0]
    assert [round(float(person.scores[0]), 3) for person in people] == [0.9, 0.8]
    np.testing.assert_allclose(people[0].keypoints, in_picture(points[1]), atol=0.01)
    (best,) = found.estimate([GREY])[0]
    np.testing.assert_allclose(best.keypoints, people[0].keypoints)
    empty = constant(tmp_path / "y.onnx", {"boxes": np.zeros((1, 56, 40))})
    assert backend(empty).estimate([GREY]) == [[]]


def test_outputs_that_are_not_numbers_are_missing_joints(tmp_path: Path) -> None:
    maps = np.full((1, 19, 8, 8), np.nan, np.float32)
    (person,) = backend(constant(tmp_path / "x.onnx", {"maps": maps})).estimate([GREY])[0]
    assert np.isnan(person.keypoints).all() and (person.scores == 0).all()


def test_a_joint_in_the_border_of_the_letterbox_is_missing(tmp_path: Path) -> None:
    maps = np.zeros((1, 19, 16, 16), np.float32)
    points = np.full((18, 2), 32.0)
    points[0] = (32, 4)  # a wide picture lies between rows 16 and 48
    maps[0, :18] = maps_of(points, 4)
    wide = np.zeros((64, 128, 3), np.uint8)
    (person,) = backend(constant(tmp_path / "x.onnx", {"maps": maps})).estimate([wide])[0]
    assert np.isnan(person.keypoints[0]).all() and person.scores[0] == 0
    assert np.isfinite(person.keypoints[1:]).all()


def test_movenet_with_its_real_weights(shared: Path, shared_models: Path) -> None:
    import cv2

    video = cv2.VideoCapture(str(shared / "utd_openpose" / "videos" / "a7_s5_t2_color.avi"))
    frames = [video.read()[1] for _ in range(4)]
    move = backend(shared_models / "movenet_lightning_dequantised_192.onnx")
    other = backend(shared_models / "openpose_mv2s_256x256.onnx")
    shoulders = [SKELETONS["coco17"].index(f"{side}_shoulder") for side in ("right", "left")]
    for one, two in zip(move.estimate(frames), other.estimate(frames), strict=True):
        width = np.linalg.norm(two[0].keypoints[2] - two[0].keypoints[5])
        gap = np.linalg.norm(one[0].keypoints[shoulders] - two[0].keypoints[[2, 5]], axis=1)
        assert gap.max() < 0.4 * width
