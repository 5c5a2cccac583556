"""What `gesture watch` sees, on a page of this machine: MJPEG on the loopback, behind a random address."""

from __future__ import annotations

import hmac
import secrets
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

import numpy as np

from gesture_core.pose.overlay import draw_pose
from gesture_core.skeletons import skeleton
from gesture_core.types import PoseSequence

_HEIGHT = 480
_WAIT = 1.0
_BLANK = (640, 480)
"""Width and height of the picture where the source has keypoints, and does not say."""


class Preview:
    """The newest frame with its keypoints, for whoever knows the address. Use as a context manager.

    Attributes
    ----------
    address : str
        ``http://127.0.0.1:<port>/<token>/``; other addresses are not answered.
    """

    def __init__(self) -> None:
        self._token = secrets.token_urlsafe(24)
        self._newest: tuple[np.ndarray | None, PoseSequence] | None = None
        self._number = 0
        self._watchers = 0
        self._changed = threading.Condition()
        self._stopped = False
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self._server.daemon_threads = True
        self.address = f"http://127.0.0.1:{self._server.server_port}/{self._token}/"
        self._thread = threading.Thread(target=self._server.serve_forever, name="preview", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._stopped = True
            self._changed.notify_all()
        self._server.shutdown()
        self._server.server_close()

    def show(self, picture: np.ndarray | None, pose: PoseSequence) -> None:
        """Take the next frame; it is drawn only where somebody looks."""
        if not self._watchers:
            return
        with self._changed:
            self._newest = None if picture is None else picture.copy(), pose
            self._number += 1
            self._changed.notify_all()

    def pictures(self) -> Iterator[bytes]:
        """JPEG pictures, the newest whenever there is one."""
        seen = 0
        with self._changed:
            self._watchers += 1
        try:
            while True:
                with self._changed:
                    if self._number == seen and not self._stopped:
                        self._changed.wait(_WAIT)
                    newest, fresh, seen = self._newest, self._number != seen, self._number
                    if self._stopped:
                        return
                if newest is not None and fresh:
                    yield drawn(*newest)
        finally:
            with self._changed:
                self._watchers -= 1

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        preview = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                port = preview._server.server_port
                # A page elsewhere may have its own name lead to this machine; it does not know the token.
                own = self.headers.get("Host") in (f"127.0.0.1:{port}", f"localhost:{port}")
                if not own or not hmac.compare_digest(self.path.encode(), f"/{preview._token}/".encode()):
                    self.send_error(404)
                    return
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.send_header("Cache-Control", "no-store")
                self.end_headers()
                try:
                    for data in preview.pictures():
                        head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                        self.wfile.write(head.encode() + data + b"\r\n")
                except OSError:  # the page was closed
                    return

            def log_message(self, format: str, *args: object) -> None:
                """Nothing: standard error is for what is seen."""

        return Handler


def drawn(picture: np.ndarray | None, pose: PoseSequence) -> bytes:
    """A frame with its keypoints as JPEG, at most 480 lines high."""
    import cv2

    if picture is None:
        wide, high = pose.frame_size or _BLANK
        picture = np.zeros((high, wide, 3), np.uint8)
    for keypoints in pose.flat.keypoints:
        draw_pose(picture, keypoints, skeleton(pose.skeleton))
    if picture.shape[0] > _HEIGHT:
        size = max(1, round(picture.shape[1] * _HEIGHT / picture.shape[0])), _HEIGHT
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", picture)[1].tobytes()
