"""Examples in, then the events of a live source: `watch`; and a `Webhook` for them."""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
import urllib.error
import urllib.request
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from http.client import HTTPException
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import numpy as np

from gesture_core.errors import ConfigError, GestureError, InputError
from gesture_core.files import printable
from gesture_core.pose.models import choose_pose, described
from gesture_core.run.addresses import shown
from gesture_core.run.archive import Sources, as_strings, with_changes
from gesture_core.run.extract import Listener, first_person, people_of
from gesture_core.run.inputs import discover
from gesture_core.run.labels import label_inputs
from gesture_core.settings import Settings
from gesture_core.spot.capture import Capture, Note
from gesture_core.spot.examples import NONE
from gesture_core.spot.sources import ADDRESSES, Camera, FrameSource, Keypoints, Recording, piped
from gesture_core.spot.spotter import Spotter
from gesture_core.spot.watch import Seen, Watch, WatchSummary
from gesture_core.types import Event, PoseSequence

_ROOM = 100
_SECONDS = 5.0
_WAITS = (0.5, 2.0)
"""Seconds before a second and a third attempt."""


def watch(
    source: str | os.PathLike[str] | int,
    examples: Sources,
    settings: Settings | str | None = None,
    *,
    labels: str = "folder",
    as_live: bool = False,
    **changes: Any,
) -> Iterator[Event]:
    """The events of a live source as they happen: `gesture watch` as a function.

    Parameters
    ----------
    source : int, str or path
        The number of a camera, the address of a stream (``rtsp://…``), a file, or ``-``: standard input.
    examples, settings, labels, changes
        As in `classify_archive`.
    as_live : bool
        Of a file: each frame comes when its second has come.

    Yields
    ------
    Event
        In seconds since the source was opened, of a file in its own time.

    Raises
    ------
    GestureError
        Where the source cannot be opened, or no example can be used.

    Examples
    --------
    >>> from gesture_core import watch
    >>> for event in watch(0, "examples/"):  # doctest: +SKIP
    ...     print(event.label, event.start, event.end)
    """
    ready = with_changes(settings, changes)
    with Watching(source, examples, ready, labels=labels, as_live=as_live) as opened:
        for found in opened:
            if isinstance(found, Seen):
                yield found.event


@dataclass
class Watching:
    """A source that is watched, as a context manager: iterate it once for events and notes.

    Attributes
    ----------
    source, examples, settings, labels, as_live
        As in `watch`.
    listener : Listener
        Told about the examples.
    on_frame : callable, optional
        As in `Watch`.
    """

    source: str | os.PathLike[str] | int
    examples: Sources
    settings: Settings
    labels: str = "folder"
    as_live: bool = False
    listener: Listener = field(default_factory=Listener)
    on_frame: Callable[[np.ndarray | None, PoseSequence], None] | None = None

    def __enter__(self) -> Self:
        if self.settings.pose.people != "single":
            raise ConfigError(
                "gesture watch follows one person",
                remedy="--set pose.people=single, or gesture spot on a recording",
                code="E_OPTION",
            )
        self._resources = ExitStack()
        opened = source_of(self.source, self.settings, as_live=self.as_live)
        self._spotter = fit_spotter(self.examples, self.settings, self.labels, self.listener)
        pose = None
        if opened.pictures:
            from gesture_core.pose.extract import open_backend
            from gesture_core.pose.live import LivePose
            from gesture_core.pose.parts import open_parts

            chosen = choose_pose(self.settings)
            self.listener.network(described(chosen))
            backend = open_backend(chosen)
            parts = open_parts(chosen, backend.skeleton)
            pose = LivePose(backend, follow=chosen.pose.follow, parts=parts, source=opened.name)
        capture = Capture(opened, self.settings.pose.rate)
        self.watch = Watch(capture, self._spotter, pose, self.settings.spot.gap, self.on_frame)
        self.name = opened.name
        self._resources.enter_context(capture)
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def __iter__(self) -> Iterator[Seen | Note | None]:
        """As `Watch`."""
        return iter(self.watch)

    @property
    def gestures(self) -> list[str]:
        """What is looked for."""
        return [label for label in self._spotter.examples.classes if label != NONE]

    @property
    def summary(self) -> WatchSummary:
        """What has come of it so far."""
        return self.watch.summary


def source_of(
    source: str | os.PathLike[str] | int, settings: Settings, *, as_live: bool = False
) -> FrameSource:
    """What a number, an address, a path or ``-`` stands for.

    Raises
    ------
    InputError
        Where it is a file that is not there, or that nobody reads.
    """
    text = os.fspath(source) if not isinstance(source, int) else str(source)
    if text.isdecimal() and not Path(text).exists():
        return Camera(int(text))
    if text.lower().startswith(ADDRESSES):
        return Camera(text)
    if text == "-":
        return piped(sys.stdin.buffer)
    items = discover([text], settings=settings)
    if len(items) != 1:
        cause = f"holds {len(items)} inputs, one is watched"
        raise InputError(cause, subject=printable(text), remedy="one of them", code="E_SOURCE")
    (item,) = items
    if item.kind == "video":
        return Recording(item.path, settings, as_live)
    if item.kind != "keypoints":
        raise InputError(
            item.fault, subject=item.name, remedy=item.remedy or "a video", code=item.code or "E_SOURCE"
        )
    return Keypoints(first_person(item, settings)[1], as_live)


def fit_spotter(
    examples: Sources, settings: Settings, labels: str = "folder", listener: Listener | None = None
) -> Spotter:
    """A live spotter of examples in folders; one that cannot be used is warned of.

    Raises
    ------
    InputError
        ``E_EXAMPLES`` where none can be used.
    """
    from gesture_core.spot.signals import refuse_channels, refuse_limits, stream_chain

    refuse_channels(settings)
    refuse_limits(settings)
    chain = stream_chain(settings)  # refuses settings under which nothing can be found
    sources = as_strings(examples)
    found = [item for item in discover(sources, settings=settings) if item.kind != "other"]
    if not found:
        raise InputError(
            "holds no example",
            subject=", ".join(map(shown, sources)),
            remedy="examples/<label>/<clip>",
            code="E_EMPTY",
        )
    items = label_inputs(found, labels, sources)
    people: dict[bytes, PoseSequence] = {}
    failed = [f"{item.name}: {item.code} {item.fault}" for item in items if item.kind == "broken"]
    readable = [item for item in items if item.kind != "broken"]
    for item, extracted, poses in people_of(readable, settings, listener=listener, inputs=1):
        if poses and not extracted.code:
            people[item.key] = poses[0]
        else:
            why = f"{extracted.code} {extracted.message}" if extracted.code else "nobody was found"
            failed.append(f"{item.name}: {why}")
    usable = []
    for item in readable:
        try:
            if item.key in people:
                chain(people[item.key])
                usable.append(item)
        except GestureError as error:
            failed.append(f"{item.name}: {error.code} {error.cause}")
    for text in failed:
        warnings.warn(f"example left out: {text}", stacklevel=2)
    if not usable:
        raise InputError(
            f"no example can be used; the first one: {failed[0]}", remedy="better clips", code="E_EXAMPLES"
        )
    spotter = Spotter(
        [people[item.key] for item in usable],
        [str(item.label) for item in usable],
        settings,
        names=[item.name for item in usable],
        live=True,
    )
    if spotter.examples.note:
        warnings.warn(spotter.examples.note, stacklevel=2)
    return spotter


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
