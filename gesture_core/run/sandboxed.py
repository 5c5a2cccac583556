"""What the process of a `sandbox.Sandbox` does when it is asked: all of it may run a third party's code.

Started as ``python -m gesture_core.run.sandboxed``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gesture_core.errors import GestureError, PluginError
from gesture_core.run.child import MEMORY
from gesture_core.run.deciding import Arrived, Decider, Example
from gesture_core.run.exporting import suffix_of, write_rows
from gesture_core.run.readers import Fault, accepts, members
from gesture_core.run.sandbox import told
from gesture_core.run.serving import Message, Reply, serve
from gesture_core.run.store import read_keypoints
from gesture_core.settings import settings_from_dict


class _Sandboxed:
    """Answers questions; the decider of the run stays from one to the next."""

    def __init__(self) -> None:
        self._decider: Decider | None = None
        self._store = Path()

    def accepts(self, alive: Callable[[], None], reader: str, paths: Sequence[str]) -> list[bool | Fault]:
        """For each path whether the reader takes it, or what went wrong."""
        answers = []
        for path in paths:
            answers.append(accepts(reader, _path(path)))
            alive()
        return answers

    def members(self, alive: Callable[[], None], reader: str, path: str) -> list[str]:
        return members(reader, _path(path))

    def open(self, alive: Callable[[], None], settings: Mapping[str, Any], store: str) -> None:
        self._store = _path(store)
        self._decider = Decider(settings_from_dict(settings))
        self._decider.check()

    def example(self, alive: Callable[[], None], example: Mapping[str, str]) -> None:
        known = Example(**example)
        people = read_keypoints(self._store / known.stored, known.name).sequences
        self._ready.add(known, people)

    def fit(self, alive: Callable[[], None]) -> None:
        self._ready.fit(alive)

    def predict(self, alive: Callable[[], None], batch: Sequence[tuple[str, str]]) -> list[list[Any]]:
        """The predictions for everybody in each of the stored files."""
        arrived = [
            Arrived(name, stored, read_keypoints(self._store / stored, name).sequences)
            for name, stored in batch
        ]
        decided = self._ready.predict(arrived)
        return [[asdict(prediction) for prediction in one.predictions] for one in decided]

    def suffix(self, alive: Callable[[], None], format: str) -> str:
        return suffix_of(format)

    def write(self, alive: Callable[[], None], run: str, format: str, path: str) -> None:
        write_rows(_path(run), format, _path(path), alive)

    @property
    def _ready(self) -> Decider:
        assert self._decider is not None, "open comes first"
        return self._decider


def make(header: Message) -> Callable[[Message, Reply], None]:
    """What answers each question, with an answer or an error."""
    sandboxed = _Sandboxed()

    def handle(message: Message, reply: Reply) -> None:
        question = getattr(sandboxed, message["ask"])
        try:
            reply({"answer": question(lambda: reply({"alive": True}), **message["arguments"])})
        except BrokenPipeError:
            raise
        except GestureError as error:
            reply({"error": told(error)})
        except MemoryError:
            cause = "out of memory"
            remedy = "--set limits.memory=… with a larger figure"
            reply({"error": told(PluginError(cause, remedy=remedy, code=MEMORY))})
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin may raise anything
            cause = f"raised {type(error).__name__}: {error}"
            reply({"error": told(PluginError(cause, remedy="report it", code="E_PLUGIN_RAISED"))})

    return handle


def _path(text: str) -> Path:
    return Path(os.fsdecode(bytes.fromhex(text)))


if __name__ == "__main__":
    serve(make)
