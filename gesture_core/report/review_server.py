"""The page of a run, served to this machine alone, with answers that come back."""

from __future__ import annotations

import hmac
import json
import re
import secrets
from collections.abc import Iterable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from gesture_core.errors import ConfigError, GestureError
from gesture_core.report.run_page import DATA, INDEX
from gesture_core.run.review import NONE, Answers

_KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".mp4": "video/mp4"} | {
    ".svg": "image/svg+xml",
    ".jpg": "image/jpeg",
}
_LONGEST = 4096
"""Bytes of an answer."""
_LONGEST_LABEL = 200
_RANGE = re.compile(r"bytes=(\d+)-(\d*)")
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class ReviewServer(ThreadingHTTPServer):
    """Serves a page that `run_page.write_report` wrote, and keeps answers.

    It listens on the loopback only, answers nobody who does not know the random part of `address`, and no
    page of another host. The port is its own from the beginning, so that one in use is noticed before the
    page is made; `show` says what is served.

    Parameters
    ----------
    answers : Answers
        Of the run, whose rows are those of the page.
    port : int
        0 for any that is free.

    Raises
    ------
    ConfigError
        ``E_OPTION`` where the port cannot be had.
    """

    daemon_threads = True

    def __init__(self, answers: Answers, port: int = 0) -> None:
        try:
            super().__init__(("127.0.0.1", port), _Handler)
        except OSError as error:
            raise ConfigError(
                f"--port {port} cannot be had: {error.strerror or error}",
                remedy="another one, or no --port for any that is free",
                code="E_OPTION",
            ) from error
        self.answers = answers
        self.folder, self.files, self.labels = Path(), set[str](), frozenset[str]()
        self.token = secrets.token_urlsafe(24)

    def show(self, folder: Path, labels: Iterable[str]) -> None:
        """Serve the page in ``folder``, as it is now; ``labels`` are those of the examples."""
        self.folder, self.labels = folder, frozenset(labels)
        self.files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}

    @property
    def address(self) -> str:
        """What to open."""
        return f"http://127.0.0.1:{self.server_port}/{self.token}/"

    def page_data(self) -> bytes:
        """The data of the page, with the answers so far."""
        given = [[place, label] for place, label in self.answers.given().items()]
        review = json.dumps({"answers": given}, ensure_ascii=True).replace("<", "\\u003c")
        return (self.folder / DATA).read_bytes() + f"window.gestureData.review={review};\n".encode("ascii")


def _is_label(label: object) -> bool:
    """Whether it may be the label of a gesture that no example shows yet."""
    plain = isinstance(label, str) and label == label.strip() and label.isprintable()
    return plain and 0 < len(str(label).encode()) <= _LONGEST_LABEL


class _Handler(BaseHTTPRequestHandler):
    server: ReviewServer
    protocol_version = "HTTP/1.1"

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: standard error belongs to the command."""

    def do_GET(self) -> None:
        name = self._asked()
        if name is None:
            return
        name = name or INDEX
        if name not in self.server.files:
            self._refuse(HTTPStatus.NOT_FOUND)
            return
        path = self.server.folder / name
        try:
            content = self.server.page_data() if name == DATA else path.read_bytes()
        except (OSError, GestureError) as error:
            self._answer(HTTPStatus.INTERNAL_SERVER_ERROR, str(error).encode(), "text/plain")
            return
        self._send_file(content, _KINDS.get(path.suffix, "application/octet-stream"))

    def do_POST(self) -> None:
        name = self._asked()
        if name is None:
            return
        origin = self.headers.get("Origin")
        own = origin in (None, f"http://{self.headers.get('Host')}")
        length = self.headers.get("Content-Length", "")
        if name != "answers" or not own or self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.FORBIDDEN)
        elif not length.isdecimal() or int(length) > _LONGEST:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            self._take(self.rfile.read(int(length)))

    def _take(self, body: bytes) -> None:
        """Keep an answer: ``row``, and ``label`` (null for none of them) or ``forget``."""
        answers = self.server.answers
        try:
            tree = json.loads(body)
            place, label = tree["row"], tree.get("label")
            if type(place) is not int or not 0 <= place < len(answers.rows):
                raise ValueError("no such row")
            if label is not None and label not in self.server.labels and not _is_label(label):
                raise ValueError(f"a label is text of one line, {_LONGEST_LABEL} bytes at most")
            label = None if label == NONE else label
            if tree.get("forget"):
                answers.take_back(place)
            else:
                answers.give(place, label)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            self._answer(HTTPStatus.BAD_REQUEST, f"no answer: {error}".encode(), "text/plain")
        except GestureError as error:
            self._answer(HTTPStatus.INTERNAL_SERVER_ERROR, str(error).encode(), "text/plain")
        else:
            self._answer(HTTPStatus.NO_CONTENT, b"", "text/plain")

    def _asked(self) -> str | None:
        """What is asked for, below the secret part of the address; None once it has been refused."""
        hosts = {f"{name}:{self.server.server_port}" for name in ("127.0.0.1", "localhost")}
        _, token, name = (self.path.partition("?")[0] + "//").split("/", 2)
        if self.headers.get("Host") not in hosts:  # a foreign name that was made to lead here
            self._refuse(HTTPStatus.FORBIDDEN)
            return None
        if not hmac.compare_digest(token.encode("utf-8", "replace"), self.server.token.encode()):
            self._refuse(HTTPStatus.NOT_FOUND)
            return None
        return name.removesuffix("//").removesuffix("/")

    def _send_file(self, content: bytes, kind: str) -> None:
        """All of it, or the part that a player asks for."""
        asked = _RANGE.fullmatch(self.headers.get("Range", ""))
        first = int(asked[1]) if asked else 0
        last = min(int(asked[2]), len(content) - 1) if asked and asked[2] else len(content) - 1
        if asked is None:
            self._answer(HTTPStatus.OK, content, kind)
        elif first > last:
            self._answer(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, b"", kind)
        else:
            where = f"bytes {first}-{last}/{len(content)}"
            self._answer(HTTPStatus.PARTIAL_CONTENT, content[first : last + 1], kind, where)

    def _refuse(self, status: HTTPStatus) -> None:
        self.close_connection = True
        self._answer(status, status.phrase.encode(), "text/plain")

    def _answer(self, status: HTTPStatus, content: bytes, kind: str, where: str = "") -> None:
        self.send_response(status)
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", f"{kind}; charset=utf-8" if kind.startswith("text/") else kind)
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Content-Length", str(len(content)))
        if where:
            self.send_header("Content-Range", where)
        self.end_headers()
        try:
            self.wfile.write(content)
        except ConnectionError:  # the player has seen enough
            self.close_connection = True
