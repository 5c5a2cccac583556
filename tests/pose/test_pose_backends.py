"""Every installed pose backend keeps the contract, and all of them see the same on the same file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from tiny_networks import FIGURE, constant, dot_network, dot_picture, random_maps

from gesture_core.errors import ModelError, PoseError
from gesture_core.plugin import registry
from gesture_core.plugin.interfaces import Person
from gesture_core.pose.models import find_model
from gesture_core.pose.network import NetworkBackend

HALF_A_CELL = 0.5 * 4 * 200 / 96
"""Pixels of a picture 200 wide in a network of 96 pixels and stride 4."""
BACKENDS = registry().names("pose", usable=True)


def make(name: str, path: Path, **options: object) -> NetworkBackend:
    made: NetworkBackend = registry().make("pose", name, options, model=find_model(path))
    return made


def frames(count: int, size: tuple[int, int] = (120, 160), seed: int = 0) -> list[np.ndarray]:
    """Smooth random pictures."""
    import cv2

    random = np.random.default_rng(seed)
    coarse = random.integers(0, 256, (count, 6, 8, 3), np.uint8)
    return [cv2.resize(picture, size[::-1], interpolation=cv2.INTER_CUBIC) for picture in coarse]


def keypoints(found: list[list[Person]]) -> np.ndarray:
    return np.stack([people[0].keypoints for people in found])


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_figure_is_found_where_it_is(backend: str, tmp_path: Path) -> None:
    joints = FIGURE * 100 + (40, 10)
    found = make(backend, dot_network(tmp_path / "dots.onnx")).estimate([dot_picture((120, 200), joints, 3)])
    (person,) = found[0]
    assert person.keypoints.shape == (18, 2) and person.scores.shape == (18,)
    assert np.linalg.norm(person.keypoints - joints, axis=1).max() < HALF_A_CELL


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_joint_that_is_not_there_is_missing(backend: str, tmp_path: Path) -> None:
    joints = FIGURE * 100 + (40, 10)
    joints[[4, 7]] = np.nan
    found = make(backend, dot_network(tmp_path / "dots.onnx"))
    (person,) = found.estimate([dot_picture((120, 200), joints, 3)])[0]
    assert np.isnan(person.keypoints[[4, 7]]).all() and (person.scores[[4, 7]] == 0).all()
    assert np.isfinite(np.delete(person.keypoints, [4, 7], 0)).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_batch_does_not_change_the_keypoints(backend: str, tmp_path: Path) -> None:
    path = random_maps(tmp_path / "random.onnx")
    pictures = frames(7)
    alone = keypoints([make(backend, path, batch_size=1).estimate([f])[0] for f in pictures])
    together = keypoints(make(backend, path, batch_size=4).estimate(pictures))
    np.testing.assert_allclose(alone, together, atol=1e-3)


@pytest.mark.parametrize("backend", BACKENDS)
def test_frames_of_different_sizes_may_be_mixed(backend: str, tmp_path: Path) -> None:
    joints = FIGURE * 100 + (40, 10)
    small, large = dot_picture((120, 200), joints, 3), dot_picture((240, 400), joints * 2, 6)
    found = make(backend, dot_network(tmp_path / "dots.onnx")).estimate([small, large, small])
    assert np.linalg.norm(found[1][0].keypoints - joints * 2, axis=1).max() < 2 * HALF_A_CELL
    np.testing.assert_allclose(found[2][0].keypoints, found[0][0].keypoints)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_free_input_takes_the_height_that_is_asked_for(backend: str, tmp_path: Path) -> None:
    joints = FIGURE * 200 + (40, 10)
    found = make(backend, dot_network(tmp_path / "free.onnx", side=None), height=96)
    (person,) = found.estimate([dot_picture((240, 300), joints, 6)])[0]
    assert np.linalg.norm(person.keypoints - joints, axis=1).max() < 5
    assert found.provenance["height"] == "96"


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_no_frame_is_refused(backend: str, tmp_path: Path) -> None:
    found = make(backend, random_maps(tmp_path / "random.onnx"))
    for wrong in (np.zeros((8, 8), np.uint8), np.zeros((8, 8, 3), np.float32), np.zeros((0, 8, 3), np.uint8)):
        with pytest.raises(PoseError, match="E_POSE_FRAME"):
            found.estimate([wrong])
    with pytest.raises(PoseError, match="E_POSE_PEOPLE"):
        found.estimate(frames(1), "everybody")
    assert found.estimate([]) == []


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_network_without_fields_cannot_tell_people_apart(backend: str, tmp_path: Path) -> None:
    found = make(backend, random_maps(tmp_path / "random.onnx", channels=19))
    with pytest.raises(PoseError, match="part-affinity"):
        found.estimate(frames(1), "multi")


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_file_that_is_no_network_is_a_model_error(backend: str, tmp_path: Path) -> None:
    path = constant(tmp_path / "broken.onnx", {"maps": np.zeros((1, 57, 8, 8))})
    path.write_bytes(path.read_bytes().replace(b"ReduceMean", b"ReduceMoan"))
    with pytest.raises(ModelError, match="E_MODEL_LOAD"):
        make(backend, path)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_file_that_changed_after_it_was_found_does_not_run(backend: str, tmp_path: Path) -> None:
    path = random_maps(tmp_path / "random.onnx")
    model = find_model(path)
    random_maps(path, seed=1)
    with pytest.raises(ModelError, match="E_MODEL_CHANGED"):
        registry().make("pose", backend, {}, model=model)


@pytest.mark.parametrize("backend", BACKENDS)
def test_impossible_options_name_the_rule(backend: str, tmp_path: Path) -> None:
    path = random_maps(tmp_path / "random.onnx")
    for options in ({"score": 2.0}, {"batch_size": 0}, {"height": 1}, {"no_such_option": 1}):
        with pytest.raises(Exception, match="E_OPTION"):
            make(backend, path, **options)


def agreement(one: np.ndarray, two: np.ndarray, scores: np.ndarray) -> float:
    """Share of joints above a score of 0.1 that lie within half a pixel."""
    judged = scores > 0.1
    near = np.linalg.norm(one - two, axis=-1) <= 0.5
    return float(near[judged].mean())


@pytest.mark.parametrize("size", [(120, 160), (300, 90), (48, 64)])
@pytest.mark.parametrize("side", [64, None])
def test_both_runtimes_give_the_same_keypoints(
    size: tuple[int, int], side: int | None, tmp_path: Path
) -> None:
    paths = [random_maps(tmp_path / "random.onnx", seed=3)]
    paths.append(dot_network(tmp_path / "dots.onnx", side=side))
    for path in paths:
        pictures = frames(6, size, seed=5)
        first, second = (make(name, path, height=64).estimate(pictures) for name in ("onnx", "opencv-dnn"))
        scores = np.stack([people[0].scores for people in first])
        if (scores > 0.1).any():
            assert agreement(keypoints(first), keypoints(second), scores) >= 0.99


@pytest.mark.parametrize(
    ("file", "height"),
    [
        ("openpose_mv2s_256x256.onnx", None),
        ("openpose_mv2s_368x368.onnx", None),
        ("hpe0001_f32_dynamic.onnx", 184),
    ],
)
def test_both_runtimes_agree_on_real_networks_and_a_real_video(
    file: str, height: int | None, shared: Path, shared_models: Path
) -> None:
    import cv2

    video = cv2.VideoCapture(str(shared / "utd_openpose" / "videos" / "a7_s5_t2_color.avi"))
    pictures = [video.read()[1] for _ in range(12)][::2]
    first, second = (
        make(name, shared_models / file, height=height).estimate(pictures) for name in ("onnx", "opencv-dnn")
    )
    scores = np.stack([people[0].scores for people in first])
    assert (scores > 0.1).mean() > 0.95
    assert agreement(keypoints(first), keypoints(second), scores) >= 0.99


def test_both_runtimes_agree_on_the_packaged_network() -> None:
    """By its maps: whoever trains it anew need not see people in noise."""
    model = find_model("compact")
    assert model.contract is not None and model.contract.input_size is not None
    batch = np.random.default_rng(2).integers(0, 255, (3, 3, *model.contract.input_size)).astype(np.float32)
    first, second = (registry().make("pose", name, {}, model=model).run(batch) for name in BACKENDS)
    assert len(first) == len(second) == 2
    for one, two in zip(first, second, strict=True):
        np.testing.assert_allclose(one, two, atol=2e-3)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_a_network_of_a_fixed_batch_takes_any_number_of_frames(
    backend: str, count: int, tmp_path: Path
) -> None:
    free = dot_network(tmp_path / "free.onnx")
    model = onnx.load(free)
    for value in (*model.graph.input, *model.graph.output):
        value.type.tensor_type.shape.dim[0].dim_value = 3
    fixed = tmp_path / "fixed.onnx"
    onnx.save(model, fixed)
    pictures = frames(count, (96, 96), seed=1)
    found = make(backend, fixed, batch_size=8)
    assert found.batch_size == 3
    np.testing.assert_allclose(
        keypoints(found.estimate(pictures)), keypoints(make(backend, free).estimate(pictures)), atol=1e-3
    )


@pytest.mark.parametrize("backend", BACKENDS)
def test_x_and_y_are_told_apart_on_a_square_input(backend: str, tmp_path: Path) -> None:
    x, y = np.zeros((2, 1, 17, 128), np.float32)
    x[..., 100], y[..., 20] = 0.9, 0.9
    for names in (("simcc_x", "simcc_y"), ("b", "a")):
        path = constant(tmp_path / "x.onnx", dict(zip(names, (x, y), strict=True)))
        (person,) = make(backend, path).estimate([np.zeros((64, 64, 3), np.uint8)])[0]
        np.testing.assert_allclose(person.keypoints, np.broadcast_to((50, 10), (17, 2)), atol=0.6)


def test_the_tensorflow_file_of_a_network_gives_what_its_onnx_file_gives(
    shared: Path, shared_models: Path
) -> None:
    import cv2

    video = cv2.VideoCapture(str(shared / "utd_openpose" / "videos" / "a7_s6_t1_color.avi"))
    pictures = [video.read()[1] for _ in range(3)]
    exported = make("opencv-dnn", shared_models / "openpose_mv2s_368x368.onnx").estimate(pictures)
    graph = make("opencv-dnn", shared_models / "openpose_mv2s_368x368.pb").estimate(pictures)
    scores = np.stack([people[0].scores for people in exported])
    assert agreement(keypoints(exported), keypoints(graph), scores) >= 0.99


def test_onnxruntime_says_what_runs_other_formats(tmp_path: Path) -> None:
    path = tmp_path / "graph.pb"
    path.write_bytes(b"\x0a\x00")
    with pytest.raises(ModelError, match="opencv-dnn"):
        make("onnx", path)


def test_caffe_weights_run_where_opencv_reads_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import cv2

    path = tmp_path / "weights.caffemodel"
    path.write_bytes(b"")
    if hasattr(cv2.dnn, "readNetFromCaffe"):
        _reads_caffe(path)
        monkeypatch.delattr(cv2.dnn, "readNetFromCaffe")
    with pytest.raises(ModelError, match="convert the network to ONNX"):
        make("opencv-dnn", path)


def _reads_caffe(path: Path) -> None:
    with pytest.raises(ModelError, match="prototxt"):
        make("opencv-dnn", path)
    path.with_suffix(".prototxt").write_text(
        'name: "tiny" input: "image" input_shape { dim: 1 dim: 3 dim: 64 dim: 64 } '
        'layer { name: "pool" type: "Pooling" bottom: "image" top: "maps" pooling_param '
        "{ pool: AVE kernel_size: 8 stride: 8 } }"
    )
    # OpenCV read and ran it: what is wrong is that three pooled colours are no keypoints.
    with pytest.raises(ModelError, match=r"E_MODEL_LAYOUT.*\(1, 3, "):
        make("opencv-dnn", path)
