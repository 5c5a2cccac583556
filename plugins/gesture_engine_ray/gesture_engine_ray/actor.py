"""What runs on the machines of the cluster: one actor a worker, which has its network loaded once."""

from __future__ import annotations

import io
import json
import logging
import os
import threading
from collections.abc import Mapping
from contextlib import nullcontext, redirect_stderr, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from gesture_core.files import cache_dir, switched_on
from gesture_core.records import Job, Task
from gesture_core.run.workers.worker import Notes, Worker, as_tree

Signs = tuple[int, bool, bool, list[str]]
"""Frames that were done since the last time, whether there was any sign of life, whether what is done now may
take as long as a start, and what was logged."""
FLAGS = ("GESTURE_NO_CACHE", "GESTURE_TRACEBACK", "GESTURE_OFFLINE")
"""Variables that hold for the whole run, whatever a machine of the cluster has in them."""
PLACES = ("GESTURE_CACHE", "GESTURE_MODELS")
"""Variables that hold on each machine where there is such a folder."""
_LONGEST_SILENCE = 1.0


class Performer:
    """Performs tasks, one at a time, and is asked meanwhile how it goes.

    Parameters
    ----------
    job : str
        A `Job` as JSON: what comes and goes is text and bytes, so that no machine needs what another knows.
    folder : str
        Where the relative paths of inputs start, if there is such a folder on this machine.
    environment : mapping
        The variables of `FLAGS` and `PLACES` that are set where the run is.
    """

    def __init__(self, job: str, folder: str, environment: Mapping[str, str]) -> None:
        known = Job(**json.loads(job))
        with suppress(OSError):
            os.chdir(folder)
        for name in FLAGS:
            os.environ[name] = environment.get(name, "")
        with suppress(OSError):
            Path(known.store).mkdir(parents=True, exist_ok=True)
        for name in set(PLACES) & set(environment):
            if Path(environment[name]).expanduser().is_dir():
                os.environ[name] = environment[name]
        if not Path(known.store).is_dir():  # a folder of another machine
            known = replace(known, store=str(cache_dir() / "keypoints"))
        self._store = Path(known.store)
        self._worker = Worker(known, self._report)
        self._news = threading.Condition()
        self._signs: Signs = (0, False, False, [])
        logging.getLogger("gesture_core").addHandler(Notes(self._report))

    def ready(self) -> str:
        """The machine that this process is on, as soon as it is there."""
        import ray

        return str(ray.get_runtime_context().get_node_id())

    def perform(self, function: str, arguments: str) -> tuple[str, bytes, Signs]:
        """The outcome of a task as JSON, the keypoints that it left in the store, and the last signs."""
        errors = io.StringIO()
        with redirect_stderr(errors) if switched_on("GESTURE_TRACEBACK") else nullcontext():
            outcome = self._worker.perform(Task(0, function, json.loads(arguments)))
        tree = {
            "value": outcome.value,
            "error": outcome.error and as_tree(outcome.error),
            "traceback": errors.getvalue(),
        }
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
            frames, _, _, notes = self._signs
            notes += [message["note"]] if "note" in message else []
            self._signs = (frames + message.get("frames", 0), True, "slow" in message, notes)
            self._news.notify_all()

    def _taken(self) -> Signs:
        with self._news:
            signs, self._signs = self._signs, (0, False, self._signs[2], [])
            return signs
