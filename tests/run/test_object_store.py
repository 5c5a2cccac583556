"""An S3 server on the loopback: many objects, faults of listings, slow and cut reads, a replaced object."""

from __future__ import annotations

import http.client
import shutil
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest
from troubles import write_clip

from gesture_core import classify_archive
from gesture_core.demo.archive import DemoArchive
from gesture_core.errors import InputError
from gesture_core.files import cache_dir
from gesture_core.run.extract import Listener
from gesture_core.run.pipeline import RunSummary
from gesture_core.types import Row

pytest.importorskip("s3fs", reason="s3fs is not installed: pip install 'gesture-core[s3]'")
moto = pytest.importorskip("moto.server", reason="moto's server is not installed: pip install 'moto[server]'")
pytestmark = pytest.mark.slow
KEY, SECRET = "AKIDEXAMPLE", "wJalrXUtnFEMI-never-shown"


class Faulty(BaseHTTPRequestHandler):
    """Hands on to the server, with faults on the way.

    Attributes
    ----------
    failing, cut : int
        Listings that are answered with 500, and objects of which half is sent, from now on.
    pause : float
        Seconds in the middle of an object.
    seen : list of str
        Methods and paths.
    """

    protocol_version = "HTTP/1.1"
    behind: ClassVar[int] = 0
    failing: ClassVar[int] = 0
    cut: ClassVar[int] = 0
    pause: ClassVar[float] = 0.0
    seen: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        kind = type(self)
        kind.seen.append(f"{self.command} {self.path}")
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        server = http.client.HTTPConnection("127.0.0.1", kind.behind)
        server.request(self.command, self.path, body, dict(self.headers))
        answer = server.getresponse()
        data, listing = answer.read(), "list-type" in self.path
        if listing and kind.failing > 0:
            kind.failing -= 1
            self.send_response(500)
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        self.send_response(answer.status)
        for name, value in answer.getheaders():
            if name.lower() not in ("transfer-encoding", "connection", "date", "server"):
                self.send_header(name, value)
        self.end_headers()
        whole = listing or self.command != "GET" or answer.status >= 300
        if not whole and kind.cut > 0:
            kind.cut -= 1
            self.wfile.write(data[: len(data) // 2])
            self.close_connection = True
            return
        if not whole and kind.pause:
            self.wfile.write(data[: len(data) // 2])
            self.wfile.flush()
            time.sleep(kind.pause)
            data = data[len(data) // 2 :]
        self.wfile.write(data)

    do_HEAD = do_PUT = do_POST = do_GET

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing."""


@pytest.fixture(scope="module")
def server() -> Iterator[type[Faulty]]:
    store = moto.ThreadedMotoServer(port=0, verbose=False)
    store.start()
    Faulty.behind = store.get_host_and_port()[1]
    front = ThreadingHTTPServer(("127.0.0.1", 0), Faulty)
    threading.Thread(target=front.serve_forever, daemon=True).start()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{front.server_port}")
        patch.setenv("AWS_ACCESS_KEY_ID", KEY)
        patch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        yield Faulty
    front.shutdown()
    store.stop()


@pytest.fixture
def archive(
    server: type[Faulty], tmp_path: Path, thorough: bool, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Path]:
    """The folder of what lies in the bucket as well: clips and examples."""
    import s3fs

    monkeypatch.setenv("GESTURE_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "archive"
    for joint, label in ((4, "right"), (7, "left")):
        write_clip(folder / "examples" / label / "1.npz", 40, joint)
    clips = [(4, 7)[number % 2] for number in range(8)]
    for number, joint in enumerate(clips):
        write_clip(tmp_path / "clips" / f"{number}.npz", 30, joint, number)
    for number in range(1000 if thorough else 24):
        place = folder / "videos" / f"{number % 10}" / f"{number:04d}.npz"
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(tmp_path / "clips" / f"{number % 8}.npz", place)
    system = s3fs.S3FileSystem(skip_instance_cache=True)
    system.mkdir("clips")
    for file in folder.rglob("*.npz"):
        system.pipe(f"clips/{file.relative_to(folder).as_posix()}", file.read_bytes())
    server.seen.clear()
    yield folder
    server.failing = server.cut = 0
    server.pause = 0.0
    reset = http.client.HTTPConnection("127.0.0.1", server.behind)
    reset.request("POST", "/moto-api/reset")
    assert reset.getresponse().status == 200


def classify(sources: str, examples: str, out: Path, **options: Any) -> RunSummary:
    options = {"engine": "inline", "classify__kernel": "numpy", **options}
    return classify_archive(sources, examples, out, "paper", **options)


def far(out: Path, **options: Any) -> RunSummary:
    return classify("s3://clips/videos", "s3://clips/examples", out, **options)


def results(summary: RunSummary) -> list[tuple[Any, ...]]:
    return [
        (row.input.rpartition("videos/")[2], row.sha256, row.label, row.distance, row.status, row.message)
        for row in summary.rows()
    ]


def test_a_bucket_is_a_folder(archive: Path, server: type[Faulty], tmp_path: Path) -> None:
    expected = classify(str(archive / "videos"), str(archive / "examples"), tmp_path / "near")
    summary = far(tmp_path / "far", engine="processes", workers=1)
    assert results(summary) == results(expected)
    assert far(tmp_path / "far").done_now == 0
    assert results(far(tmp_path / "again")) == results(expected)
    assert not list((cache_dir() / "fetched").rglob("*.npz"))
    for file in (path for path in tmp_path.rglob("*") if path.is_file() and path.stat().st_size < 1 << 24):
        assert SECRET.encode() not in file.read_bytes() and KEY.encode() not in file.read_bytes()


def test_a_listing_fault_is_tried_again_and_half_a_listing_is_none(
    archive: Path, server: type[Faulty], tmp_path: Path
) -> None:
    server.failing = 2
    before = results(far(tmp_path / "far"))
    server.failing = 10_000
    with pytest.raises(InputError) as caught:
        far(tmp_path / "far")
    assert SECRET not in str(caught.value) and "s3://clips" in str(caught.value)
    server.failing = 0
    again = far(tmp_path / "far")
    assert (again.done_now, again.gone) == (0, 0) and results(again) == before


def test_slow_and_cut_reads_cost_time_and_nothing_else(
    archive: Path, server: type[Faulty], tmp_path: Path
) -> None:
    expected = classify(str(archive / "videos"), str(archive / "examples"), tmp_path / "near")
    server.cut, server.pause = 3, 0.02
    assert results(far(tmp_path / "far")) == results(expected)


def test_what_was_read_once_is_known_by_its_etag(
    archive: Path, server: type[Faulty], tmp_path: Path, drawn: DemoArchive
) -> None:
    """Of a video nothing is read again, whatever it is called and in whichever run it is asked for."""
    import s3fs

    system = s3fs.S3FileSystem(skip_instance_cache=True)
    system.put_file(str(drawn.videos / "clip_01.mp4"), "clips/films/a.mp4")
    options = {"pose__model": "compact", "pose__rate": 5}
    (first,) = classify("s3://clips/films", "s3://clips/examples", tmp_path / "one", **options).rows()
    system.copy("clips/films/a.mp4", "clips/films/b.mp4")
    server.seen.clear()
    (_, second) = classify("s3://clips/films", "s3://clips/examples", tmp_path / "two", **options).rows()
    assert (first.sha256, first.label, first.distance) == (second.sha256, second.label, second.distance)
    assert first.frames_read > 10 and not [
        line for line in server.seen if line.startswith("GET /clips/films")
    ]


class Replacing(Listener):
    """Replaces an object when the first row is there."""

    def __init__(self, name: str, data: bytes) -> None:
        self._name, self._data = name, data

    def row(self, row: Row) -> None:
        if self._data:
            import s3fs

            s3fs.S3FileSystem(skip_instance_cache=True).pipe(self._name, self._data)
            self._data = b""


def test_an_object_that_is_replaced_during_the_run_is_done_again(
    archive: Path, server: type[Faulty], tmp_path: Path
) -> None:
    last = max((archive / "videos").rglob("*.npz"))
    name = f"clips/{last.relative_to(archive).as_posix()}"
    other = next(p for p in (tmp_path / "clips").iterdir() if p.read_bytes() != last.read_bytes())
    far(tmp_path / "far", listener=Replacing(name, other.read_bytes()))
    shutil.copy(other, last)
    expected = classify(str(archive / "videos"), str(archive / "examples"), tmp_path / "near")
    summary = far(tmp_path / "far", retry_errors=True)
    assert results(summary) == results(expected)
    assert far(tmp_path / "far").done_now == 0
