"""The packaged network on onnxruntime: found, whole, and the same twice."""

from __future__ import annotations

import numpy as np
import pytest
from gesture_pose_onnx.backend import OnnxBackend

from gesture_core.errors import ModelError
from gesture_core.pose import ModelFile, find_model
from gesture_core.pose.models import known_models
from gesture_core.skeletons import COCO18


def test_the_packaged_network_is_the_known_one() -> None:
    assert find_model("compact").sha256 in known_models()["compact"].sha256


def test_it_answers_for_every_picture() -> None:
    backend = OnnxBackend(find_model("compact"), threads=1, presence=0.0)
    pictures = list(np.random.default_rng(0).integers(0, 256, (3, 120, 90, 3), np.uint8))
    first, second = (backend.estimate(pictures) for _ in range(2))
    assert [len(people) for people in first] == [1, 1, 1] and backend.skeleton == COCO18.name
    for one, two in zip(first, second, strict=True):
        np.testing.assert_array_equal(one[0].keypoints, two[0].keypoints)


def test_another_format_is_refused_with_a_remedy(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("model") / "graph.pb"
    path.write_bytes(b"\x0a\x00")
    with pytest.raises(ModelError, match="E_MODEL_CHANGED"):
        OnnxBackend(ModelFile(path, "0" * 64, "graph"))
    with pytest.raises(ModelError, match=r"E_MODEL_FORMAT.*opencv-dnn"):
        OnnxBackend(find_model(path))


def test_openvino_keeps_to_the_threads_and_to_the_sums_that_are_asked_for() -> None:
    if "openvino" not in OnnxBackend.devices()["provider"]:
        pytest.skip("this onnxruntime has no OpenVINO: pip install onnxruntime-openvino instead")
    picture = np.random.default_rng(0).integers(0, 256, (1, 3, 192, 192)).astype(np.float32) / 255
    model, answers = find_model("compact"), {}
    for device in ("cpu", "openvino", "openvino-bf16"):
        backend = OnnxBackend(model, threads=1, device=device)
        answers[device] = backend.run(picture)[0]
        assert device == "cpu" or '"INFERENCE_NUM_THREADS": "1"' in backend._told()["load_config"]
    np.testing.assert_allclose(answers["openvino"], answers["cpu"], atol=1e-4)
    np.testing.assert_allclose(answers["openvino-bf16"], answers["cpu"], atol=0.1)
    assert OnnxBackend(model).device != "openvino-bf16", "auto never takes other sums"
