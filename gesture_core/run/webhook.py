"""Events sent to an address on the web, one after the other, without holding up who finds them."""

from __future__ import annotations

import json
import queue
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from contextlib import suppress
from http.client import HTTPException
from typing import Any
from urllib.parse import urlsplit

from gesture_core.errors import ConfigError

_ROOM = 100
_SECONDS = 5.0
_WAITS = (0.5, 2.0)
"""Seconds before a second and a third attempt."""


class _Here(urllib.request.HTTPRedirectHandler):
    """Follows nobody: the other address would be asked, not posted to, and the event counted as delivered."""

    def redirect_request(self, *_: Any) -> None:
        """No further request: the answer is an error, with its number."""


class Webhook:
    """Posts JSON. Use as a context manager; at its end, what waits has a few seconds left.

    Parameters
    ----------
    url : str
        ``http://`` or ``https://``.
    say : callable
        Takes what could not be delivered, as a text.

    Raises
    ------
    ConfigError
        Where the address is none.

    Attributes
    ----------
    undelivered : int
    """

    def __init__(self, url: str, say: Callable[[str], None]) -> None:
        try:
            parts = urlsplit(url)
        except ValueError:  # such as a bracket that is never closed
            parts = urlsplit("")
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ConfigError(f"--webhook {url!r}", remedy="http://… or https://…", code="E_OPTION")
        self._url, self._say = url, say
        self._opener = urllib.request.build_opener(_Here)
        self._where = f"{parts.scheme}://{parts.hostname}"
        self.undelivered = 0
        self._queue: queue.Queue[bytes | None] = queue.Queue(_ROOM)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="webhook", daemon=True)

    def __enter__(self) -> Webhook:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        with suppress(queue.Full):
            self._queue.put_nowait(None)
        self._thread.join(_SECONDS + 1)
        self.undelivered += self._queue.qsize()

    def send(self, tree: Mapping[str, Any]) -> None:
        """Hand over one event."""
        try:
            self._queue.put_nowait(json.dumps(tree, ensure_ascii=False).encode())
        except queue.Full:
            self._failed("too many events wait")

    def _run(self) -> None:
        while (data := self._queue.get()) is not None:
            fault = ""
            for wait in (*_WAITS, None):
                fault = self._post(data)
                if not fault or wait is None:
                    break
                self._stopped.wait(wait)
            if fault:
                self._failed(fault)

    def _post(self, data: bytes) -> str:
        """Why it was not taken; empty where it was."""
        request = urllib.request.Request(
            self._url, data, {"Content-Type": "application/json", "User-Agent": "gesture-core"}
        )
        try:
            with self._opener.open(request, timeout=_SECONDS):
                return ""
        except urllib.error.HTTPError as error:
            return f"answered {error.code}"
        except (OSError, ValueError, HTTPException) as error:  # the last is an answer that is no HTTP
            return str(getattr(error, "reason", error)) or type(error).__name__

    def _failed(self, fault: str) -> None:
        self.undelivered += 1
        self._say(f"an event was not delivered to {self._where}: {fault}")
