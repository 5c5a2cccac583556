"""The head that says whether somebody is in the picture: trained, attached, the network below unchanged."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

for _module in ("torch", "onnx", "onnxruntime", "cv2", "scipy"):
    pytest.importorskip(_module, reason=f"the training needs {_module}: pip install 'gesture-core[train]'")

import onnx  # noqa: E402
import onnxruntime  # noqa: E402

from training import presence  # noqa: E402
from training.__main__ import PACKAGED  # noqa: E402
from training.nobody import KINDS  # noqa: E402

BEFORE = "0c8f560bc537a9be7c4f088920708ab1875f81260f0e664fc8e801c00f07c3d2"
"""SHA-256 of the packaged network before it had a head."""


@pytest.fixture(scope="module")
def packaged() -> onnx.ModelProto:
    return onnx.load(str(PACKAGED))


def run(model: onnx.ModelProto, pictures: np.ndarray) -> list[np.ndarray]:
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    answers: list[np.ndarray] = session.run(None, {"image": pictures})
    return answers


def clouds(count: int, middle: float, rng: np.random.Generator) -> np.ndarray:
    found: np.ndarray = rng.normal(middle, 1, (count, 40)).astype(np.float32)
    return found


def table(rng: np.random.Generator) -> presence.Table:
    """Two clouds of features, each from six sources."""
    features = np.concatenate([clouds(300, -0.6, rng), clouds(120, 0.6, rng)])
    person = np.arange(420) >= 300
    groups = np.array([f"{'some' if p else 'none'}{i % 6}" for i, p in enumerate(person)])
    return presence.Table(features, person, groups, np.array([f"{g[:4]}: {g}" for g in groups]))


def test_the_network_below_the_head_is_the_one_that_was_trained(packaged: onnx.ModelProto) -> None:
    assert hashlib.sha256(presence.without_head(packaged).SerializeToString()).hexdigest() == BEFORE


def test_the_heat_maps_are_the_same_bits_with_the_head(packaged: onnx.ModelProto) -> None:
    pictures = np.random.default_rng(0).uniform(0, 255, (3, 3, 192, 192)).astype(np.float32)
    maps, there = run(packaged, pictures)
    assert there.shape == (3, 1) and ((there >= 0) & (there <= 1)).all()
    np.testing.assert_array_equal(maps, run(presence.without_head(packaged), pictures)[0])


def test_a_head_that_was_trained_is_what_the_file_answers(packaged: onnx.ModelProto) -> None:
    rng = np.random.default_rng(1)
    head = presence.Head(rng.normal(0, 0.1, (24, 356)), rng.normal(0, 1, 24), rng.normal(0, 1, 24), 0.3)
    pictures = rng.uniform(0, 255, (2, 3, 192, 192)).astype(np.float32)
    whole = presence.attach(packaged, head)
    onnx.checker.check_model(whole)
    probe = presence.attach(packaged, head)
    probe.graph.output.append(onnx.helper.make_tensor_value_info("presence.features", 1, None))
    features = run(probe, pictures)[2][:, :, 0, 0]
    expected = 1 / (1 + np.exp(-head.logits(features)))
    np.testing.assert_allclose(run(whole, pictures)[1][:, 0], expected, atol=1e-5)


def test_training_tells_two_clouds_apart_and_is_the_same_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "STEPS", 150)
    rng = np.random.default_rng(2)
    data = table(rng)
    logits = presence.held_out(data, 1)
    assert ((logits > 0) == data.person).mean() > 0.97
    head, (slope, shift) = presence.calibrate(presence.fit(data, 1), logits, data)
    assert np.array_equal(head.logits(data.features), presence.calibrate(
        presence.fit(data, 1), logits, data)[0].logits(data.features))  # fmt: skip
    nobody, somebody = clouds(2000, -0.6, rng), clouds(2000, 0.6, rng)
    assert (head.logits(nobody) > 0).mean() < 0.005 and (head.logits(somebody) > 0).mean() > 0.97
    lines = presence.report(data, slope * logits + shift).splitlines()
    assert lines[2].startswith("| none | none0 | 50 |") and lines[-1].startswith("| some | all | 120 |")


@pytest.mark.parametrize("kind", list(KINDS))
def test_drawn_pictures_differ_and_have_the_size_that_is_asked_for(kind: str) -> None:
    pictures = [KINDS[kind](np.random.default_rng(seed), 90, 160) for seed in (1, 1, 2)]
    assert all(picture.shape == (90, 160, 3) and picture.dtype == np.uint8 for picture in pictures)
    assert np.array_equal(pictures[0], pictures[1]) and not np.array_equal(pictures[0], pictures[2])


def test_the_packaged_network_sees_nobody_in_drawn_pictures(packaged: onnx.ModelProto) -> None:
    from gesture_core.plugin import registry
    from gesture_core.pose.models import find_model

    backend = registry().make("pose", "onnx", {}, model=find_model("compact"))
    found = [
        len(backend.estimate([draw(np.random.default_rng(90 + n), 240, 320)])[0])
        for draw in KINDS.values()
        for n in range(4)
    ]
    assert np.mean(found) <= 0.03
