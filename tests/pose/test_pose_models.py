"""Networks by name and by file: found, added, verified, downloaded; nothing half done, nothing unsafe."""

from __future__ import annotations

import errno
import hashlib
import http.server
import json
import os
import threading
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import onnx
import pytest
from tiny_networks import dot_network, random_maps

from gesture_core.cli.main import run
from gesture_core.errors import GestureError, ModelError
from gesture_core.pose import models as models_module
from gesture_core.pose.downloads import downloaded
from gesture_core.pose.model_store import add_model, added_names, read_card, verify_models
from gesture_core.pose.models import find_model, known_models
from gesture_core.run.fingerprint import pose_identity, pose_keys
from gesture_core.run.inputs import Input
from gesture_core.settings import load_settings

VIDEO = Input(Path("clip.mp4"), "clip.mp4", "video")


@pytest.fixture(autouse=True)
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder of the user's own."""
    folder = tmp_path / "models"
    monkeypatch.setenv("GESTURE_MODELS", str(folder))
    monkeypatch.delenv("GESTURE_OFFLINE", raising=False)
    return folder


@pytest.fixture
def network(tmp_path: Path) -> Path:
    return random_maps(tmp_path / "My Network.onnx")


def sha(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def everything(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*")) if folder.exists() else []


def test_a_file_is_found_with_its_hash_and_its_layout(network: Path) -> None:
    for name in (network, str(network)):
        found = find_model(name)
        assert found.path == network and found.sha256 == sha(network)
        assert found.contract is not None and found.contract.layout == "openpose"


def test_known_networks_are_known_by_their_hash(shared_models: Path, tmp_path: Path) -> None:
    renamed = tmp_path / "renamed.onnx"
    renamed.write_bytes((shared_models / "movenet_lightning_dequantised_192.onnx").read_bytes())
    found = find_model(renamed)
    assert found.name == "movenet-lightning"
    assert found.contract is not None and found.contract.licence == "Apache-2.0"
    lines = [line.split() for line in (shared_models / "SHA256SUMS").read_text().splitlines()]
    listed = {file: sha256 for sha256, file in lines}
    for known in known_models().values():
        for file in known.files:
            if file in listed:
                assert listed[file] in known.sha256


def test_unknown_names_have_a_remedy() -> None:
    with pytest.raises(ModelError, match="did you mean 'hpe0001'"):
        find_model("hpe001")
    with pytest.raises(ModelError, match=r"E_MODEL_MISSING.*gesture models add"):
        find_model("hpe0001")
    with pytest.raises(ModelError, match=r"E_MODEL_MISSING.*'gesture models get rtmpose-s'"):
        find_model("rtmpose-s")
    with pytest.raises(ModelError, match="E_NOT_FOUND"):
        find_model("no/such/file.onnx")
    with pytest.raises(ModelError, match="not a model file's"):
        find_model("some/file.txt")


@pytest.mark.parametrize("name", ["..", "../x", "a/../b", "a..b", ".hidden", "A", "a b", "", "-a", "x" * 300])
def test_no_name_leaves_the_folder(name: str, network: Path, models: Path) -> None:
    if name:
        with pytest.raises(GestureError):
            add_model(network, name)
    with pytest.raises(ModelError):
        read_card(name)
    assert [e for e in everything(models) if not e.startswith(".")] == []


def test_an_added_network_is_found_by_name_and_verified(network: Path, models: Path) -> None:
    card = add_model(network, licence="CC0-1.0")
    assert card.name == "my-network" and added_names() == ("my-network",)
    network.unlink()
    found = find_model("my-network")
    assert found.path.is_relative_to(models) and found.contract == card.contract
    assert [trouble for name, _, trouble in verify_models() if name == "my-network"] == [""]
    card.path.write_bytes(card.path.read_bytes() + b"x")
    (trouble,) = [trouble for name, _, trouble in verify_models() if name == "my-network"]
    assert "E_MODEL_HASH" in trouble
    with pytest.raises(ModelError, match="E_MODEL_CHANGED"):
        find_model("my-network").read()


def test_a_wrong_hash_leaves_nothing_behind(network: Path, models: Path) -> None:
    with pytest.raises(ModelError, match="E_MODEL_HASH"):
        add_model(network, "mine", sha256="0" * 64)
    with pytest.raises(ModelError, match="no SHA-256"):
        add_model(network, "mine", sha256="abc")
    assert everything(models) == []
    assert add_model(network, "mine", sha256=sha(network).upper()).sha256 == sha(network)


def test_a_name_is_replaced_only_when_asked(network: Path, models: Path, tmp_path: Path) -> None:
    add_model(network, "mine")
    other = random_maps(tmp_path / "other.onnx", seed=9)
    with pytest.raises(ModelError, match="E_MODEL_EXISTS"):
        add_model(other, "mine")
    assert find_model("mine").sha256 == sha(network)
    add_model(other, "mine", replace=True)
    assert find_model("mine").sha256 == sha(other)
    assert everything(models) == ["mine", f"mine/{read_card('mine').path.name}", "mine/model.json"]
    with pytest.raises(ModelError, match="own network"):
        add_model(other, "compact")


def test_a_replacement_that_ends_anywhere_leaves_the_old_model_or_the_new_one(
    network: Path, models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = random_maps(tmp_path / "other.onnx", seed=9)
    rename, outcomes = Path.replace, []
    for fatal in range(1, 10):
        add_model(network, "mine", replace=True)
        calls = 0

        def breaking(path: Path, target: Path, fatal: int = fatal) -> Path:
            nonlocal calls
            calls += 1
            if calls == fatal:
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            return rename(path, target)

        with monkeypatch.context() as patch, suppress(OSError):
            patch.setattr(Path, "replace", breaking)
            add_model(other, "mine", replace=True)
        outcomes.append(find_model("mine").sha256)
        find_model("mine").read()
        assert [trouble for name, _, trouble in verify_models() if name == "mine"] == [""]
        if calls < fatal:
            break
    assert outcomes[0] == sha(network) and outcomes[-1] == sha(other) and len(outcomes) > 2
    assert everything(models) == ["mine", f"mine/{read_card('mine').path.name}", "mine/model.json"]


def test_what_a_killed_addition_left_goes_after_a_day(network: Path, models: Path) -> None:
    for name in (".adding-old", ".adding-new"):
        (models / name).mkdir(parents=True)
        (models / name / "model.onnx").touch()
    os.utime(models / ".adding-old", (0, 0))
    add_model(network, "mine")
    assert sorted(path.name for path in models.iterdir()) == [".adding-new", "mine"]


def test_keypoints_of_another_contract_are_not_used_again(network: Path) -> None:
    settings = load_settings(sets=["pose.model=mine"], environment={})
    keys = set()
    for score in (0.1, 0.4):
        add_model(network, "mine", contract={"score": score}, replace=True)
        keys.add(pose_keys(pose_identity(settings, [VIDEO]))["video"])
    assert len(keys) == 2


def test_a_contract_may_be_corrected(network: Path) -> None:
    card = add_model(network, "mine", contract={"colour": "rgb", "mean": [1, 2, 3]})
    assert card.contract is not None
    assert (card.contract.colour, card.contract.mean, card.contract.layout) == ("rgb", (1, 2, 3), "openpose")
    with pytest.raises(ModelError, match=r"a contract has no wings"):
        add_model(network, "other", contract={"wings": 2})
    # A file whose origin is unknown, under a known name, is fed as that network is.
    named = add_model(network, "openpose-coco")
    assert named.contract is not None and named.contract.mean == (128.0, 128.0, 128.0)


def test_a_damaged_card_is_an_error_of_its_own(network: Path, models: Path, tmp_path: Path) -> None:
    add_model(network, "mine")
    card = models / "mine" / "model.json"
    good = json.loads(card.read_text())
    outside = tmp_path / "outside.onnx"
    outside.write_bytes(b"secret")
    for change in (
        {"file": "../../outside.onnx"},
        {"file": str(outside)},
        {"file": 3},
        {"contract": {"a": 1}},
    ):
        card.write_text(json.dumps({**good, **change}))
        with pytest.raises(ModelError, match=r"E_MODEL_C"):
            find_model("mine")
        assert any("E_MODEL" in trouble for _, _, trouble in verify_models())
    for text in ("", "[]", "null", '{"file": "model.onnx"}', "\udcff".encode("utf-8", "surrogatepass")):
        card.write_bytes(text if isinstance(text, bytes) else text.encode())
        with pytest.raises(ModelError, match="E_MODEL_CARD"):
            find_model("mine")
    card.write_text(json.dumps(good))
    (models / "mine" / good["file"]).unlink()
    (models / "mine" / good["file"]).symlink_to(outside)
    with pytest.raises(ModelError, match="is a link"):
        find_model("mine")


def test_large_files_and_strange_files_are_refused(
    network: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "pipe.onnx")
    with pytest.raises(ModelError, match="regular file"):
        find_model(tmp_path / "pipe.onnx")
    with pytest.raises(ModelError, match="E_NOT_FOUND"):
        find_model(tmp_path / "models.onnx")
    (tmp_path / "folder.onnx").mkdir()
    with pytest.raises(ModelError, match="E_MODEL_FILE"):
        find_model(tmp_path / "folder.onnx")
    monkeypatch.setattr(models_module, "MAX_BYTES", 100)
    with pytest.raises(ModelError, match="E_MODEL_SIZE"):
        find_model(network)


def test_weights_in_other_files_are_never_added(network: Path, tmp_path: Path, models: Path) -> None:
    outside = tmp_path / "outside.onnx"
    onnx.save(onnx.load(network), outside, save_as_external_data=True, size_threshold=0)
    with pytest.raises(ModelError, match="E_MODEL_EXTERNAL"):
        add_model(outside, "mine")
    assert everything(models) == []


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    """The address of a server that offers ``tmp_path / 'site'``."""
    (tmp_path / "site").mkdir()

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    handler = partial(Quiet, directory=str(tmp_path / "site"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as web:
        thread = threading.Thread(target=web.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{web.server_port}"
        web.shutdown()
        thread.join()


def test_a_download_is_asked_for_hashed_and_complete(
    server: str,
    tmp_path: Path,
    models: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = dot_network(tmp_path / "site" / "dots.onnx")
    url = f"{server}/dots.onnx"
    assert run(["models", "add", url]) == 2 and "--sha256" in capsys.readouterr().err
    assert run(["models", "add", url, "--sha256", "0" * 64]) == 1
    assert "E_MODEL_HASH" in capsys.readouterr().err and everything(models) == []
    assert run(["models", "add", f"{server}/none.onnx", "--sha256", sha(path)]) == 1
    assert "E_MODEL_URL" in capsys.readouterr().err and everything(models) == []
    monkeypatch.setenv("GESTURE_OFFLINE", "1")
    assert run(["models", "add", url, "--sha256", sha(path)]) == 1
    assert "E_OFFLINE" in capsys.readouterr().err
    monkeypatch.delenv("GESTURE_OFFLINE")
    assert run(["models", "add", url, "--sha256", sha(path), "--name", "dots"]) == 0
    assert find_model("dots").sha256 == sha(path) and read_card("dots").origin == url


def test_a_server_cannot_send_without_end(server: str, tmp_path: Path) -> None:
    path = dot_network(tmp_path / "site" / "dots.onnx")
    with (
        pytest.raises(ModelError, match="E_MODEL_SIZE"),
        downloaded(f"{server}/dots.onnx", sha(path), limit=100),
    ):
        pass


@pytest.mark.parametrize(
    "url", ["file:///etc/passwd.onnx", "ftp://x/y.onnx", "https://x/y.exe", "https://x/"]
)
def test_only_model_files_are_fetched_and_only_from_the_web(url: str) -> None:
    assert run(["models", "add", url, "--sha256", "0" * 64]) == 1


def test_the_commands_say_what_is_there(network: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["models", "add", str(network), "--name", "mine", "--contract", "colour=rgb"]) == 0
    assert "--model mine" in capsys.readouterr().out
    for command in (["models"], ["models", "list"]):
        assert run(command) == 0
        out = capsys.readouterr().out
        assert "mine" in out and sha(network)[:12] in out and "hpe0001" in out and "non-commercial" in out
        listed = {one["name"]: one for one in map(json.loads, out.splitlines())}
        assert (listed["mine"]["status"], listed["mine"]["sha256"]) == ("added", sha(network))
        assert "https://" in listed["rtmpose-s"]["place"] and listed["compact"]["status"] == "packaged"
    assert run(["models", "verify"]) == 0
    assert {"name": "mine", "status": "ok"}.items() <= json.loads(
        capsys.readouterr().out.splitlines()[0]
    ).items()
    read_card("mine").path.write_bytes(b"")
    assert run(["models", "verify"]) == 3
    capsys.readouterr()
    for wrong, hint in (
        (["--contract", "colour"], "colour=rgb"),
        (["--name", "mine"], "--replace"),
        (["--name", "Mine"], "lower-case"),
    ):
        assert run(["models", "add", str(network), *wrong]) == 2
        assert hint in capsys.readouterr().err
