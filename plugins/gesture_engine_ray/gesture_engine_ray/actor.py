"""What runs on the machines of the cluster: one actor a worker, which has its network loaded once."""

from __future__ import annotations

import json
import os
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from gesture_core.files import cache_dir
from gesture_core.records import Job, Task
from gesture_core.run.workers.worker import Worker, as_tree

Signs = tuple[int, bool, bool]
"""Frames that were done since the last time, whether there was any sign of life, and whether what is done now
may take as long as a start."""
_LONGEST_SILENCE = 1.0


class Performer:
    """Performs tasks, one at a time, and is asked meanwhile how it goes.

    Parameters
    ----------
    job : str
        A `Job` as JSON: what comes and goes is text and bytes, so that no machine needs what another knows.
    folder : str
        Where the relative paths of inputs start, if there is such a folder on this machine.
    """

    def __init__(self, job: str, folder: str) -> None:
        known = Job(**json.loads(job))
        with suppress(OSError):
            os.chdir(folder)
        try:
            Path(known.store).mkdir(parents=True, exist_ok=True)
        except OSError:  # a folder of another machine
            known = replace(known, store=str(cache_dir() / "keypoints"))
        self._store = Path(known.store)
        self._worker = Worker(known, self._report)
        self._news = threading.Condition()
        self._signs: Signs = (0, False, False)

    def ready(self) -> str:
        """The machine that this process is on, as soon as it is there."""
        import ray

        return str(ray.get_runtime_context().get_node_id())

    def perform(self, function: str, arguments: str) -> tuple[str, bytes, Signs]:
        """The outcome of a task as JSON, the keypoints that it left in the store, and the last signs."""
        outcome = self._worker.perform(Task(0, function, json.loads(arguments)))
        tree = {"value": outcome.value, "error": outcome.error and as_tree(outcome.error)}
        stored = outcome.value.get("stored") if isinstance(outcome.value, dict) else ""
        data = (self._store / stored).read_bytes() if stored else b""
        return json.dumps(tree), data, self._taken()

    def signs(self) -> Signs:
        """What has been reported, after waiting a moment for the first of it."""
        with self._news:
            self._news.wait_for(lambda: self._signs[1], _LONGEST_SILENCE)
        return self._taken()

    def _report(self, message: dict[str, Any]) -> None:
        with self._news:
            self._signs = (self._signs[0] + message.get("frames", 0), True, "slow" in message)
            self._news.notify_all()

    def _taken(self) -> Signs:
        with self._news:
            signs, self._signs = self._signs, (0, False, self._signs[2])
            return signs
