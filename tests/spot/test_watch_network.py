"""Live over the network: streams that break off or stall, and events that are posted."""

from __future__ import annotations

import json
import socketserver
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import cv2
import numpy as np
import pytest

from gesture_core.errors import ConfigError, InputError
from gesture_core.run.watch import Webhook
from gesture_core.spot.capture import Capture, Captured, Note
from gesture_core.spot.sources import Camera


@contextmanager
def served(connections: list[list[np.ndarray]], hold: float = 0.0) -> Iterator[str]:
    """An MJPEG stream on the loopback that shows these pictures, one list for each connection.

    After the last one, it says nothing for ``hold`` seconds.
    """
    waiting, ended = list(connections), threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if not waiting:
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            for picture in waiting.pop(0):
                data = cv2.imencode(".jpg", picture)[1].tobytes()
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                self.wfile.write(head.encode() + data + b"\r\n")
                time.sleep(0.02)
            ended.wait(hold)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        ended.set()
        server.shutdown()
        server.server_close()


def test_a_stream_on_the_network_that_breaks_off_is_opened_again() -> None:
    pictures = [np.full((48, 64, 3), 8 * number, np.uint8) for number in range(30)]
    with served([pictures, pictures]) as address, Capture(Camera(address), waits=(0.05,)) as capture:
        notes: list[str] = []
        frames = 0
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and sum("lost" in note for note in notes) < 2:
            found = capture.next(1.0)
            if isinstance(found, Captured):
                assert isinstance(found.given, np.ndarray) and found.given.shape == (48, 64, 3)
                frames += 1
            elif found:
                notes.append(found.text)
    assert frames > 1
    assert [note.partition(": ")[2] for note in notes][:2] == [
        "was lost; opened again in 0.05 s",
        "is back after 0 s",
    ]


def test_nothing_but_the_error_is_said_of_a_stream_that_breaks_off() -> None:
    script = (
        "import sys; from gesture_core.spot.sources import Camera; list(Camera(sys.argv[1]).frames(print))"
    )
    with served([[np.zeros((48, 64, 3), np.uint8)] * 5]) as address:
        done = subprocess.run(
            [sys.executable, "-c", script, address], capture_output=True, text=True, timeout=60
        )
    assert "http" not in done.stderr.partition("Traceback")[0]
    assert "was lost" in done.stderr


def test_a_stream_that_stalls_is_lost_and_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gesture_core.spot.sources.TIMEOUT", 1.0)
    pictures = [np.full((48, 64, 3), 8 * number, np.uint8) for number in range(30)]
    with (
        served([pictures, pictures], hold=20.0) as address,
        Capture(Camera(address), waits=(0.05,)) as capture,
    ):
        said: list[str] = []
        deadline = time.monotonic() + 40
        while time.monotonic() < deadline and not any("is back" in text for text in said):
            found = capture.next(1.0)
            said += [found.text] if isinstance(found, Note) else []
    assert [text.partition(": ")[2] for text in said][:1] == ["was lost; opened again in 0.05 s"]
    assert "is back after" in said[-1]


def test_what_a_decoder_still_has_after_a_stall_does_not_hide_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """FFmpeg gives up after the time-out, and OpenCV then gives the pictures that were in the decoder."""

    class Stalled:
        def __init__(self, *_: object) -> None:
            self.grabbed = 0

        def grab(self) -> bool:
            self.grabbed += 1
            now[0] += 0.1 if self.grabbed < 4 else 5.0
            return True

        def isOpened(self) -> bool:
            return True

        def release(self) -> None:
            pass

    now = [0.0]
    monkeypatch.setattr(cv2, "VideoCapture", Stalled)
    with pytest.raises(InputError, match="was lost"):
        list(Camera("rtsp://me:secret@host/1", lambda: now[0]).frames(print))
    assert now[0] == pytest.approx(5.3)


def test_a_camera_may_take_its_time_to_start(monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow:
        def __init__(self, *_: object) -> None:
            self.waits = [9.0, 0.1, 0.1]

        def set(self, *_: object) -> None:
            pass

        def grab(self) -> bool:
            now[0] += self.waits[0] if self.waits else 0.0
            return bool(self.waits and self.waits.pop(0))

        def isOpened(self) -> bool:
            return True

        def release(self) -> None:
            pass

    now, seen = [0.0], []
    monkeypatch.setattr(cv2, "VideoCapture", Slow)
    with pytest.raises(InputError, match="camera 0: was lost"):
        for seconds, _ in Camera(0, lambda: now[0]).frames(print):
            seen.append(seconds)
    assert seen == pytest.approx([0.0, 0.1, 0.2])


def test_the_webhook_gets_every_event_and_a_deaf_one_is_said() -> None:
    got: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            got.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    said: list[str] = []
    try:
        with Webhook(f"http://127.0.0.1:{server.server_port}/gestures", said.append) as hook:
            for number in range(3):
                hook.send({"label": "wave", "number": number})
    finally:
        server.shutdown()
        server.server_close()
    assert [one["number"] for one in got] == [0, 1, 2] and not said and not hook.undelivered
    with Webhook("http://127.0.0.1:9/", said.append) as hook:
        hook.send({"label": "wave"})
    assert hook.undelivered == 1 and "not delivered to http://127.0.0.1" in said[0]
    for address in ("file:///etc/passwd", "http://[::1"):
        with pytest.raises(ConfigError, match="--webhook"):
            Webhook(address, said.append)


def test_an_answer_that_is_no_http_costs_its_own_event_alone() -> None:
    answers = [b"what?\r\n\r\n"] * 3 + [b"HTTP/1.1 204 No Content\r\n\r\n"]

    class Odd(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            length = 0
            while (line := self.rfile.readline()).strip():
                name, _, value = line.partition(b":")
                length = int(value) if name.lower() == b"content-length" else length
            self.rfile.read(length)
            self.wfile.write(answers.pop(0))

    with socketserver.TCPServer(("127.0.0.1", 0), Odd) as server:
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        said: list[str] = []
        with Webhook(f"http://127.0.0.1:{server.server_address[1]}/", said.append) as hook:
            hook.send({"label": "wave"})
            hook.send({"label": "clap"})
            end = time.monotonic() + 20
            while answers and time.monotonic() < end:
                time.sleep(0.05)
        server.shutdown()
    assert hook.undelivered == 1 and len(said) == 1 and "not delivered" in said[0]


def test_an_event_that_is_led_elsewhere_is_not_delivered() -> None:
    """Whoever follows asks there, and posts nothing: the answer of a page to log in is no delivery."""
    asked: list[str] = []

    class Elsewhere(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["Content-Length"]))
            asked.append(self.path)
            self.send_response(302)
            self.send_header("Location", "/login")
            self.end_headers()

        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Elsewhere) as server:
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        said: list[str] = []
        with Webhook(f"http://127.0.0.1:{server.server_port}/gestures", said.append) as hook:
            hook.send({"label": "wave"})
        server.shutdown()
    assert hook.undelivered == 1 and "answered 302" in said[0] and set(asked) == {"/gestures"}
