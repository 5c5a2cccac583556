"""What auto stands for: the strongest network that is here, a backend that reads it, what it runs on."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import pytest

from gesture_core.errors import ConfigError, GestureError, PluginError
from gesture_core.plugin import registry
from gesture_core.pose.extract import open_backend
from gesture_core.pose.models import CARD, auto_models, choose_pose, described, known_models
from gesture_core.run.fingerprint import pose_identity
from gesture_core.run.inputs import Input
from gesture_core.settings import Settings, load_settings

VIDEO = Input(Path("clip.mp4"), "clip.mp4", "video")


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder of the user's own."""
    monkeypatch.setenv("GESTURE_MODELS", str(tmp_path))
    return tmp_path


def settings(**changes: Any) -> Settings:
    return load_settings("modern", environment={}, **changes)


def put(folder: Path, name: str, suffix: str) -> None:
    """A file that stands for an added network."""
    (folder / name).mkdir()
    known = known_models()[name]
    assert known.contract is not None
    card = {"file": f"model{suffix}", "sha256": known.sha256[0], "contract": known.contract.as_table()}
    (folder / name / CARD).write_text(json.dumps(card))
    (folder / name / f"model{suffix}").write_bytes(b"")


def test_the_strongest_network_that_is_here_is_taken_with_a_backend_that_reads_it(models: Path) -> None:
    assert auto_models() == ("blazepose", "compact")
    pose = choose_pose(settings()).pose
    assert (pose.model, pose.backend, pose.provider, pose.target) == ("compact", "onnx", "cpu", "auto")
    put(models, "blazepose", ".tflite")
    pose = choose_pose(settings()).pose
    assert (pose.model, pose.backend, pose.provider, pose.target) == (
        "blazepose",
        "opencv-dnn",
        "auto",
        "cpu",
    )
    assert choose_pose(settings(pose__model="compact")).pose.backend == "onnx"
    chosen = choose_pose(settings(pose__model="compact", pose__backend="opencv-dnn"))
    assert chosen.pose.target == "cpu" and choose_pose(chosen) == chosen


@pytest.mark.parametrize(
    "changes", [{"pose__backend": "onnx"}, {"pose__provider": "cpu"}, {"pose__provider": "cuda"}]
)
def test_auto_takes_a_network_that_what_is_named_can_run(changes: dict[str, str], models: Path) -> None:
    put(models, "blazepose", ".tflite")
    if changes == {"pose__provider": "cuda"}:
        with pytest.raises(GestureError, match="onnxruntime: -gpu") as caught:
            choose_pose(settings(**changes))
        assert caught.value.code == "E_PROVIDER"
        return
    pose = choose_pose(settings(**changes)).pose
    assert (pose.model, pose.backend, pose.provider) == ("compact", "onnx", "cpu")
    assert choose_pose(settings(pose__target="cpu")).pose.model == "blazepose"


def test_it_is_said_and_recorded(models: Path) -> None:
    text = "compact on onnx (cpu), about 172 frames/s a core"
    assert described(choose_pose(settings())) == text
    hinted = described(choose_pose(settings()), hint=True)
    assert hinted.startswith(f"{text}; 'gesture models get blazepose' brings")
    before = pose_identity(settings(), [VIDEO])["video"]
    put(models, "blazepose", ".tflite")
    after = pose_identity(settings(), [VIDEO])["video"]
    assert after["settings"]["model"] == "blazepose" != before["settings"]["model"]
    assert after["model"]["finder"] == before["model"]["sha256"]
    assert "models get" not in described(choose_pose(settings()), hint=True)


@pytest.mark.parametrize(
    ("changes", "code", "remedy"),
    [
        ({"pose__provider": "cuda"}, "E_PROVIDER", "onnxruntime: -gpu"),
        ({"pose__target": "cpu"}, "E_OPTION", "pose.provider"),
        ({"pose__backend": "opencv-dnn", "pose__target": "vulkan"}, "E_PROVIDER", "pose.target=auto"),
        ({"pose__backend": "opencv-dnn", "pose__provider": "cpu"}, "E_OPTION", "pose.target"),
        ({"pose__model": "hpe0001"}, "E_MODEL_MISSING", "gesture models add"),
    ],
)
def test_what_is_asked_for_and_not_there_is_an_error(
    changes: dict[str, str], code: str, remedy: str, models: Path
) -> None:
    with pytest.raises(GestureError, match=remedy) as caught:
        choose_pose(settings(**changes))
    assert caught.value.code == code
    assert "video" not in pose_identity(settings(**changes), []), "keypoint files need none of it"


def test_the_device_of_a_backends_own_option_is_checked_and_recorded(models: Path) -> None:
    wrong = settings().with_values([("pose.model", "compact"), ("onnx.device", "cuda")])
    with pytest.raises(ConfigError, match=r"onnx\.device = 'cuda'.*onnxruntime: -gpu") as caught:
        choose_pose(wrong)
    assert caught.value.code == "E_PROVIDER"
    right = settings().with_values([("pose.model", "compact"), ("onnx.device", "cpu")])
    assert choose_pose(right).pose.provider == "cpu"


def test_options_of_a_backend_that_auto_does_not_take_are_not_dropped(models: Path) -> None:
    lost = settings().with_values([("opencv-dnn.batch_size", 2)])
    with pytest.raises(ConfigError, match=r"options of 'opencv-dnn', and compact is run by 'onnx'.*--pose"):
        choose_pose(lost)
    assert choose_pose(lost.with_values([("onnx.batch_size", 2)])).pose.backend == "onnx"
    assert choose_pose(lost.with_values([("pose.backend", "opencv-dnn")])).pose.backend == "opencv-dnn"


@pytest.mark.parametrize(
    "answer", ["raise RuntimeError('no driver')", "return None", "return {'provider': 3}"]
)
def test_what_a_backend_raises_when_asked_for_its_devices_names_it(
    answer: str, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = registry().load("pose", "onnx")
    made: dict[str, Any] = {}
    exec(f"def devices(cls): {answer}", made)
    monkeypatch.setattr(kind, "devices", classmethod(made["devices"]))
    with pytest.raises(PluginError, match=r"pose backend 'onnx' of .* raised") as caught:
        choose_pose(settings(pose__model="compact"))
    assert caught.value.code == "E_PLUGIN_RAISED"


def test_a_stronger_network_whose_backend_fails_is_not_passed_over_without_a_word(
    models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(models, "blazepose", ".tflite")

    def devices(cls: type) -> dict[str, list[str]]:
        raise RuntimeError("no driver")

    monkeypatch.setattr(registry().load("pose", "opencv-dnn"), "devices", classmethod(devices))
    with pytest.warns(UserWarning, match=r"the network blazepose is not used: .*'opencv-dnn'.*no driver"):
        chosen = choose_pose(settings())
    assert chosen.pose.model == "compact"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert choose_pose(settings(pose__backend="onnx")).pose.model == "compact", "as it was asked for"


@pytest.mark.parametrize("there", [("follow", "crop"), ("steady",), ("region",)])
def test_a_backend_with_a_part_of_an_ability_is_an_error(
    there: tuple[str, ...], models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = type("Partly", (), {"skeleton": "coco18", "batch_size": 1, **dict.fromkeys(there, 1)})
    monkeypatch.setattr(type(registry()), "make", lambda *_, **__: kind())
    with pytest.raises(PluginError, match=f"it has {' and '.join(there)} but no ") as caught:
        open_backend(settings(pose__model="compact"))
    assert caught.value.code == "E_PLUGIN_CONTRACT"
